//! Plain folders with `color/`, `depth/`, `camera.json` and `poses.txt`, described in `docs/FOLDER_FORMAT.md`.
//!
//! A frame is a colour and a depth image with the same name apart from the extension. `poses.txt` is optional, and
//! `camera.json` too if the settings give a focal length. So is `corrections.txt`, with corrected poses.

mod assignment;
mod camera_file;
mod corrections;
mod frames;
mod names;
mod poses;
mod without_depth;

use crate::corrections::CorrectionList;
use crate::decode::{image_size, read_color};
use crate::depth_file::{DEPTH_ENDINGS, DEPTH_FILE_NAMES, read_depth};
use crate::error::COLOR_IMAGE;
use crate::files::is_there;
use crate::listing::{folder_name, no_frames_in};
use crate::own_camera::{GuessedCamera, OwnCamera, ReadColor, camera_place, no_camera};
use crate::recorded_poses::{LOST, PoseCoverage};
use crate::scene::{FramePart, FrameParts, LeftOut, entry, require_registered};
use crate::undistort::Undistortion;
use crate::{CorrectedPose, DatasetError, DatasetSettings, Format, RecordedFrame, Scene};
use assignment::{MAX_SECONDS_APART, poses_of};
use camera_file::FolderCamera;
use corrections::read_corrections;
use frames::{FolderFrame, frames_of};
use names::{COLOR_FOLDER, DEPTH_FOLDER, Images, Twins};
pub use poses::{ListedPose, read_pose_list};
use splatseg_geometry::{Image, SegmentMap};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use tempfile::TempDir;
pub(crate) use without_depth::{IMAGES_LAYOUT, looks_like_images};

/// Layout of a plain folder, for messages.
pub(crate) const LAYOUT: &str = "color/<name>.jpg or .png, depth/<name>.png, .tiff, .npy, .exr or .pfm, ..., camera.json (or --fx), poses.txt (optional; docs/FOLDER_FORMAT.md)";

const CAMERA_FILE: &str = "camera.json";
const POSES: &str = "poses.txt";
const CORRECTIONS: &str = "corrections.txt";

/// A recording in a plain folder. It has no ground truth segments.
///
/// If the lens distorts, colour and depth are undistorted, keeping the intrinsics.
#[derive(Debug)]
pub struct FolderScene {
    name: String,
    /// The folder, or the video.
    folder: PathBuf,
    format: Format,
    frames: Vec<FolderFrame>,
    poses: PoseCoverage,
    corrections: CorrectionList,
    camera: FolderCamera,
    own_camera: Option<OwnCamera>,
    /// Source of the images' size, for messages.
    size_from: &'static str,
    /// Created for the first frame whose images have the camera's size.
    undistortion: OnceLock<Option<Undistortion>>,
    left_out: Vec<LeftOut>,
    sources: Vec<String>,
    /// The camera, if nothing describes it.
    guessed: Option<GuessedCamera>,
    /// Reads a colour image.
    read_color: ReadColor,
    /// The frames of a video, removed with this.
    extracted: Option<TempDir>,
}

impl FolderScene {
    /// Lists a folder's images and reads its camera and all poses. Frames without depth are skipped. Uses only `fx` to
    /// `cy` and `depth_scale` of `settings`.
    ///
    /// # Errors
    /// If a part is missing or damaged, no frame has colour and depth, the poses cannot be assigned to the colour images,
    /// a pose is not a rigid transform, or the first image does not have the camera's size.
    pub fn open(folder: &Path, settings: &DatasetSettings) -> Result<Self, DatasetError> {
        settings.validate()?;
        let own_camera = OwnCamera::from_settings(settings)?;
        let (color, depth) = list_images(folder)?;
        let camera = CameraSource::of(folder, &color, own_camera, settings)?;
        let list = folder.join(POSES);
        let has_list = is_there(&list);
        let listed =
            if has_list { poses_of(&color, read_pose_list(&list)?, &list)? } else { vec![None; color.images.len()] };
        let (frames, left_out) = frames_of(&color, &depth, &listed);
        let first = frames.first().ok_or_else(|| no_frames(folder, &color, &depth))?;
        let first_size = image_size(&first.color, COLOR_IMAGE).map(|size| (first.color.clone(), size));
        let (camera, size_from) = match camera {
            CameraSource::File(camera) => (camera, CAMERA_FILE),
            CameraSource::Settings(own) => (
                FolderCamera::without_file(own.intrinsics(size_of_images(&frames, color_size)?), settings),
                "the first image",
            ),
        };
        let list = folder.join(CORRECTIONS);
        let corrections =
            if is_there(&list) { read_corrections(&list, &color, &frames)? } else { CorrectionList::default() };
        let scene = Self {
            name: folder_name(folder),
            folder: folder.to_owned(),
            format: Format::Folder,
            poses: if has_list { coverage(&frames) } else { PoseCoverage::NONE },
            frames,
            corrections,
            camera,
            own_camera,
            size_from,
            undistortion: OnceLock::new(),
            left_out,
            sources: Vec::new(),
            guessed: None,
            read_color,
            extracted: None,
        };
        // A wrong size in camera.json is reported once, not for every frame. A damaged image is reported when its frame
        // is read.
        if let Ok((path, size)) = first_size {
            scene.require_camera_size(&path, size)?;
        }
        Ok(scene)
    }

    fn require_camera_size(&self, path: &Path, found: (usize, usize)) -> Result<(), DatasetError> {
        let expected = (self.camera.intrinsics.width, self.camera.intrinsics.height);
        if found == expected {
            return Ok(());
        }
        Err(DatasetError::SizesDiffer {
            path: path.to_owned(),
            what: COLOR_IMAGE,
            found,
            expected,
            expected_from: self.size_from,
        })
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

/// Source of a folder's camera.
enum CameraSource {
    /// The camera file, with intrinsics from the settings if they give any.
    File(FolderCamera),
    /// The settings alone.
    Settings(OwnCamera),
}

impl CameraSource {
    fn of(
        folder: &Path,
        color: &Images,
        own: Option<OwnCamera>,
        settings: &DatasetSettings,
    ) -> Result<Self, DatasetError> {
        let path = folder.join(CAMERA_FILE);
        match (is_there(&path), own) {
            (true, None) => Ok(Self::File(FolderCamera::read(&path, settings)?)),
            (true, Some(own)) => {
                let mut camera = FolderCamera::read(&path, settings)?;
                camera.intrinsics = own.intrinsics((camera.intrinsics.width, camera.intrinsics.height));
                Ok(Self::File(camera))
            }
            (false, Some(own)) => Ok(Self::Settings(own)),
            (false, None) => {
                let images: Vec<&Path> = color.images.iter().map(|image| image.path.as_path()).collect();
                Err(no_camera(folder, CAMERA_FILE, &images))
            }
        }
    }
}

/// Lists the colour and the depth images. There is at least one of each.
fn list_images(folder: &Path) -> Result<(Images, Images), DatasetError> {
    let list = |part: &str, endings: &[&str], twins, expected| {
        let images = Images::list(&folder.join(part), endings, twins)?;
        if images.images.is_empty() {
            return Err(no_frames_in(&folder.join(part), expected));
        }
        Ok(images)
    };
    let color = list(COLOR_FOLDER, &["jpg", "jpeg", "png"], Twins::Refused, "<name>.jpg, .jpeg or .png")?;
    Ok((color, list(DEPTH_FOLDER, DEPTH_ENDINGS, Twins::FirstEnding, DEPTH_FILE_NAMES)?))
}

/// Reads the `(width, height)` of a colour image.
type ReadSize = fn(&Path) -> Result<(usize, usize), DatasetError>;

fn color_size(path: &Path) -> Result<(usize, usize), DatasetError> {
    image_size(path, COLOR_IMAGE)
}

/// Returns the size of the first colour image that is not damaged. `read` reads that of one.
fn size_of_images(frames: &[FolderFrame], read: ReadSize) -> Result<(usize, usize), DatasetError> {
    let mut first_error = None;
    for frame in frames {
        match read(&frame.color) {
            Ok(size) => return Ok(size),
            Err(error) => first_error = first_error.or(Some(error)),
        }
    }
    Err(first_error.unwrap_or(DatasetError::NoFrames { path: COLOR_FOLDER.into(), expected: "an image" }))
}

/// Counts the frames without a pose.
fn coverage(frames: &[FolderFrame]) -> PoseCoverage {
    let without_time = frames.iter().filter(|frame| frame.pose.is_none()).count();
    let is_lost = |frame: &&FolderFrame| frame.pose.is_some_and(|pose| pose.world_from_camera.is_none());
    PoseCoverage::new(
        frames.len(),
        [
            (without_time, format!("without a pose within {MAX_SECONDS_APART} s of their time")),
            (frames.iter().filter(is_lost).count(), format!("whose pose in {POSES} {LOST}")),
        ],
    )
}

/// Returns the error for a folder in which no frame has colour and depth.
fn no_frames(folder: &Path, color: &Images, depth: &Images) -> DatasetError {
    let example = |part: &str, images: &Images| {
        let name = images.images.first().and_then(|image| image.path.file_name()).unwrap_or_default();
        format!("{part}/{}", name.to_string_lossy())
    };
    DatasetError::Field {
        path: folder.to_owned(),
        field: "frames".to_owned(),
        found: format!(
            "none with colour and depth (the first images are {} and {})",
            example(COLOR_FOLDER, color),
            example(DEPTH_FOLDER, depth)
        ),
        expected: "colour and depth of the same name".to_owned(),
    }
}

/// Returns the required parts of a folder, each with true if present, and the optional parts that are present.
pub(crate) fn parts(path: &Path) -> Vec<(&'static str, bool)> {
    let mut parts = vec![("color/", path.join(COLOR_FOLDER).is_dir()), ("depth/", path.join(DEPTH_FOLDER).is_dir())];
    parts.extend([(CAMERA_FILE, true), (POSES, true)].into_iter().filter(|(part, _)| path.join(part).is_file()));
    parts
}

/// Returns true if a folder has a camera file and poses.
pub(crate) fn is_whole(path: &Path) -> bool {
    path.join(CAMERA_FILE).is_file() && path.join(POSES).is_file()
}

/// Returns true if a folder has all required parts.
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
        let mut color = (self.read_color)(&frame.color)?;
        self.require_camera_size(&frame.color, color.size())?;
        let mut depth = match &frame.depth {
            Some(path) => read_depth(path, self.camera.depth_scale)?,
            None => Image::filled(color.width(), color.height(), 0.0),
        };
        let place = frame.depth.as_deref().unwrap_or(&frame.color);
        require_registered(&color, &depth, place)?;
        if let Some(undistortion) = self.undistortion()? {
            color = undistortion.color(&color, &frame.color)?;
            depth = undistortion.depth(&depth, place)?;
        }
        let FolderFrame { name, timestamp, pose, .. } = frame.clone();
        let intrinsics = self.camera.intrinsics;
        let world_from_camera = pose.and_then(|pose| pose.world_from_camera);
        FrameParts { name, timestamp, color, depth, intrinsics, world_from_camera }.into_frame()
    }

    fn has_poses(&self) -> bool {
        self.poses.has_poses()
    }

    fn without_pose(&self) -> &[LeftOut] {
        self.poses.without_pose()
    }

    fn corrections(&self, known_with: Range<usize>) -> Vec<CorrectedPose> {
        self.corrections.known_with(known_with)
    }

    fn has_ground_truth(&self) -> bool {
        false
    }

    fn read_ground_truth(&self, _index: usize) -> Result<Option<SegmentMap>, DatasetError> {
        Ok(None)
    }

    fn format(&self) -> Option<Format> {
        Some(self.format)
    }

    fn left_out(&self) -> &[LeftOut] {
        &self.left_out
    }

    fn guessed_camera(&self) -> Option<GuessedCamera> {
        self.guessed
    }

    fn sources(&self) -> &[String] {
        &self.sources
    }

    fn has_depth(&self) -> bool {
        self.format.has_depth()
    }

    fn file_of(&self, index: usize, part: FramePart) -> PathBuf {
        match (self.frames.get(index), part) {
            (Some(frame), FramePart::Depth) => frame.depth.as_ref().unwrap_or(&frame.color).clone(),
            (Some(frame), FramePart::Pose) => match frame.pose {
                Some(pose) => poses::place(&self.folder.join(POSES), pose.line),
                None => self.folder.join(POSES),
            },
            (_, FramePart::Intrinsics) => camera_place(self.own_camera.as_ref(), &self.folder.join(CAMERA_FILE)),
            (None, _) => self.folder.clone(),
        }
    }
}
