//! TUM RGB-D (Sturm et al., IROS 2012): `rgb.txt` and `depth.txt` list images (`time file`, seconds), and
//! `groundtruth.txt` contains the camera trajectory (`time tx ty tz qx qy qz qw`, camera-to-world). Lines that start
//! with `#` are comments. Times in other units than seconds are recognised (see `stamps.rs`).
//!
//! Colour and depth are paired as in the benchmark's `associate.py`: the two closest times first, less than 0.02 s
//! apart. A frame's pose is the one measured **nearest** to its colour image, within 0.02 s. It is not interpolated, as
//! in the published evaluations; the trajectory has at least 100 poses per second. Colour images without a partner are
//! skipped and counted. Frames may have no pose, and `groundtruth.txt` may be missing.
//!
//! Depth is a 16-bit PNG with 5000 units per metre, unless the settings say otherwise, registered to colour. Lens distortion is ignored.

mod associate;
mod lists;

use crate::decode::read_color;
use crate::depth_file::read_depth;
use crate::depth_scale::DepthScale;
use crate::files::is_there;
use crate::listing::folder_name;
use crate::own_camera::{OwnCamera, at_resolution, camera_place};
use crate::plausibility::warn_once;
use crate::recorded_poses::{LOST, PoseCoverage, listed_quaternion, no_common_time, tracked};
use crate::scene::{FramePart, FrameParts, LeftOut, entry, require_registered};
use crate::stamps::no_pairs;
use crate::text::{PinholeMatrix, shortened};
use crate::{DatasetError, DatasetSettings, Format, RecordedFrame, Scene};
pub(crate) use associate::associate;
pub(crate) use associate::nearest as nearest_time;
use lists::{FileList, ListedFile, TimedPose, read_file_list, read_trajectory};
use splatseg_geometry::{Intrinsics, Pose, SegmentMap};
use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Layout of a TUM RGB-D folder, for messages.
pub(crate) const LAYOUT: &str =
    "rgb.txt, depth.txt and the images they list, groundtruth.txt and camera-intrinsics.txt (optional)";

const COLOR_LIST: &str = "rgb.txt";
const DEPTH_LIST: &str = "depth.txt";
const TRAJECTORY: &str = "groundtruth.txt";
const INTRINSICS_FILE: &str = "camera-intrinsics.txt";
const DEPTH_SCALE: DepthScale = DepthScale::of_format(5000.0);
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

/// A colour image with its depth image and the pose nearest in time.
#[derive(Clone, Debug)]
struct TumFrame {
    name: String,
    /// Time of the colour image, seconds since the Unix epoch.
    seconds: f64,
    color: PathBuf,
    depth: PathBuf,
    pose: Option<TimedPose>,
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
    own_camera: Option<OwnCamera>,
    depth_scale: DepthScale,
    poses: PoseCoverage,
    left_out: Vec<LeftOut>,
}

impl TumScene {
    /// Reads the lists in a sequence's folder and pairs colour, depth and poses, in time order. Uses only `fx` to `cy`
    /// and `depth_scale` of `settings`.
    ///
    /// # Errors
    /// If a list of images is missing, a list is damaged or contains a colour image twice, no colour can be paired with
    /// depth, or there is a trajectory without a pose near any frame; or if the intrinsics are damaged.
    pub fn open(folder: &Path, settings: &DatasetSettings) -> Result<Self, DatasetError> {
        settings.validate()?;
        let own_camera = OwnCamera::from_settings(settings)?;
        let FileList { files: color, unreadable: unreadable_color, times } =
            read_file_list(folder, COLOR_LIST, "list of colour images", None)?;
        let FileList { files: depth, unreadable: unreadable_depth, .. } =
            read_file_list(folder, DEPTH_LIST, "list of depth images", Some(&times))?;
        let unreadable = unreadable_color + unreadable_depth;
        let path = folder.join(TRAJECTORY);
        let trajectory = if is_there(&path) { Some(read_trajectory(&path, &times)?) } else { None };
        let frames = frames_of(&color, &depth, trajectory.as_deref().unwrap_or_default());
        if frames.is_empty() {
            let (color, depth) = (times_of(&color), times_of(&depth));
            let (color_list, depth_list) = (folder.join(COLOR_LIST), folder.join(DEPTH_LIST));
            return Err(no_pairs((&color_list, &color), (&depth_list, &depth), MAX_SECONDS_APART));
        }
        let poses = match trajectory {
            None => PoseCoverage::NONE,
            Some(trajectory) => coverage(&path, &frames, &trajectory)?,
        };
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
                format!("without a depth image within {MAX_SECONDS_APART} s of their colour image"),
            ),
            (unreadable, format!("with names that are not UTF-8 in {COLOR_LIST} or {DEPTH_LIST}")),
        ]);
        let name = folder_name(folder);
        let intrinsics_path = folder.join(INTRINSICS_FILE);
        let intrinsics = if intrinsics_path.exists() { Some(PinholeMatrix::read(&intrinsics_path)?) } else { None };
        let published = PUBLISHED.iter().find(|(part, _)| name.contains(part)).map(|(_, camera)| *camera);
        if own_camera.is_none() && intrinsics.is_none() && published.is_none() {
            warn_once(format!(
                "{}: no {INTRINSICS_FILE} and no freiburg1, 2 or 3 in the folder's name: assuming ROS's default camera",
                folder.display()
            ));
        }
        let assumed_camera = published.unwrap_or(ROS_DEFAULT);
        let folder = folder.to_owned();
        let depth_scale = DEPTH_SCALE.or_of(settings);
        Ok(Self { name, folder, frames, intrinsics, assumed_camera, own_camera, depth_scale, poses, left_out })
    }

    /// Returns the camera of a colour image of `size` `(width, height)`, which is in the file `image`.
    fn camera(&self, size: (usize, usize), image: &Path) -> Result<Intrinsics, DatasetError> {
        match (self.own_camera, self.intrinsics) {
            (Some(camera), _) => Ok(camera.intrinsics(size)),
            (None, Some(matrix)) => matrix.for_size(size, &self.folder.join(INTRINSICS_FILE)),
            (None, None) => at_resolution(&self.assumed_camera, size, (image, "the camera has that is assumed")),
        }
    }

    /// Returns the file and line of a pose, for messages.
    fn pose_place(&self, pose: &TimedPose) -> PathBuf {
        format!("{}: line {}", self.folder.join(TRAJECTORY).display(), pose.line).into()
    }

    /// Returns a pose of the trajectory; `None` if tracking was lost.
    fn world_from_camera(&self, pose: &TimedPose) -> Result<Option<Pose>, DatasetError> {
        let place = self.pose_place(pose);
        let stated = listed_quaternion(pose.position, pose.rotation, (&place, "pose"))?;
        tracked(stated, || place)
    }
}

/// Counts the frames without a pose. `path` is the trajectory, for errors.
fn coverage(path: &Path, frames: &[TumFrame], trajectory: &[TimedPose]) -> Result<PoseCoverage, DatasetError> {
    let missing = frames.iter().filter(|frame| frame.pose.is_none()).count();
    if missing == frames.len() {
        let pose_times: Vec<f64> = trajectory.iter().map(|pose| pose.seconds).collect();
        let image_times: Vec<f64> = frames.iter().map(|frame| frame.seconds).collect();
        return Err(no_common_time(path, &pose_times, &image_times));
    }
    let is_lost = |frame: &&TumFrame| frame.pose.is_some_and(|pose| !pose.is_finite());
    Ok(PoseCoverage::new(
        frames.len(),
        [
            (missing, format!("without a pose within {MAX_SECONDS_APART} s of their colour image")),
            (frames.iter().filter(is_lost).count(), format!("whose pose in {TRAJECTORY} {LOST}")),
        ],
    ))
}

/// The times of a list of images, seconds.
fn times_of(list: &[ListedFile]) -> Vec<f64> {
    list.iter().map(|file| file.seconds).collect()
}

/// Pairs colour, depth and poses by time, in time order.
fn frames_of(color: &[ListedFile], depth: &[ListedFile], trajectory: &[TimedPose]) -> Vec<TumFrame> {
    let pose_times: Vec<f64> = trajectory.iter().map(|pose| pose.seconds).collect();
    let frame = |(color_index, depth_index): (usize, usize)| {
        let (color, depth) = (&color[color_index], &depth[depth_index]);
        let pose = nearest_time(&pose_times, color.seconds, MAX_SECONDS_APART);
        TumFrame {
            name: color.stem.clone(),
            seconds: color.seconds,
            color: color.path.clone(),
            depth: depth.path.clone(),
            pose: pose.and_then(|pose| trajectory.get(pose)).copied(),
        }
    };
    associate(&times_of(color), &times_of(depth), MAX_SECONDS_APART).into_iter().map(frame).collect()
}

/// Returns the required parts of a sequence, each with true if the folder has it.
pub(crate) fn parts(path: &Path) -> Vec<(&'static str, bool)> {
    [COLOR_LIST, DEPTH_LIST].map(|part| (part, path.join(part).is_file())).to_vec()
}

/// Returns true if a sequence has poses.
pub(crate) fn is_whole(path: &Path) -> bool {
    path.join(TRAJECTORY).is_file()
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
        let pose = frame.pose.map(|pose| self.world_from_camera(&pose)).transpose()?.flatten();
        let depth = read_depth(&frame.depth, self.depth_scale)?;
        let color = read_color(&frame.color)?;
        require_registered(&color, &depth, &frame.depth)?;
        let (name, intrinsics) = (frame.name.clone(), self.camera(color.size(), &frame.color)?);
        // `None` for times before 1970.
        let timestamp = Duration::try_from_secs_f64(frame.seconds).ok();
        FrameParts { name, timestamp, color, depth, intrinsics, world_from_camera: pose }.into_frame()
    }

    fn has_poses(&self) -> bool {
        self.poses.has_poses()
    }

    fn without_pose(&self) -> &[LeftOut] {
        self.poses.without_pose()
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
                frame.pose.map_or_else(|| self.folder.join(TRAJECTORY), |pose| self.pose_place(&pose))
            }
            (_, FramePart::Intrinsics) => camera_place(self.own_camera.as_ref(), &self.folder.join(INTRINSICS_FILE)),
            (None, _) => self.folder.clone(),
        }
    }
}
