//! Images without depth: a folder of them, or the frames of a video.

use super::assignment::poses_of;
use super::camera_file::FolderCamera;
use super::frames::{FolderFrame, frames_without_depth};
use super::names::{COLOR_FOLDER, DEPTH_FOLDER, Images, Twins};
use super::{CAMERA_FILE, FolderScene, POSES, ReadSize, color_size, coverage, read_pose_list, size_of_images};
use crate::decode::read_color;
use crate::files::is_there;
use crate::listing::{all_names_in, folder_name, no_frames_in};
use crate::own_camera::{GuessedCamera, OwnCamera, ReadColor};
use crate::recorded_poses::PoseCoverage;
use crate::upright::{read_upright, upright_size};
use crate::{DatasetError, DatasetSettings, Format};
use std::path::Path;
use std::sync::OnceLock;
use tempfile::TempDir;

/// Layout of a folder of images, for messages.
pub(crate) const IMAGES_LAYOUT: &str = "images without depth, <name>.jpg or .png, in the folder or in color/; camera.json and poses.txt (optional); depth is predicted (--depth-weights)";

const ENDINGS: [&str; 3] = ["jpg", "jpeg", "png"];
const EXPECTED: &str = "<name>.jpg, .jpeg or .png";

/// Returns true if a folder has images, in itself or in `color/`, and no depth.
pub(crate) fn looks_like_images(path: &Path) -> bool {
    if path.join(COLOR_FOLDER).is_dir() {
        return !path.join(DEPTH_FOLDER).exists();
    }
    let names: Vec<String> = all_names_in(path).into_iter().map(|name| name.to_string_lossy().to_lowercase()).collect();
    let is_image = |name: &String| name.rsplit_once('.').is_some_and(|(_, ending)| ENDINGS.contains(&ending));
    names.iter().any(is_image) && !names.iter().any(|name| name.contains("depth"))
}

impl FolderScene {
    /// Lists a folder of images without depth, in the folder itself or in `color/`, with its camera and poses if there are
    /// any. Without either, images are turned as they say.
    ///
    /// # Errors
    /// As [`Self::open`].
    pub(crate) fn of_images(folder: &Path, settings: &DatasetSettings) -> Result<Self, DatasetError> {
        settings.validate()?;
        let inner = folder.join(COLOR_FOLDER);
        let images = if inner.is_dir() { inner } else { folder.to_owned() };
        let color = Images::list(&images, &ENDINGS, Twins::Refused)?;
        if color.images.is_empty() {
            return Err(no_frames_in(&images, EXPECTED));
        }
        Self::without_depth(Format::Images, folder, &folder.join(POSES), &color, settings)
    }

    /// Lists the extracted frames of a video; `times` are theirs, seconds, if they are known, and `poses` a list of poses,
    /// if it exists.
    ///
    /// # Errors
    /// As [`Self::open`].
    pub(crate) fn of_video(
        video: &Path,
        poses: &Path,
        extracted: TempDir,
        times: &[f64],
        settings: &DatasetSettings,
    ) -> Result<Self, DatasetError> {
        let mut color = Images::list(extracted.path(), &ENDINGS, Twins::Refused)?;
        if color.images.is_empty() {
            return Err(DatasetError::NoFrames { path: video.to_owned(), expected: "a video stream" });
        }
        // A frame more or less would shift all others.
        if times.len() == color.images.len() {
            color.images.iter_mut().zip(times).for_each(|(image, time)| image.seconds = Some(*time));
        }
        let mut scene = Self::without_depth(Format::Video, video, poses, &color, settings)?;
        scene.name = video.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        scene.extracted = Some(extracted);
        Ok(scene)
    }

    fn without_depth(
        format: Format,
        folder: &Path,
        list: &Path,
        color: &Images,
        settings: &DatasetSettings,
    ) -> Result<Self, DatasetError> {
        let own_camera = OwnCamera::from_settings(settings)?;
        let has_list = is_there(list);
        let listed =
            if has_list { poses_of(color, read_pose_list(list)?, list)? } else { vec![None; color.images.len()] };
        let (frames, left_out): (Vec<FolderFrame>, _) = frames_without_depth(color, &listed);
        let path = folder.join(CAMERA_FILE);
        // A camera and poses are those of the images as they are stored.
        let is_described =
            is_there(&path) || has_list || [settings.fy, settings.cx, settings.cy].iter().any(Option::is_some);
        let (read_color, read_size): (ReadColor, ReadSize) =
            if is_described { (read_color, color_size) } else { (read_upright, upright_size) };
        let size = size_of_images(&frames, read_size)?;
        let mut guessed = None;
        let (mut camera, size_from) = if is_there(&path) {
            (FolderCamera::read(&path, settings)?, CAMERA_FILE)
        } else {
            let own = own_camera.unwrap_or_else(|| {
                let images: Vec<&Path> = frames.iter().map(|frame| frame.color.as_path()).collect();
                OwnCamera::guessed(guessed.insert(GuessedCamera::of_images(&images, size, read_color)))
            });
            (FolderCamera::without_file(own.intrinsics(size), settings), "the first image")
        };
        if let Some(own) = own_camera {
            camera.intrinsics = own.intrinsics((camera.intrinsics.width, camera.intrinsics.height));
        }
        Ok(Self {
            name: folder_name(folder),
            folder: folder.to_owned(),
            format,
            poses: if has_list { coverage(&frames) } else { PoseCoverage::NONE },
            frames,
            corrections: Default::default(),
            camera,
            own_camera,
            size_from,
            undistortion: OnceLock::new(),
            left_out,
            sources: guessed.iter().map(|guess| guess.text(color.images.len())).collect(),
            guessed,
            read_color,
            extracted: None,
        })
    }
}
