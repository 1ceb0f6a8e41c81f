//! Stray Scanner: `depth/N.png` (millimetres, 256x192) or `.npy`, `confidence/N.png` (0 to 2), `odometry.csv`,
//! `camera_matrix.csv`, and colour as `rgb.mp4`, or as images extracted from it to `rgb/` or `color/`.
//!
//! Poses are camera-to-world with the axes of OpenCV, in metres. The camera is that of the video's full resolution: the one
//! of a frame in `odometry.csv`, which recordings since 2026 have, otherwise `camera_matrix.csv`.

mod odometry;
mod video;

use crate::decode::image_size;
use crate::depth_file::{DEPTH_FILE_NAMES, DEPTH_SUFFIXES};
use crate::depth_scale::DepthScale;
use crate::error::COLOR_IMAGE;
use crate::files::is_there;
use crate::frame_list::{FrameList, FrameListScene, ListedFrame, PlainFiles, StatedPoses};
use crate::listing::{NamePattern, NumberedFile, folder_name, has_numbered_files, no_frames_in, numbered_files};
use crate::own_camera::has_shape;
use crate::scene::LeftOut;
use crate::text::PinholeMatrix;
use crate::undistort::Camera;
use crate::{DatasetError, DatasetSettings, Format};
use odometry::{Odometry, OdometryLine};
use splatseg_geometry::{CameraAxes, Intrinsics};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Layout, for messages.
pub(crate) const LAYOUT: &str = "odometry.csv, camera_matrix.csv, depth/000000.png, rgb.mp4 (or images in rgb/) and confidence/ (optional): Stray Scanner";

const ODOMETRY: &str = "odometry.csv";
const MATRIX: &str = "camera_matrix.csv";
const VIDEO: &str = "rgb.mp4";
const DEPTH_FOLDER: &str = "depth";
/// Folders of extracted images.
const COLOR_FOLDERS: [&str; 2] = ["rgb", "color"];
const COLOR: NamePattern = NamePattern { prefix: "", suffixes: &[".png", ".jpg", ".jpeg"] };
const DEPTH: NamePattern = NamePattern { prefix: "", suffixes: DEPTH_SUFFIXES };
const CONFIDENCE: NamePattern = NamePattern { prefix: "", suffixes: &[".png"] };

/// Millimetres in every file, as the app's own programs read them.
const DEPTH_SCALE: DepthScale = DepthScale::of_every_number(1000.0);

/// Usual size of the video, `(width, height)`.
const VIDEO_SIZE: (usize, usize) = (1920, 1440);
/// A principal point is less than this from the centre of its image, in image widths.
const MAX_OFF_CENTER: f64 = 0.1;

/// Lists the frames. Decodes the video with `ffmpeg` if there are no images. Uses only `fx` to `cy`, `depth_scale` and those
/// about poses of `settings`.
///
/// # Errors
/// If colour, depth or a camera is missing, no frame has colour and depth, a text file is damaged, or all lines of
/// `odometry.csv` are of other frames.
pub(crate) fn open(path: &Path, settings: &DatasetSettings) -> Result<FrameListScene, DatasetError> {
    settings.validate()?;
    let depth_folder = path.join(DEPTH_FOLDER);
    let depth = numbered_files(&depth_folder, DEPTH)?;
    let first = depth.first().ok_or_else(|| no_frames_in(&depth_folder, DEPTH_FILE_NAMES))?;
    let odometry = Odometry::read(&path.join(ODOMETRY))?;
    let matrix_path = path.join(MATRIX);
    let matrix = if is_there(&matrix_path) { Some(odometry::read_matrix(&matrix_path)?) } else { None };
    let video = path.join(VIDEO);
    let has_images = |name: &&&str| has_numbered_files(&path.join(name), COLOR);
    let folder = COLOR_FOLDERS.iter().find(has_images);
    // A folder may be left of an extraction that failed.
    let empty = || COLOR_FOLDERS.iter().find(|name| path.join(name).is_dir() && !is_there(&video));
    let (color, extracted, video_size) = match folder.or_else(empty) {
        Some(name) => (path.join(name), None, None),
        None => {
            let (extracted, size) = video::extract("ffmpeg", &video, crate::depth_file::depth_size(&first.path)?)?;
            (extracted.path().to_owned(), Some(extracted), Some(size))
        }
    };
    let images = numbered_files(&color, COLOR)?;
    let Some(first) = images.first() else { return Err(no_frames_in(&color, "<number>.jpg or .png")) };
    let color_size = video_size.map_or_else(|| image_size(&first.path, COLOR_IMAGE), Ok)?;
    let reader = ListReader {
        odometry: &odometry,
        matrix: matrix.as_ref().map(|matrix| (matrix, matrix_path.as_path())),
        odometry_path: path.join(ODOMETRY),
        color_size,
        has_own_camera: settings.fx.is_some(),
        scene: path,
        poses: StatedPoses::camera_to_world(CameraAxes::Optical, settings),
    };
    let (frames, left_out) = frames_of(path, images, depth, &reader)?;
    let depth_scale = DEPTH_SCALE.or_of(settings);
    let files = Box::new(PlainFiles { depth_scale, _extracted: extracted });
    let (name, states_poses) = (folder_name(path), true);
    let list =
        FrameList { name, format: Format::Stray, frames, left_out, states_poses, stored_color: video_size, files };
    FrameListScene::new(list, settings)
}

/// Pairs images by number.
fn frames_of(
    path: &Path,
    images: Vec<NumberedFile>,
    depth: Vec<NumberedFile>,
    reader: &ListReader<'_>,
) -> Result<(Vec<ListedFrame>, Vec<LeftOut>), DatasetError> {
    let by_number = |files: Vec<NumberedFile>| -> BTreeMap<u64, PathBuf> {
        files.into_iter().map(|file| (file.number, file.path)).collect()
    };
    let confidence_folder = path.join("confidence");
    let confidence =
        if confidence_folder.is_dir() { numbered_files(&confidence_folder, CONFIDENCE)? } else { Vec::new() };
    let (mut depth, confidence) = (by_number(depth), by_number(confidence));
    let (mut frames, mut without_depth) = (Vec::new(), 0);
    for image in images {
        match depth.remove(&image.number) {
            Some(depth) => frames.push(reader.frame(image, depth, &confidence)?),
            None => without_depth += 1,
        }
    }
    if frames.is_empty() {
        return Err(DatasetError::Field {
            path: path.to_owned(),
            field: "frames".to_owned(),
            found: format!("{without_depth} colour images, none with depth of the same number"),
            expected: "colour and depth of the same number".to_owned(),
        });
    }
    reader.require_common_frames(&frames)?;
    let left_out = LeftOut::list([
        (without_depth, "without a depth image of the same number".to_owned()),
        (depth.len(), "without a colour image of the same number".to_owned()),
    ]);
    Ok((frames, left_out))
}

/// Makes the list of frames.
struct ListReader<'a> {
    odometry: &'a Odometry,
    odometry_path: PathBuf,
    matrix: Option<(&'a PinholeMatrix, &'a Path)>,
    /// Size of the images, or of the video that they are from, `(width, height)`.
    color_size: (usize, usize),
    /// The settings give a camera, so none has to be stated.
    has_own_camera: bool,
    scene: &'a Path,
    poses: StatedPoses,
}

impl ListReader<'_> {
    fn frame(
        &self,
        image: NumberedFile,
        depth: PathBuf,
        confidence: &BTreeMap<u64, PathBuf>,
    ) -> Result<ListedFrame, DatasetError> {
        let line = self.odometry.line(image.number);
        let place = match line {
            Some(line) => PathBuf::from(format!("{}: line {}", self.odometry_path.display(), line.number)),
            None => self.odometry_path.clone(),
        };
        let world_from_camera = match line {
            Some(line) => self.poses.pose(line.pose, || place.clone())?,
            None => None,
        };
        let camera_place = match (line.and_then(|line| line.camera), self.matrix) {
            (None, Some((_, path))) => path.to_owned(),
            _ => place.clone(),
        };
        Ok(ListedFrame {
            name: image.stem,
            timestamp: line.and_then(|line| Duration::try_from_secs_f64(line.seconds).ok()),
            color: image.path,
            depth,
            confidence: confidence.get(&image.number).cloned(),
            camera: self.camera(line, &camera_place)?,
            world_from_camera,
            pose_place: place,
            camera_place,
        })
    }

    /// Checks that `odometry.csv` has a line for any frame, unless it has none at all.
    fn require_common_frames(&self, frames: &[ListedFrame]) -> Result<(), DatasetError> {
        let numbers = || frames.iter().filter_map(|frame| frame.name.parse().ok());
        let Some((first, last)) = self.odometry.range() else { return Ok(()) };
        if numbers().any(|number| self.odometry.line(number).is_some()) {
            return Ok(());
        }
        Err(DatasetError::Field {
            path: self.odometry_path.clone(),
            field: "frames".to_owned(),
            found: format!("{first} to {last}"),
            expected: format!(
                "those of the images, {} to {}; with only its first line, the scene has no poses",
                numbers().min().unwrap_or(0),
                numbers().max().unwrap_or(0)
            ),
        })
    }

    fn camera(&self, line: Option<&OdometryLine>, place: &Path) -> Result<Camera, DatasetError> {
        let stated = line.and_then(|line| line.camera).or(self.matrix.map(|(matrix, _)| *matrix));
        let matrix = match stated {
            Some(matrix) => matrix,
            // Replaced when the frame is read.
            None if self.has_own_camera => PinholeMatrix { fx: 1.0, fy: 1.0, cx: 0.0, cy: 0.0 },
            None => return Err(crate::own_camera::no_camera(self.scene, MATRIX, &[])),
        };
        let (width, height) = self.size_of(&matrix);
        let PinholeMatrix { fx, fy, cx, cy } = matrix;
        Camera::pinhole(Intrinsics { fx, fy, cx, cy, width, height }, place)
    }

    /// Returns the size of the images that a matrix belongs to: that of the images, or of their video, if the principal point
    /// is near their centre, otherwise the usual one of videos.
    fn size_of(&self, matrix: &PinholeMatrix) -> (usize, usize) {
        let is_center = |(width, _): (usize, usize)| (f64::from(matrix.cx) / width as f64 - 0.5).abs() < MAX_OFF_CENTER;
        let is_of_video =
            !is_center(self.color_size) && is_center(VIDEO_SIZE) && has_shape(self.color_size, VIDEO_SIZE);
        if is_of_video { VIDEO_SIZE } else { self.color_size }
    }
}

/// Returns the required parts of a recording, each with true if the folder has it.
pub(crate) fn parts(path: &Path) -> Vec<(&'static str, bool)> {
    let odometry = (ODOMETRY, path.join(ODOMETRY).is_file());
    if !odometry.1 {
        return vec![odometry];
    }
    let has_color = path.join(VIDEO).is_file() || COLOR_FOLDERS.iter().any(|name| path.join(name).is_dir());
    vec![odometry, ("depth/", path.join(DEPTH_FOLDER).is_dir()), ("rgb.mp4 or rgb/", has_color)]
}

/// Returns true if a folder has all required parts.
pub(crate) fn looks_like(path: &Path) -> bool {
    parts(path).iter().all(|(_, is_present)| *is_present)
}
