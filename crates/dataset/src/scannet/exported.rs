//! ScanNet scenes exported to folders: `color/<i>.jpg`, `depth/<i>.png` (uint16 millimetres), `pose/<i>.txt`
//! (4x4, camera-to-world), `intrinsic/` and, as ground truth, `instance-filt/<i>.png` or the published
//! `<scene>_2d-instance-filt.zip` that contains it.

use super::labels::InstanceLabels;
use super::{Camera, Cameras};
use crate::decode::{COLOR_IMAGE, DEPTH_IMAGE, MILLIMETRES, image_size, read_color, read_depth};
use crate::listing::{NamePattern, NumberedFile, folder_name, has_numbered_files, left_out_beside, numbered_files};
use crate::scene::{FramePart, FrameParts, LeftOut, entry};
use crate::text::{PinholeMatrix, read_pose};
use crate::{DatasetError, Format, RecordedFrame, Scene};
use splatseg_geometry::SegmentMap;
use std::path::{Path, PathBuf};

/// Layout of an exported ScanNet folder, for messages.
pub(crate) const LAYOUT: &str = "color/0.jpg, depth/0.png, pose/0.txt, ..., intrinsic/intrinsic_color.txt, \
                                 intrinsic/intrinsic_depth.txt, instance-filt/0.png or *_2d-instance-filt.zip \
                                 (optional)";

const COLOR: NamePattern = NamePattern { prefix: "", suffixes: &[".png", ".jpg", ".jpeg"] };

const DEPTH: NamePattern = NamePattern { prefix: "", suffixes: &[".png"] };
const POSE: NamePattern = NamePattern { prefix: "", suffixes: &[".txt"] };

/// A ScanNet scene exported to folders.
#[derive(Debug)]
pub struct ScannetScene {
    name: String,
    folder: PathBuf,
    frames: Vec<NumberedFile>,
    cameras: Cameras,
    labels: Option<InstanceLabels>,
    left_out: Vec<LeftOut>,
}

impl ScannetScene {
    /// Lists the frames of a scene's folder, sorted by number, and reads its cameras.
    ///
    /// # Errors
    /// If the folder cannot be read, colour images, depth images or poses are missing, or an intrinsics file or the
    /// labels' zip file is missing or damaged.
    pub fn open(folder: &Path) -> Result<Self, DatasetError> {
        let color_folder = folder.join("color");
        let frames = numbered_files(&color_folder, COLOR)?;
        if frames.is_empty() {
            return Err(DatasetError::NoFrames { path: color_folder, expected: "<number>.jpg or .png" });
        }
        let others = [(folder.join("depth"), DEPTH), (folder.join("pose"), POSE)];
        for ((part, pattern), expected) in others.iter().zip(["<number>.png", "<number>.txt"]) {
            if !has_numbered_files(part, *pattern) {
                return Err(DatasetError::NoFrames { path: part.clone(), expected });
            }
        }
        let left_out = left_out_beside(&frames, &color_folder, &others);
        let name = folder_name(folder);
        let cameras = Cameras { color: read_camera(folder, "color")?, depth: read_camera(folder, "depth")? };
        let labels = InstanceLabels::in_folder(folder, &name)?;
        Ok(Self { name, folder: folder.to_owned(), frames, cameras, labels, left_out })
    }

    fn depth_path(&self, file: &NumberedFile) -> PathBuf {
        self.folder.join("depth").join(format!("{}.png", file.stem))
    }

    fn pose_path(&self, file: &NumberedFile) -> PathBuf {
        self.folder.join("pose").join(format!("{}.txt", file.stem))
    }
}

fn read_camera(folder: &Path, camera: &str) -> Result<Camera, DatasetError> {
    let path = folder.join("intrinsic").join(format!("intrinsic_{camera}.txt"));
    Ok(Camera { matrix: PinholeMatrix::read(&path)?, path })
}

/// Returns the required parts of an exported scene, each with true if the folder has it.
pub(crate) fn parts(path: &Path) -> Vec<(&'static str, bool)> {
    ["color/", "depth/", "pose/", "intrinsic/"].map(|part| (part, path.join(part).is_dir())).to_vec()
}

/// Returns true if a folder contains an exported ScanNet scene.
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

    fn read_recorded(&self, index: usize) -> Result<RecordedFrame, DatasetError> {
        let file = entry(&self.frames, index, &self.name)?;
        // Pose first: it is quick to read, and if tracking was lost nothing else is needed.
        let pose = read_pose(&self.pose_path(file))?;
        let depth = read_depth(&self.depth_path(file), MILLIMETRES)?;
        let (intrinsics, color) = self.cameras.color_at_depth(read_color(&file.path)?, depth.size())?;
        let name = file.stem.clone();
        FrameParts { name, timestamp: None, color, depth, intrinsics, world_from_camera: Some(pose) }.into_frame()
    }

    fn has_ground_truth(&self) -> bool {
        self.labels.is_some()
    }

    fn read_ground_truth(&self, index: usize) -> Result<Option<SegmentMap>, DatasetError> {
        let file = entry(&self.frames, index, &self.name)?;
        let Some(source) = &self.labels else { return Ok(None) };
        let Some((path, labels)) = source.read(&file.stem)? else { return Ok(None) };
        let depth = image_size(&self.depth_path(file), DEPTH_IMAGE)?;
        self.cameras.labels_at_depth(labels, &path, depth, || image_size(&file.path, COLOR_IMAGE)).map(Some)
    }

    fn format(&self) -> Option<Format> {
        Some(Format::Scannet)
    }

    fn stored_color_size(&self, index: usize) -> Option<(usize, usize)> {
        image_size(&self.frames.get(index)?.path, COLOR_IMAGE).ok()
    }

    fn left_out(&self) -> &[LeftOut] {
        &self.left_out
    }

    fn file_of(&self, index: usize, part: FramePart) -> PathBuf {
        match (self.frames.get(index), part) {
            (Some(file), FramePart::Depth) => self.depth_path(file),
            (Some(file), FramePart::Pose) => self.pose_path(file),
            (_, FramePart::Intrinsics) => self.cameras.depth.path.clone(),
            (None, _) => self.folder.clone(),
        }
    }
}
