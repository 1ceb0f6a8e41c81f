//! Plain folders with `color/`, `depth/`, `camera.json` and `poses.txt`, described in `docs/FOLDER_FORMAT.md`.
//!
//! A frame is a colour and a depth image with the same name apart from the extension. Poses are assigned to the colour
//! images in order. If the images are named by time and the poses have times too, each image gets the pose nearest in
//! time.

mod camera_file;
mod names;
mod poses;

use crate::decode::{COLOR_IMAGE, image_size, read_color, read_depth};
use crate::listing::folder_name;
use crate::scene::{FramePart, FrameParts, LeftOut, entry, require_registered};
use crate::tum::nearest_time;
use crate::undistort::Undistortion;
use crate::{DatasetError, Format, RecordedFrame, Scene};
use camera_file::FolderCamera;
use names::{Images, seconds_of};
use poses::{ListedPose, read_poses};
use splatseg_geometry::{Pose, SegmentMap};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::time::Duration;

/// Layout of a plain folder, for messages.
pub(crate) const LAYOUT: &str =
    "color/<name>.jpg or .png, depth/<name>.png, ..., camera.json, poses.txt (docs/FOLDER_FORMAT.md)";

const COLOR_FOLDER: &str = "color";
const DEPTH_FOLDER: &str = "depth";
const CAMERA_FILE: &str = "camera.json";
const POSES: &str = "poses.txt";
/// Maximum time between an image and its pose, seconds.
const MAX_SECONDS_APART: f64 = 0.02;

/// A frame with all its parts.
#[derive(Clone, Debug)]
struct FolderFrame {
    name: String,
    timestamp: Option<Duration>,
    color: PathBuf,
    depth: PathBuf,
    world_from_camera: Pose,
    /// Line number of the pose, from 1.
    line: usize,
}

/// A recording in a plain folder. It has no ground truth segments.
///
/// If the lens distorts, colour and depth are undistorted, keeping the intrinsics.
#[derive(Debug)]
pub struct FolderScene {
    name: String,
    folder: PathBuf,
    frames: Vec<FolderFrame>,
    camera: FolderCamera,
    /// Created for the first frame whose images have the camera's size.
    undistortion: OnceLock<Option<Undistortion>>,
    left_out: Vec<LeftOut>,
}

impl FolderScene {
    /// Lists a folder's images and reads its camera and all poses. Frames without depth or pose are skipped.
    ///
    /// # Errors
    /// If a part is missing or damaged, no frame has all parts, the number of poses differs from that of the colour
    /// images, a pose is not a rigid transform, or the first image does not have the camera's size.
    pub fn open(folder: &Path) -> Result<Self, DatasetError> {
        let camera = FolderCamera::read(&folder.join(CAMERA_FILE))?;
        let color = Images::list(&folder.join(COLOR_FOLDER), &["jpg", "jpeg", "png"])?;
        let depth = Images::list(&folder.join(DEPTH_FOLDER), &["png"])?;
        for (part, images, expected) in
            [(COLOR_FOLDER, &color, "<name>.jpg, .jpeg or .png"), (DEPTH_FOLDER, &depth, "<name>.png")]
        {
            if images.images.is_empty() {
                return Err(DatasetError::NoFrames { path: folder.join(part), expected });
            }
        }
        let poses = poses_of(&color, read_poses(&folder.join(POSES))?, folder)?;
        let (frames, left_out) = frames_of(&color, &depth, &poses);
        if frames.is_empty() {
            return Err(no_frames(folder, &color, &depth));
        }
        let scene = Self {
            name: folder_name(folder),
            folder: folder.to_owned(),
            frames,
            camera,
            undistortion: OnceLock::new(),
            left_out,
        };
        // A wrong size in camera.json is reported once, not for every frame. A damaged image is reported when its frame
        // is read.
        if let Some(Ok((path, size))) = scene.frames.first().map(|first| {
            let size = image_size(&first.color, COLOR_IMAGE)?;
            Ok::<_, DatasetError>((&first.color, size))
        }) {
            scene.require_camera_size(path, size)?;
        }
        Ok(scene)
    }

    fn require_camera_size(&self, path: &Path, found: (usize, usize)) -> Result<(), DatasetError> {
        let expected = (self.camera.intrinsics.width, self.camera.intrinsics.height);
        if found == expected {
            return Ok(());
        }
        let (path, what, expected_from) = (path.to_owned(), COLOR_IMAGE, CAMERA_FILE);
        Err(DatasetError::SizesDiffer { path, what, found, expected, expected_from })
    }

    /// Returns the undistortion map; `None` if the lens does not distort. Call only once an image of the camera's size
    /// exists, because the map takes memory.
    fn undistortion(&self) -> Result<Option<&Undistortion>, DatasetError> {
        if let Some(known) = self.undistortion.get() {
            return Ok(known.as_ref());
        }
        let path = self.folder.join(CAMERA_FILE);
        let map = Undistortion::new(&self.camera.intrinsics, &self.camera.distortion, &path)?;
        Ok(self.undistortion.get_or_init(|| map).as_ref())
    }
}

/// Assigns a pose to every colour image, `None` if no pose was measured near its time.
fn poses_of(
    color: &Images,
    mut poses: Vec<ListedPose>,
    folder: &Path,
) -> Result<Vec<Option<ListedPose>>, DatasetError> {
    let pose_times: Option<Vec<f64>> = poses.iter().map(|pose| pose.seconds).collect();
    if let (Some(times), Some(mut pose_times), false) = (color.times(), pose_times, poses.is_empty()) {
        poses.sort_by(|a, b| a.seconds.unwrap_or(0.0).total_cmp(&b.seconds.unwrap_or(0.0)));
        pose_times.sort_by(f64::total_cmp);
        let pose_at = |time: f64| poses.get(nearest_time(&pose_times, time, MAX_SECONDS_APART)?).copied();
        return Ok(times.into_iter().map(pose_at).collect());
    }
    if poses.len() != color.images.len() {
        return Err(DatasetError::Field {
            path: folder.join(POSES),
            field: "number of poses".to_owned(),
            found: poses.len().to_string(),
            expected: format!("{}, as {COLOR_FOLDER}/ has {} images", color.images.len(), color.images.len()),
        });
    }
    Ok(poses.into_iter().map(Some).collect())
}

/// Returns the frames that have all parts, and the counts of those that do not.
fn frames_of(color: &Images, depth: &Images, poses: &[Option<ListedPose>]) -> (Vec<FolderFrame>, Vec<LeftOut>) {
    let mut depth_files: BTreeMap<&str, &Path> =
        depth.images.iter().map(|image| (image.stem.as_str(), image.path.as_path())).collect();
    let (mut without_depth, mut without_time, mut lost) = (0, 0, 0);
    let mut frames = Vec::new();
    for (image, pose) in color.images.iter().zip(poses) {
        let Some(depth) = depth_files.remove(image.stem.as_str()) else {
            without_depth += 1;
            continue;
        };
        let Some(pose) = pose else {
            without_time += 1;
            continue;
        };
        let Some(world_from_camera) = pose.world_from_camera else {
            lost += 1;
            continue;
        };
        let seconds = seconds_of(&image.stem).or(pose.seconds);
        frames.push(FolderFrame {
            name: image.stem.clone(),
            timestamp: seconds.and_then(|seconds| Duration::try_from_secs_f64(seconds).ok()),
            color: image.path.clone(),
            depth: depth.to_owned(),
            world_from_camera,
            line: pose.line,
        });
    }
    let left_out = LeftOut::list([
        (without_depth, "without a depth image of the same name".to_owned()),
        (depth_files.len(), "without a colour image of the same name".to_owned()),
        (without_time, format!("without a pose within {MAX_SECONDS_APART} s of their time")),
        (lost, format!("whose pose in {POSES} is NaN or infinite: tracking was lost")),
        (color.unreadable + depth.unreadable, "with names that are not UTF-8".to_owned()),
    ]);
    (frames, left_out)
}

/// Returns the error for a folder in which no frame has all parts.
fn no_frames(folder: &Path, color: &Images, depth: &Images) -> DatasetError {
    let example = |part: &str, images: &Images| {
        let name = images.images.first().and_then(|image| image.path.file_name()).unwrap_or_default();
        format!("{part}/{}", name.to_string_lossy())
    };
    DatasetError::Field {
        path: folder.to_owned(),
        field: "frames".to_owned(),
        found: format!(
            "none with colour, depth and a pose (the first images are {} and {})",
            example(COLOR_FOLDER, color),
            example(DEPTH_FOLDER, depth)
        ),
        expected: format!(
            "colour and depth of the same name, and for each a pose in {POSES}, within {MAX_SECONDS_APART} s if images \
             are named after their times"
        ),
    }
}

/// Returns the required parts of a folder, each with true if present.
pub(crate) fn parts(path: &Path) -> Vec<(&'static str, bool)> {
    vec![
        ("color/", path.join(COLOR_FOLDER).is_dir()),
        ("depth/", path.join(DEPTH_FOLDER).is_dir()),
        (CAMERA_FILE, path.join(CAMERA_FILE).is_file()),
        (POSES, path.join(POSES).is_file()),
    ]
}

/// Returns true if a folder has all parts.
pub(crate) fn looks_like(path: &Path) -> bool {
    parts(path).iter().all(|(_, is_present)| *is_present)
}

impl Scene for FolderScene {
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
        let mut depth = read_depth(&frame.depth, self.camera.units_per_metre)?;
        let mut color = read_color(&frame.color)?;
        self.require_camera_size(&frame.color, color.size())?;
        require_registered(&color, &depth, &frame.depth)?;
        if let Some(undistortion) = self.undistortion()? {
            color = undistortion.color(&color, &frame.color)?;
            depth = undistortion.depth(&depth, &frame.depth)?;
        }
        let FolderFrame { name, timestamp, world_from_camera, .. } = frame.clone();
        let intrinsics = self.camera.intrinsics;
        FrameParts { name, timestamp, color, depth, intrinsics, world_from_camera: Some(world_from_camera) }
            .into_frame()
    }

    fn has_ground_truth(&self) -> bool {
        false
    }

    fn read_ground_truth(&self, _index: usize) -> Result<Option<SegmentMap>, DatasetError> {
        Ok(None)
    }

    fn format(&self) -> Option<Format> {
        Some(Format::Folder)
    }

    fn left_out(&self) -> &[LeftOut] {
        &self.left_out
    }

    fn file_of(&self, index: usize, part: FramePart) -> PathBuf {
        match (self.frames.get(index), part) {
            (Some(frame), FramePart::Depth) => frame.depth.clone(),
            (Some(frame), FramePart::Pose) => poses::place(&self.folder.join(POSES), frame.line),
            (_, FramePart::Intrinsics) => self.folder.join(CAMERA_FILE),
            (None, _) => self.folder.clone(),
        }
    }
}
