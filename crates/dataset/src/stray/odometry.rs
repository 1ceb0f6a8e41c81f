//! `odometry.csv` and `camera_matrix.csv` of Stray Scanner: numbers separated by commas.
//!
//! The first line of `odometry.csv` names the columns: `timestamp, frame, x, y, z, qx, qy, qz, qw`, and since 2026
//! `fx, fy, cx, cy`. They are found by name, in any order.

use crate::DatasetError;
use crate::files::read_file;
use crate::recorded_poses::listed_quaternion;
use crate::text::{PinholeMatrix, not_text, shortened};
use glam::{DQuat, DVec3};
use splatseg_files::text_of;
use splatseg_geometry::{Pose, PoseError};
use std::collections::BTreeMap;
use std::path::Path;

/// An hour at 60 frames a second has 40 MB.
const MAX_BYTES: u64 = 256 << 20;
const MAX_MATRIX_BYTES: u64 = 64 << 10;
/// Columns that every file has, in the order in which they are used.
const COLUMNS: [&str; 9] = ["timestamp", "frame", "x", "y", "z", "qx", "qy", "qz", "qw"];
const CAMERA_COLUMNS: [&str; 4] = ["fx", "fy", "cx", "cy"];

/// Poses and cameras by number of their frame.
#[derive(Debug)]
pub(super) struct Odometry {
    lines: BTreeMap<u64, OdometryLine>,
}

/// A line.
#[derive(Clone, Debug)]
pub(super) struct OdometryLine {
    /// Number of the line, from 1.
    pub(super) number: usize,
    pub(super) seconds: f64,
    pub(super) pose: Result<Pose, PoseError>,
    /// For the full resolution of the video.
    pub(super) camera: Option<PinholeMatrix>,
}

impl Odometry {
    /// Reads the file.
    pub(super) fn read(path: &Path) -> Result<Self, DatasetError> {
        let what = "odometry";
        let text = text_of(read_file(path, what, MAX_BYTES)?).map_err(|error| not_text(path, what, error))?;
        let mut lines = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
        let head: Vec<&str> = lines.next().map(|(_, line)| words(line)).unwrap_or_default();
        let column = |name: &str| head.iter().position(|column| column.eq_ignore_ascii_case(name));
        let missing = |found: &str| DatasetError::Field {
            path: path.to_owned(),
            field: "line 1".to_owned(),
            found: shortened(found),
            expected: format!("columns named {}", COLUMNS.join(", ")),
        };
        let places: Option<Vec<usize>> = COLUMNS.into_iter().map(column).collect();
        let places = places.ok_or_else(|| missing(&head.join(", ")))?;
        let camera: Option<Vec<usize>> = CAMERA_COLUMNS.into_iter().map(column).collect();
        let parsed = lines.map(|(index, line)| parse(path, (index, line), &places, camera.as_deref()));
        Ok(Self { lines: parsed.collect::<Result<_, _>>()? })
    }

    /// Returns the lowest and the highest number of a frame; `None` if there are no lines.
    pub(super) fn range(&self) -> Option<(u64, u64)> {
        Some((*self.lines.first_key_value()?.0, *self.lines.last_key_value()?.0))
    }

    /// Returns the line of a frame.
    pub(super) fn line(&self, frame: u64) -> Option<&OdometryLine> {
        self.lines.get(&frame)
    }
}

/// Parses a line: the number of its frame, and the rest. `index` counts lines from 0.
fn parse(
    path: &Path,
    (index, line): (usize, &str),
    places: &[usize],
    camera: Option<&[usize]>,
) -> Result<(u64, OdometryLine), DatasetError> {
    let field = format!("line {}", index + 1);
    let wrong = || DatasetError::Field {
        path: path.to_owned(),
        field: field.clone(),
        found: shortened(line),
        expected: "a number in each column that the first line names".to_owned(),
    };
    let words = words(line);
    let numbers =
        |places: &[usize]| -> Option<Vec<f64>> { places.iter().map(|place| words.get(*place)?.parse().ok()).collect() };
    let [seconds, frame, x, y, z, qx, qy, qz, qw] =
        numbers(places).and_then(|numbers| <[f64; 9]>::try_from(numbers).ok()).ok_or_else(wrong)?;
    if !(0.0..1e15).contains(&frame) || frame.fract() != 0.0 {
        return Err(wrong());
    }
    let camera = match camera {
        None => None,
        Some(places) => {
            let [fx, fy, cx, cy] =
                numbers(places).and_then(|numbers| <[f64; 4]>::try_from(numbers).ok()).ok_or_else(wrong)?;
            let [fx, fy, cx, cy] = [fx, fy, cx, cy].map(|number| number as f32);
            Some(PinholeMatrix { fx, fy, cx, cy })
        }
    };
    let pose = listed_quaternion(DVec3::new(x, y, z), DQuat::from_xyzw(qx, qy, qz, qw), (path, &field))?;
    Ok((frame as u64, OdometryLine { number: index + 1, seconds, pose, camera }))
}

/// Reads `camera_matrix.csv`, a 3x3 matrix row by row.
pub(super) fn read_matrix(path: &Path) -> Result<PinholeMatrix, DatasetError> {
    let what = "camera matrix";
    let text = text_of(read_file(path, what, MAX_MATRIX_BYTES)?).map_err(|error| not_text(path, what, error))?;
    let parse = |word: &str| {
        let wrong = || DatasetError::Text {
            path: path.to_owned(),
            what,
            found: shortened(word),
            expected: "numbers separated by commas",
        };
        word.parse().map_err(|_| wrong())
    };
    let numbers: Vec<f64> = text.lines().flat_map(words).map(parse).collect::<Result<_, _>>()?;
    PinholeMatrix::from_numbers(&numbers, path, what)
}

fn words(line: &str) -> Vec<&str> {
    line.split(',').map(str::trim).filter(|word| !word.is_empty()).collect()
}
