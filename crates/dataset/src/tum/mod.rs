//! TUM RGB-D (Sturm et al., IROS 2012): `rgb.txt` and `depth.txt` list images (`time file`, seconds), and
//! `groundtruth.txt` contains the camera trajectory (`time tx ty tz qx qy qz qw`, camera-to-world). Lines that start
//! with `#` are comments.
//!
//! Colour and depth are paired as in the benchmark's `associate.py`: the two closest times first, less than 0.02 s
//! apart. A frame's pose is the one measured **nearest** to its colour image, within 0.02 s. It is not interpolated, as
//! in the published evaluations; the trajectory has at least 100 poses per second. Frames without a partner or a pose
//! are skipped and counted.
//!
//! Depth is a 16-bit PNG with 5000 units per metre, registered to colour. Lens distortion is ignored.

mod associate;
mod lists;

use crate::decode::{read_color, read_depth};
use crate::listing::folder_name;
use crate::plausibility::warn_once;
use crate::scene::{FramePart, FrameParts, LeftOut, entry, require_registered};
use crate::text::{PinholeMatrix, shortened};
use crate::{DatasetError, Format, RecordedFrame, Scene};
pub(crate) use associate::associate;
pub(crate) use associate::nearest as nearest_time;
use lists::{ListedFile, TimedPose, read_file_list, read_trajectory};
use splatseg_geometry::{Intrinsics, Pose, SegmentMap};
use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Layout of a TUM RGB-D folder, for messages.
pub(crate) const LAYOUT: &str =
    "rgb.txt, depth.txt, groundtruth.txt and the images they list, camera-intrinsics.txt (optional)";

const COLOR_LIST: &str = "rgb.txt";
const DEPTH_LIST: &str = "depth.txt";
const TRAJECTORY: &str = "groundtruth.txt";
const INTRINSICS_FILE: &str = "camera-intrinsics.txt";
const UNITS_PER_METRE: f32 = 5000.0;
/// Maximum time between an image and a pose or another image paired with it, seconds.
const MAX_SECONDS_APART: f64 = 0.02;

const fn camera(fx: f32, fy: f32, cx: f32, cy: f32) -> Intrinsics {
    Intrinsics { fx, fy, cx, cy, width: 640, height: 480 }
}

/// Colour cameras from the benchmark's page, by a part of the sequence's name.
const PUBLISHED: [(&str, Intrinsics); 3] = [
    ("freiburg1", camera(517.3, 516.5, 318.6, 255.3)),
    ("freiburg2", camera(520.9, 521.0, 325.1, 249.7)),
    ("freiburg3", camera(535.4, 539.2, 320.1, 247.6)),
];
/// Default Kinect camera in ROS.
const ROS_DEFAULT: Intrinsics = camera(525.0, 525.0, 319.5, 239.5);

/// A colour image with its depth image and pose.
#[derive(Clone, Debug)]
struct TumFrame {
    name: String,
    /// Time of the colour image since the Unix epoch; `None` for times before it.
    timestamp: Option<Duration>,
    color: PathBuf,
    depth: PathBuf,
    pose: TimedPose,
}

/// A sequence in the layout of TUM RGB-D. It has no ground truth segments.
///
/// Intrinsics are read from `camera-intrinsics.txt` (3x3) if it exists. Otherwise they are the published ones if the
/// folder's name contains `freiburg1`, `freiburg2` or `freiburg3`, or else ROS's default (525, 525, 319.5, 239.5), with
/// a warning. These are for 640x480 pixels and are scaled to the images' size. Frames are named like their colour
/// images.
#[derive(Debug)]
pub struct TumScene {
    name: String,
    folder: PathBuf,
    frames: Vec<TumFrame>,
    intrinsics: Option<PinholeMatrix>,
    assumed_camera: Intrinsics,
    left_out: Vec<LeftOut>,
}

impl TumScene {
    /// Reads the lists in a sequence's folder and pairs colour, depth and poses, in time order.
    ///
    /// # Errors
    /// If a list is missing or damaged or contains a colour image twice, if nothing can be paired, or if the intrinsics
    /// are damaged.
    pub fn open(folder: &Path) -> Result<Self, DatasetError> {
        let (color, unreadable_color) = read_file_list(folder, COLOR_LIST, "list of colour images")?;
        let (depth, unreadable_depth) = read_file_list(folder, DEPTH_LIST, "list of depth images")?;
        let unreadable = unreadable_color + unreadable_depth;
        let trajectory = read_trajectory(&folder.join(TRAJECTORY))?;
        let frames = frames_of(&color, &depth, &trajectory);
        if frames.is_empty() {
            let expected = "colour, depth and a pose within 0.02 seconds of each other";
            return Err(DatasetError::NoFrames { path: folder.to_owned(), expected });
        }
        let mut names = HashSet::new();
        // Outputs are named after frames, so one would overwrite the other.
        if let Some(frame) = frames.iter().find(|frame| !names.insert(frame.name.as_str())) {
            return Err(DatasetError::Field {
                path: folder.join(COLOR_LIST),
                field: "file".to_owned(),
                found: shortened(&frame.name),
                expected: "each image once".to_owned(),
            });
        }
        let left_out = LeftOut::list([
            (
                color.len() - frames.len(),
                format!("without a depth image or a pose within {MAX_SECONDS_APART} s of their colour image"),
            ),
            (unreadable, format!("with names that are not UTF-8 in {COLOR_LIST} or {DEPTH_LIST}")),
        ]);
        let name = folder_name(folder);
        let intrinsics_path = folder.join(INTRINSICS_FILE);
        let intrinsics = if intrinsics_path.exists() { Some(PinholeMatrix::read(&intrinsics_path)?) } else { None };
        let published = PUBLISHED.iter().find(|(part, _)| name.contains(part)).map(|(_, camera)| *camera);
        if intrinsics.is_none() && published.is_none() {
            warn_once(format!(
                "{}: no {INTRINSICS_FILE} and no freiburg1, 2 or 3 in the folder's name: assuming ROS's default camera",
                folder.display()
            ));
        }
        let assumed_camera = published.unwrap_or(ROS_DEFAULT);
        Ok(Self { name, folder: folder.to_owned(), frames, intrinsics, assumed_camera, left_out })
    }

    fn camera(&self, size: (usize, usize)) -> Result<Intrinsics, DatasetError> {
        match self.intrinsics {
            Some(matrix) => matrix.for_size(size, &self.folder.join(INTRINSICS_FILE)),
            None => Ok(self.assumed_camera.resized(size.0, size.1)),
        }
    }
}

/// Pairs colour, depth and poses by time, in time order.
fn frames_of(color: &[ListedFile], depth: &[ListedFile], trajectory: &[TimedPose]) -> Vec<TumFrame> {
    let times = |list: &[ListedFile]| list.iter().map(|file| file.seconds).collect::<Vec<f64>>();
    let pose_times: Vec<f64> = trajectory.iter().map(|pose| pose.seconds).collect();
    let frame = |(color_index, depth_index): (usize, usize)| {
        let (color, depth) = (&color[color_index], &depth[depth_index]);
        let pose = nearest_time(&pose_times, color.seconds, MAX_SECONDS_APART)?;
        Some(TumFrame {
            name: color.stem.clone(),
            timestamp: Duration::try_from_secs_f64(color.seconds).ok(),
            color: color.path.clone(),
            depth: depth.path.clone(),
            pose: trajectory[pose],
        })
    };
    associate(&times(color), &times(depth), MAX_SECONDS_APART).into_iter().filter_map(frame).collect()
}

/// Returns the required parts of a sequence, each with true if the folder has it.
pub(crate) fn parts(path: &Path) -> Vec<(&'static str, bool)> {
    [COLOR_LIST, DEPTH_LIST, TRAJECTORY].map(|part| (part, path.join(part).is_file())).to_vec()
}

/// Returns true if a folder contains a sequence.
pub(crate) fn looks_like(path: &Path) -> bool {
    parts(path).iter().all(|(_, is_present)| *is_present)
}

impl Scene for TumScene {
    fn name(&self) -> &str {
        &self.name
    }

    fn frame_count(&self) -> usize {
        self.frames.len()
    }

    fn frame_name(&self, index: usize) -> String {
        self.frames.get(index).map(|frame| frame.name.clone()).unwrap_or_default()
    }

    fn read_recorded(&self, index: usize) -> Result<RecordedFrame, DatasetError> {
        let frame = entry(&self.frames, index, &self.name)?;
        // The benchmark uses the same camera axes.
        let pose = Pose::from_quaternion(frame.pose.position, frame.pose.rotation)
            .map_err(|source| DatasetError::Pose { path: self.file_of(index, FramePart::Pose), source })?;
        let depth = read_depth(&frame.depth, UNITS_PER_METRE)?;
        let color = read_color(&frame.color)?;
        require_registered(&color, &depth, &frame.depth)?;
        let (name, timestamp, intrinsics) = (frame.name.clone(), frame.timestamp, self.camera(color.size())?);
        FrameParts { name, timestamp, color, depth, intrinsics, world_from_camera: Some(pose) }.into_frame()
    }

    fn has_ground_truth(&self) -> bool {
        false
    }

    fn read_ground_truth(&self, _index: usize) -> Result<Option<SegmentMap>, DatasetError> {
        Ok(None)
    }

    fn format(&self) -> Option<Format> {
        Some(Format::Tum)
    }

    fn left_out(&self) -> &[LeftOut] {
        &self.left_out
    }

    fn file_of(&self, index: usize, part: FramePart) -> PathBuf {
        match (self.frames.get(index), part) {
            (Some(frame), FramePart::Depth) => frame.depth.clone(),
            (Some(frame), FramePart::Pose) => {
                format!("{}: line {}", self.folder.join(TRAJECTORY).display(), frame.pose.line).into()
            }
            (_, FramePart::Intrinsics) => self.folder.join(INTRINSICS_FILE),
            (None, _) => self.folder.clone(),
        }
    }
}
