//! ScanNet scenes exported to folders: `color/<i>.jpg`, `depth/<i>.png` (uint16 millimetres), `pose/<i>.txt`
//! (4x4, camera-to-world), `intrinsic/` and, as ground truth, `instance-filt/<i>.png`.
//!
//! The frames are those of the depth camera. Colour of another size or camera (ScanNet: 1296x968 beside 640x480) is
//! resampled to it, labels are taken from the nearest pixel; both stay as they are when the cameras are the same. The
//! few millimetres between ScanNet's cameras are ignored, as everyone does.

use crate::decode::{image_size, read_color, read_depth, read_labels};
use crate::listing::{NamePattern, NumberedFile, folder_name, numbered_files};
use crate::resample::{ImageMap, resample_color, resample_labels};
use crate::text::{PinholeMatrix, read_pose};
use crate::{DatasetError, Scene};
use splatseg_geometry::{RgbdFrame, SegmentMap};
use std::path::{Path, PathBuf};

/// What an exported ScanNet folder looks like, for messages.
pub(crate) const LAYOUT: &str = "color/0.jpg, depth/0.png, pose/0.txt, ..., intrinsic/intrinsic_color.txt, \
                                 intrinsic/intrinsic_depth.txt, instance-filt/0.png (optional)";

const COLOR: NamePattern = NamePattern { prefix: "", suffixes: &[".png", ".jpg", ".jpeg"] };

/// A ScanNet scene exported to folders.
#[derive(Debug)]
pub struct ScannetScene {
    name: String,
    folder: PathBuf,
    frames: Vec<NumberedFile>,
    color_camera: PinholeMatrix,
    depth_camera: PinholeMatrix,
    has_ground_truth: bool,
}

impl ScannetScene {
    /// Lists the frames of a scene's folder, sorted by number, and reads its cameras.
    ///
    /// # Errors
    /// If the folder cannot be read or has no frames, or an intrinsics file is missing or damaged.
    pub fn open(folder: &Path) -> Result<Self, DatasetError> {
        let color_folder = folder.join("color");
        let frames = numbered_files(&color_folder, COLOR)?;
        if frames.is_empty() {
            return Err(DatasetError::NoFrames { path: color_folder, expected: "<number>.jpg or .png" });
        }
        Ok(Self {
            name: folder_name(folder),
            folder: folder.to_owned(),
            frames,
            color_camera: PinholeMatrix::read(&intrinsics_path(folder, "color"))?,
            depth_camera: PinholeMatrix::read(&intrinsics_path(folder, "depth"))?,
            has_ground_truth: folder.join("instance-filt").is_dir(),
        })
    }

    fn frame(&self, index: usize) -> Result<&NumberedFile, DatasetError> {
        self.frames.get(index).ok_or_else(|| DatasetError::NoSuchFrame {
            scene: self.name.clone(),
            index,
            count: self.frames.len(),
        })
    }

    fn depth_path(&self, file: &NumberedFile) -> PathBuf {
        self.folder.join("depth").join(format!("{}.png", file.stem))
    }

    /// From colour images of size `color` to depth images of size `depth`, both `(width, height)`.
    fn depth_from_color(&self, color: (usize, usize), depth: (usize, usize)) -> Result<ImageMap, DatasetError> {
        let color_camera = self.color_camera.for_size(color, &intrinsics_path(&self.folder, "color"))?;
        let depth_camera = self.depth_camera.for_size(depth, &intrinsics_path(&self.folder, "depth"))?;
        Ok(ImageMap::between_cameras(&color_camera, &depth_camera))
    }
}

fn intrinsics_path(folder: &Path, camera: &str) -> PathBuf {
    folder.join("intrinsic").join(format!("intrinsic_{camera}.txt"))
}

/// Whether a folder holds an exported ScanNet scene.
pub(crate) fn looks_like(path: &Path) -> bool {
    ["color", "depth", "pose"].iter().all(|folder| path.join(folder).is_dir())
}

impl Scene for ScannetScene {
    fn name(&self) -> &str {
        &self.name
    }

    fn frame_count(&self) -> usize {
        self.frames.len()
    }

    fn frame_name(&self, index: usize) -> String {
        self.frames.get(index).map(|file| file.stem.clone()).unwrap_or_default()
    }

    fn read_frame(&self, index: usize) -> Result<RgbdFrame, DatasetError> {
        let file = self.frame(index)?;
        // The pose first: it is quick to read, and where tracking was lost nothing else is needed.
        let pose = read_pose(&self.folder.join("pose").join(format!("{}.txt", file.stem)))?;
        let depth = read_depth(&self.depth_path(file))?;
        let color = read_color(&file.path)?;
        let map = self.depth_from_color(color.size(), depth.size())?;
        let color = if map.is_identity() { color } else { resample_color(&color, &map) };
        let camera = self.depth_camera.for_size(depth.size(), &intrinsics_path(&self.folder, "depth"))?;
        RgbdFrame::new(file.stem.clone(), color, depth, camera, pose)
            .map_err(|source| DatasetError::Frame { name: file.stem.clone(), source })
    }

    fn has_ground_truth(&self) -> bool {
        self.has_ground_truth
    }

    fn read_ground_truth(&self, index: usize) -> Result<Option<SegmentMap>, DatasetError> {
        let file = self.frame(index)?;
        let path = self.folder.join("instance-filt").join(format!("{}.png", file.stem));
        if !path.exists() {
            return Ok(None);
        }
        let labels = read_labels(&path)?;
        let depth = image_size(&self.depth_path(file), "depth image")?;
        if labels.size() == depth {
            return Ok(Some(labels));
        }
        let color = image_size(&file.path, "colour image")?;
        if labels.size() != color {
            return Err(DatasetError::SizesDiffer {
                path,
                what: "segment image",
                found: labels.size(),
                expected: color,
                expected_from: "its colour image",
            });
        }
        Ok(Some(resample_labels(&labels, &self.depth_from_color(color, depth)?)))
    }
}
