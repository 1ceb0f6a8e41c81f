//! ARKitScenes (Baruch et al., NeurIPS 2021), raw or 3DOD: `lowres_wide/<video>_<time>.png` (256x192),
//! `lowres_depth/` (16-bit PNG, millimetres), `confidence/` (0 to 2), `lowres_wide_intrinsics/` (`.pincam`: width height fx
//! fy cx cy) and `lowres_wide.traj` (time, axis and angle of the rotation, translation).
//!
//! As in the data set's own `tenFpsDataLoader.py`: poses are world-to-camera with the axes of OpenCV, a camera is that of
//! the same time or a millisecond off, and a frame has the nearest pose less than 5 ms away.

use crate::depth_scale::DepthScale;
use crate::files::is_there;
use crate::frame_list::{FrameList, FrameListScene, ListedFrame, PlainFiles, StatedPoses};
use crate::listing::{folder_name, names_in, no_frames_in};
use crate::recorded_poses::no_common_time;
use crate::scene::LeftOut;
use crate::text::{read_text_with_numbers, shortened};
use crate::tum::nearest_time;
use crate::undistort::Camera;
use crate::{DatasetError, DatasetSettings, Format};
use glam::{DQuat, DVec3};
use splatseg_geometry::{Intrinsics, Pose};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Layout, for messages.
pub(crate) const LAYOUT: &str = "lowres_wide/, lowres_depth/, lowres_wide_intrinsics/, lowres_wide.traj (optional), confidence/ (optional): ARKitScenes";

const COLOR: &str = "lowres_wide";
const DEPTH: &str = "lowres_depth";
const CONFIDENCE: &str = "confidence";
const CAMERAS: &str = "lowres_wide_intrinsics";
const TRAJECTORY: &str = "lowres_wide.traj";
const MAX_TRAJECTORY_BYTES: u64 = 64 << 20;
const MAX_CAMERA_BYTES: u64 = 4096;
/// Maximum time between a frame and its pose, seconds.
const MAX_SECONDS_APART: f64 = 0.005;

/// A pose of the trajectory.
struct TimedPose {
    seconds: f64,
    /// Rotation and translation as stated.
    rotation: DVec3,
    translation: DVec3,
    /// Number of the line, from 1.
    line: usize,
}

impl TimedPose {
    /// Parses a line.
    fn parse(path: &Path, (index, line): (usize, &str)) -> Result<Self, DatasetError> {
        let numbers: Option<Vec<f64>> = line.split_whitespace().map(|word| word.parse().ok()).collect();
        let numbers = numbers.and_then(|numbers| <[f64; 7]>::try_from(numbers).ok());
        let [seconds, ax, ay, az, x, y, z] =
            numbers.filter(|[seconds, ..]| seconds.is_finite()).ok_or_else(|| DatasetError::Field {
                path: path.to_owned(),
                field: format!("line {}", index + 1),
                found: shortened(line),
                expected: "7 numbers: time, rotation as axis times angle, translation".to_owned(),
            })?;
        let (rotation, translation) = (DVec3::new(ax, ay, az), DVec3::new(x, y, z));
        Ok(Self { seconds, rotation, translation, line: index + 1 })
    }
}

/// Lists the frames and reads their cameras. Uses only `fx` to `cy`, `depth_scale` and those about poses of `settings`.
///
/// # Errors
/// If there are no frames with colour, depth and a camera, a text file is damaged, or no pose of the trajectory is near a
/// frame.
pub(crate) fn open(path: &Path, settings: &DatasetSettings) -> Result<FrameListScene, DatasetError> {
    settings.validate()?;
    let folder = frames_folder(path);
    let names = |part: &str| -> Vec<String> {
        let names = names_in(&folder.join(part)).into_iter();
        names.filter(|name| name.ends_with(".png") && seconds_of(name).is_some()).collect()
    };
    let (color, depth) = (names(COLOR), names(DEPTH));
    for (part, names) in [(COLOR, &color), (DEPTH, &depth)] {
        if names.is_empty() {
            return Err(no_frames_in(&folder.join(part), "<video>_<time>.png"));
        }
    }
    let trajectory = folder.join(TRAJECTORY);
    let states_poses = is_there(&trajectory);
    let poses = if states_poses { read_trajectory(&trajectory)? } else { Vec::new() };
    let reader = ListReader {
        times: poses.iter().map(|pose| pose.seconds).collect(),
        poses,
        stated: StatedPoses::world_to_camera(settings),
        has_own_camera: settings.fx.is_some(),
        trajectory,
        folder: &folder,
    };
    let paired: Vec<&String> = color.iter().filter(|name| depth.binary_search(name).is_ok()).collect();
    let mut frames: Vec<(f64, ListedFrame)> = Vec::new();
    for name in &paired {
        let seconds = seconds_of(name).unwrap_or_default();
        frames.extend(reader.frame(name, seconds)?.map(|frame| (seconds, frame)));
    }
    if frames.is_empty() {
        return Err(DatasetError::Field {
            path: folder,
            field: "frames".to_owned(),
            found: format!("{} with colour and depth, and none with a camera", paired.len()),
            expected: format!("colour, depth and {CAMERAS} of the same name"),
        });
    }
    frames.sort_by(|(a, _), (b, _)| a.total_cmp(b));
    if states_poses {
        reader.require_common_time(&frames.iter().map(|(seconds, _)| *seconds).collect::<Vec<_>>())?;
    }
    let left_out = LeftOut::list([
        (color.len() - paired.len(), format!("without an image in {DEPTH}")),
        (depth.len() - paired.len(), format!("without an image in {COLOR}")),
        (paired.len() - frames.len(), format!("without a camera in {CAMERAS}")),
    ]);
    let list = FrameList {
        name: folder_name(path),
        format: Format::ArkitScenes,
        frames: frames.into_iter().map(|(_, frame)| frame).collect(),
        left_out,
        states_poses,
        stored_color: None,
        files: Box::new(PlainFiles { depth_scale: DepthScale::MILLIMETRES.or_of(settings), _extracted: None }),
    };
    FrameListScene::new(list, settings)
}

/// Makes the list of frames.
struct ListReader<'a> {
    /// Sorted by time.
    poses: Vec<TimedPose>,
    times: Vec<f64>,
    stated: StatedPoses,
    has_own_camera: bool,
    trajectory: PathBuf,
    folder: &'a Path,
}

impl ListReader<'_> {
    /// Checks that a pose of the trajectory is that of any frame. Both are sorted by time.
    fn require_common_time(&self, image_times: &[f64]) -> Result<(), DatasetError> {
        match image_times.iter().any(|seconds| self.pose_at(*seconds).is_some()) {
            true => Ok(()),
            false => Err(no_common_time(&self.trajectory, &self.times, image_times)),
        }
    }

    /// Returns the pose of a frame, if there is one near its time.
    fn pose_at(&self, seconds: f64) -> Option<&TimedPose> {
        self.poses.get(nearest_time(&self.times, seconds, MAX_SECONDS_APART)?)
    }

    /// Returns a frame; `None` if it has no camera.
    fn frame(&self, name: &str, seconds: f64) -> Result<Option<ListedFrame>, DatasetError> {
        let file = |part: &str| self.folder.join(part).join(name);
        let (camera, camera_place) = match self.camera_path(name, seconds) {
            Some(path) => (read_camera(&path)?, path),
            // Replaced when the frame is read.
            None if self.has_own_camera => {
                let place = self.folder.join(CAMERAS);
                let any = Intrinsics { fx: 1.0, fy: 1.0, cx: 0.0, cy: 0.0, width: 1, height: 1 };
                (Camera::pinhole(any, &place)?, place)
            }
            None => return Ok(None),
        };
        let pose = self.pose_at(seconds);
        let pose_place = match pose {
            Some(pose) => PathBuf::from(format!("{}: line {}", self.trajectory.display(), pose.line)),
            None => self.trajectory.clone(),
        };
        let world_from_camera = match pose {
            Some(pose) => {
                let stated = Pose::from_quaternion(pose.translation, DQuat::from_scaled_axis(pose.rotation));
                self.stated.pose(stated, || pose_place.clone())?
            }
            None => None,
        };
        Ok(Some(ListedFrame {
            name: name.trim_end_matches(".png").to_owned(),
            timestamp: Duration::try_from_secs_f64(seconds).ok(),
            color: file(COLOR),
            depth: file(DEPTH),
            confidence: Some(file(CONFIDENCE)).filter(|path| is_there(path)),
            camera,
            world_from_camera,
            pose_place,
            camera_place,
        }))
    }

    /// Returns the camera's file of the same time, or a millisecond off.
    fn camera_path(&self, name: &str, seconds: f64) -> Option<PathBuf> {
        let (video, _) = name.trim_end_matches(".png").rsplit_once('_')?;
        let same = name.trim_end_matches(".png").to_owned();
        let near = [-0.001, 0.001].map(|offset| format!("{video}_{:.3}", seconds + offset));
        let paths = std::iter::once(same).chain(near).map(|stem| self.folder.join(CAMERAS).join(stem + ".pincam"));
        paths.into_iter().find(|path| is_there(path))
    }
}

/// Returns the time in a file name, seconds.
fn seconds_of(name: &str) -> Option<f64> {
    let (_, seconds) = name.trim_end_matches(".png").rsplit_once('_')?;
    seconds.parse().ok().filter(|seconds: &f64| seconds.is_finite())
}

/// Reads a `.pincam`.
fn read_camera(path: &Path) -> Result<Camera, DatasetError> {
    let what = "camera intrinsics file";
    let text = read_text_with_numbers(path, what, MAX_CAMERA_BYTES)?;
    let numbers: Option<Vec<f64>> = text.split_whitespace().map(|word| word.parse().ok()).collect();
    let numbers = numbers.and_then(|numbers| <[f64; 6]>::try_from(numbers).ok());
    let [width, height, fx, fy, cx, cy] = numbers.ok_or_else(|| DatasetError::Text {
        path: path.to_owned(),
        what,
        found: shortened(text.trim()),
        expected: "6 numbers: width height fx fy cx cy",
    })?;
    let [fx, fy, cx, cy] = [fx, fy, cx, cy].map(|number| number as f32);
    // Negative numbers and NaN become 0, which is refused as a size.
    Camera::pinhole(Intrinsics { fx, fy, cx, cy, width: width as usize, height: height as usize }, path)
}

/// Reads the trajectory, sorted by time.
fn read_trajectory(path: &Path) -> Result<Vec<TimedPose>, DatasetError> {
    let text = read_text_with_numbers(path, "camera trajectory", MAX_TRAJECTORY_BYTES)?;
    let lines = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
    let mut poses: Vec<TimedPose> = lines.map(|line| TimedPose::parse(path, line)).collect::<Result<_, _>>()?;
    poses.sort_by(|a, b| a.seconds.total_cmp(&b.seconds));
    Ok(poses)
}

/// Returns the folder with the frames: the path, or `<video>_frames` in it, as in 3DOD.
fn frames_folder(path: &Path) -> PathBuf {
    let inner = path.join(format!("{}_frames", folder_name(path)));
    if inner.is_dir() { inner } else { path.to_owned() }
}

/// Returns the required parts of a scene, each with true if the folder has it.
pub(crate) fn parts(path: &Path) -> Vec<(&'static str, bool)> {
    let folder = frames_folder(path);
    [("lowres_wide/", COLOR), ("lowres_depth/", DEPTH)].map(|(part, name)| (part, folder.join(name).is_dir())).to_vec()
}

/// Returns true if a folder has all required parts.
pub(crate) fn looks_like(path: &Path) -> bool {
    parts(path).iter().all(|(_, is_present)| *is_present)
}
