//! Reading of text files with poses, such as `poses.txt` in a plain folder: TUM RGB-D lines, or 4x4 matrices.

use crate::DatasetError;
use crate::recorded_poses::{has_unit_length, tracked};
use crate::stamps::{Stamp, TimeScale};
use crate::text::{read_text_with_numbers, shortened};
use glam::{DQuat, DVec3};
use splatseg_geometry::{Pose, PoseError};
use std::path::Path;

/// Maximum file size, enough for half a million poses as text.
const MAX_BYTES: u64 = 64 << 20;

/// A pose of a list.
#[derive(Clone, Copy, Debug)]
pub struct ListedPose {
    /// Time of measurement, seconds; `None` for matrices.
    pub seconds: Option<f64>,
    /// `None` if tracking was lost: a number is NaN or infinite.
    pub world_from_camera: Option<Pose>,
    /// Number of its first line, from 1, for messages.
    pub line: usize,
}

/// Layout of the poses in a file, determined by the number of values per line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Layout {
    /// time tx ty tz qx qy qz qw
    Tum,
    /// A 4x4 matrix, row by row.
    MatrixInLine,
    /// One row of a 4x4 matrix.
    MatrixInFourLines,
}

impl Layout {
    fn of(numbers: usize) -> Option<Self> {
        [Self::Tum, Self::MatrixInLine, Self::MatrixInFourLines].into_iter().find(|layout| layout.numbers() == numbers)
    }

    fn numbers(self) -> usize {
        match self {
            Self::Tum => 8,
            Self::MatrixInLine => 16,
            Self::MatrixInFourLines => 4,
        }
    }
}

/// A line with numbers.
pub(super) struct Line<'a> {
    /// From 1.
    number: usize,
    text: &'a str,
    /// At most a few more words than any layout has, enough to detect extra ones.
    pub(super) words: Vec<&'a str>,
}

impl<'a> Line<'a> {
    /// Parses a line; `None` if it is empty or a comment.
    pub(super) fn new((index, text): (usize, &'a str)) -> Option<Self> {
        let is_separator = |letter: char| letter.is_whitespace() || letter == ',';
        let words: Vec<&str> = text.split(is_separator).filter(|word| !word.is_empty()).take(20).collect();
        let is_comment = words.first().is_none_or(|word| word.starts_with('#'));
        (!is_comment).then_some(Self { number: index + 1, text, words })
    }

    pub(super) fn wrong(&self, path: &Path, expected: &str) -> DatasetError {
        DatasetError::Field {
            path: path.to_owned(),
            field: format!("line {}", self.number),
            found: shortened(self.text),
            expected: expected.to_owned(),
        }
    }

    /// Parses the line as `N` numbers.
    fn numbers<const N: usize>(&self, path: &Path) -> Result<[f64; N], DatasetError> {
        let numbers: Option<Vec<f64>> = self.words.iter().map(|word| word.parse().ok()).collect();
        numbers
            .and_then(|numbers| numbers.try_into().ok())
            .ok_or_else(|| self.wrong(path, &format!("{N} numbers, as in the lines before")))
    }
}

/// Reads a list of poses in file order: lines with 8 numbers (`time tx ty tz qx qy qz qw`, as in TUM RGB-D), 16 (a 4x4
/// matrix, row by row) or 4 (a row of a matrix), camera-to-world, metres. The first line determines which. Empty lines and
/// lines that start with `#` are skipped.
///
/// # Errors
/// If the file cannot be read or has more than 64 MiB, or a line is not such a pose; names the line.
pub fn read_pose_list(path: &Path) -> Result<Vec<ListedPose>, DatasetError> {
    let text = read_text_with_numbers(path, "list of poses", MAX_BYTES)?;
    let mut lines = text.lines().enumerate().filter_map(Line::new).peekable();
    let Some(first) = lines.peek() else { return Ok(Vec::new()) };
    let layout = Layout::of(first.words.len()).ok_or_else(|| {
        let expected = "8 numbers (time tx ty tz qx qy qz qw), 16 (a 4x4 matrix) or 4 (a row of a 4x4 matrix)";
        first.wrong(path, expected)
    })?;
    let (mut poses, mut stamps) = (Vec::new(), Vec::new());
    while let Some(line) = lines.next() {
        poses.push(match layout {
            Layout::Tum => {
                let (stamp, pose) = tum_pose(path, &line)?;
                stamps.push(stamp);
                pose
            }
            Layout::MatrixInLine => matrix_pose(path, line.number, line.numbers(path)?)?,
            Layout::MatrixInFourLines => {
                let mut rows = vec![line.numbers::<4>(path)?];
                while let (true, Some(next)) = (rows.len() < 4, lines.peek()) {
                    rows.push(next.numbers(path)?);
                    lines.next();
                }
                let numbers = rows.concat().try_into().map_err(|numbers: Vec<f64>| DatasetError::Field {
                    path: path.to_owned(),
                    field: format!("last matrix, from line {}", line.number),
                    found: format!("{} rows", numbers.len() / 4),
                    expected: "4".to_owned(),
                })?;
                matrix_pose(path, line.number, numbers)?
            }
        });
    }
    set_times(path, &mut poses, &stamps)?;
    Ok(poses)
}

/// Sets the times of poses once all are known, because only together they tell their unit. `stamps` is empty for matrices.
fn set_times(path: &Path, poses: &mut [ListedPose], stamps: &[Stamp]) -> Result<(), DatasetError> {
    let Some(first) = stamps.first() else { return Ok(()) };
    let times = TimeScale::of(stamps, None);
    times.tell(path, first);
    for (pose, stamp) in poses.iter_mut().zip(stamps) {
        pose.seconds = Some(times.seconds(*stamp, (path, &format!("line {}", pose.line)))?);
    }
    Ok(())
}

/// Reads a pose and its time as written.
fn tum_pose(path: &Path, line: &Line<'_>) -> Result<(Stamp, ListedPose), DatasetError> {
    let [_, tx, ty, tz, qx, qy, qz, qw] = line.numbers(path)?;
    let stamp = line.words.first().and_then(|word| Stamp::parse(word));
    let stamp = stamp.ok_or_else(|| line.wrong(path, "a time in seconds first"))?;
    let world_from_camera = listed_pose(path, line, [tx, ty, tz, qx, qy, qz, qw])?;
    Ok((stamp, ListedPose { seconds: None, world_from_camera, line: line.number }))
}

/// Returns the pose of a line with a position and a quaternion, or none if tracking was lost.
pub(super) fn listed_pose(
    path: &Path,
    line: &Line<'_>,
    [tx, ty, tz, qx, qy, qz, qw]: [f64; 7],
) -> Result<Option<Pose>, DatasetError> {
    let (position, rotation) = (DVec3::new(tx, ty, tz), DQuat::from_xyzw(qx, qy, qz, qw));
    if rotation.is_finite() && position.is_finite() && !has_unit_length(rotation) {
        let expected = format!(
            "a quaternion qx qy qz qw of length 1 at the end of the line (this one has length {:.3})",
            rotation.length()
        );
        return Err(line.wrong(path, &expected));
    }
    tracked(Pose::from_quaternion(position, rotation), || place(path, line.number))
}

fn matrix_pose(path: &Path, line: usize, numbers: [f64; 16]) -> Result<ListedPose, DatasetError> {
    listed(path, line, Pose::from_row_major(numbers))
}

/// Returns the pose, or none if tracking was lost.
fn listed(path: &Path, line: usize, pose: Result<Pose, PoseError>) -> Result<ListedPose, DatasetError> {
    let world_from_camera = tracked(pose, || place(path, line))?;
    Ok(ListedPose { seconds: None, world_from_camera, line })
}

/// Formats a file and line, for messages.
pub(super) fn place(path: &Path, line: usize) -> std::path::PathBuf {
    format!("{}: line {line}", path.display()).into()
}
