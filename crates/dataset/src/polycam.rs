//! Polycam's raw data: `keyframes/` with `images/`, `depth/`, `confidence/` and `cameras/`, one file of each kind for a
//! frame, named by its time, and `corrected_images/` and `corrected_cameras/` once the app has optimised the poses.
//!
//! Images are 1024x768, depth is 256x192 in millimetres. Confidence is 0, 54 or 255. Poses are camera-to-world with the axes
//! of OpenGL, in metres; the world's y axis is up. nerfstudio's `process_data polycam` moves that axis to z, and the order of
//! a pose's rows with it; here the world stays as it is.

use crate::decode::MAX_PIXELS;
use crate::depth_scale::DepthScale;
use crate::files::is_there;
use crate::frame_list::{FrameList, FrameListScene, ListedFrame, PlainFiles, StatedPoses};
use crate::listing::{NamePattern, NumberedFile, folder_name, has_numbered_files, no_frames_in, numbered_files};
use crate::scene::LeftOut;
use crate::stamps::{Stamp, TimeScale};
use crate::text::read_json;
use crate::undistort::Camera;
use crate::{DatasetError, DatasetSettings, Format};
use serde::Deserialize;
use splatseg_geometry::{CameraAxes, Intrinsics, Pose};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Layout, for messages.
pub(crate) const LAYOUT: &str = "keyframes/ with images/ (or corrected_images/), depth/, cameras/ (or corrected_cameras/) and confidence/ (optional): \
                                 Polycam's raw data";

const IMAGE: NamePattern = NamePattern { prefix: "", suffixes: &[".jpg", ".jpeg", ".png"] };
const DEPTH: NamePattern = NamePattern { prefix: "", suffixes: &[".png"] };
const CAMERA: NamePattern = NamePattern { prefix: "", suffixes: &[".json"] };
const KEYFRAMES: &str = "keyframes";
const MAX_CAMERA_BYTES: u64 = 64 << 10;

/// A camera file. Matrices are rows and columns of camera-to-world.
#[derive(Debug, Deserialize)]
struct CameraFile {
    fx: f32,
    fy: f32,
    cx: f32,
    cy: f32,
    width: f64,
    height: f64,
    t_00: f64,
    t_01: f64,
    t_02: f64,
    t_03: f64,
    t_10: f64,
    t_11: f64,
    t_12: f64,
    t_13: f64,
    t_20: f64,
    t_21: f64,
    t_22: f64,
    t_23: f64,
}

impl CameraFile {
    fn row_major(&self) -> [f64; 16] {
        let Self { t_00, t_01, t_02, t_03, t_10, t_11, t_12, t_13, t_20, t_21, t_22, t_23, .. } = *self;
        [t_00, t_01, t_02, t_03, t_10, t_11, t_12, t_13, t_20, t_21, t_22, t_23, 0.0, 0.0, 0.0, 1.0]
    }

    fn camera(&self, path: &Path) -> Result<Camera, DatasetError> {
        let side = |side: f64| if (0.0..=MAX_PIXELS as f64).contains(&side) { side as usize } else { 0 };
        let Self { fx, fy, cx, cy, width, height, .. } = *self;
        Camera::pinhole(Intrinsics { fx, fy, cx, cy, width: side(width), height: side(height) }, path)
    }
}

/// The folders of a recording.
struct Folders {
    images: PathBuf,
    depth: PathBuf,
    cameras: PathBuf,
    confidence: PathBuf,
}

impl Folders {
    /// Chooses the corrected images, depth and cameras where there are any.
    fn of(path: &Path) -> Self {
        let keyframes = keyframes(path);
        let corrected = |name: &str, pattern: NamePattern| {
            let corrected = keyframes.join(format!("corrected_{name}"));
            if has_numbered_files(&corrected, pattern) { corrected } else { keyframes.join(name) }
        };
        Self {
            images: corrected("images", IMAGE),
            depth: corrected("depth", DEPTH),
            cameras: corrected("cameras", CAMERA),
            confidence: keyframes.join("confidence"),
        }
    }
}

/// Lists the frames and reads their cameras. Uses only `fx` to `cy`, `depth_scale` and those about poses of `settings`.
///
/// # Errors
/// If there are no images, depth or cameras, or a camera is damaged.
pub(crate) fn open(path: &Path, settings: &DatasetSettings) -> Result<FrameListScene, DatasetError> {
    settings.validate()?;
    let folders = Folders::of(path);
    let images = numbered_files(&folders.images, IMAGE)?;
    if images.is_empty() {
        return Err(no_frames_in(&folders.images, "<time>.jpg or .png"));
    }
    for (folder, pattern, expected) in
        [(&folders.depth, DEPTH, "<time>.png"), (&folders.cameras, CAMERA, "<time>.json")]
    {
        if !has_numbered_files(folder, pattern) {
            return Err(no_frames_in(folder, expected));
        }
    }
    let times = times(&images, &folders.images)?;
    let poses = StatedPoses::camera_to_world(CameraAxes::OpenGl, settings);
    let (mut frames, mut without_depth, mut without_camera) = (Vec::new(), 0, 0);
    for (image, timestamp) in images.into_iter().zip(times) {
        let file = |folder: &Path, ending: &str| folder.join(format!("{}.{ending}", image.stem));
        let (depth, camera) = (file(&folders.depth, "png"), file(&folders.cameras, "json"));
        if !is_there(&depth) {
            without_depth += 1;
        } else if !is_there(&camera) {
            without_camera += 1;
        } else {
            let content: CameraFile = read_json(&camera, "camera file", MAX_CAMERA_BYTES)?;
            let confidence = Some(file(&folders.confidence, "png")).filter(|path| is_there(path));
            frames.push(ListedFrame {
                name: image.stem,
                timestamp,
                color: image.path,
                depth,
                confidence,
                camera: content.camera(&camera)?,
                world_from_camera: poses.pose(Pose::from_row_major(content.row_major()), || camera.clone())?,
                pose_place: camera.clone(),
                camera_place: camera,
            });
        }
    }
    if frames.is_empty() {
        return Err(DatasetError::Field {
            path: keyframes(path),
            field: "frames".to_owned(),
            found: format!("{without_depth} without depth and {without_camera} without a camera file"),
            expected: "files of the same name for each frame".to_owned(),
        });
    }
    let left_out = LeftOut::list([
        (without_depth, "without a depth image of the same name".to_owned()),
        (without_camera, "without a camera file of the same name".to_owned()),
    ]);
    let files = Box::new(PlainFiles { depth_scale: DepthScale::MILLIMETRES.or_of(settings), _extracted: None });
    let list = FrameList {
        name: scene_name(path),
        format: Format::Polycam,
        frames,
        left_out,
        states_poses: true,
        stored_color: None,
        files,
    };
    FrameListScene::new(list, settings)
}

/// Returns the times in the names of images, whose unit follows from their steps.
fn times(images: &[NumberedFile], folder: &Path) -> Result<Vec<Option<Duration>>, DatasetError> {
    let stamps: Vec<_> = images.iter().filter_map(|image| Stamp::parse(&image.stem)).collect();
    let scale = TimeScale::of(&stamps, None);
    let time = |image: &NumberedFile| {
        let Some(stamp) = Stamp::parse(&image.stem) else { return Ok(None) };
        let seconds = scale.seconds(stamp, (folder, &image.stem))?;
        Ok(Duration::try_from_secs_f64(seconds).ok())
    };
    images.iter().map(time).collect()
}

fn keyframes(path: &Path) -> PathBuf {
    let inner = path.join(KEYFRAMES);
    if inner.is_dir() { inner } else { path.to_owned() }
}

/// Returns the name of the folder with the keyframes.
fn scene_name(path: &Path) -> String {
    let name = folder_name(path);
    match path.canonicalize() {
        Ok(full) if name == KEYFRAMES => full.parent().map_or(name, folder_name),
        _ => name,
    }
}

/// Returns the required parts of a recording, each with true if the folder has it.
pub(crate) fn parts(path: &Path) -> Vec<(&'static str, bool)> {
    let keyframes = keyframes(path);
    let has = |names: [&str; 2]| names.iter().any(|name| keyframes.join(name).is_dir());
    let cameras = ("keyframes/cameras/ or corrected_cameras/", has(["cameras", "corrected_cameras"]));
    if !cameras.1 {
        // Other recordings have folders of the other names, too.
        return vec![cameras];
    }
    vec![
        cameras,
        ("keyframes/images/ or corrected_images/", has(["images", "corrected_images"])),
        ("keyframes/depth/", has(["depth", "corrected_depth"])),
    ]
}

/// Returns true if a folder has all required parts.
pub(crate) fn looks_like(path: &Path) -> bool {
    parts(path).iter().all(|(_, is_present)| *is_present)
}
