//! ScanNet scenes exported to folders: `color/<i>.jpg`, `depth/<i>.png` (uint16 millimetres), `pose/<i>.txt`
//! (4x4, camera-to-world), `intrinsic/` and, as ground truth, `instance-filt/<i>.png` or the published
//! `<scene>_2d-instance-filt.zip` that contains it. Poses may be missing, for some frames or with all of `pose/`.

use super::labels::InstanceLabels;
use super::{Camera, Cameras};
use crate::decode::{image_size, read_color};
use crate::depth_file::{DEPTH_FILE_NAMES, DEPTH_SUFFIXES, depth_path, depth_size, read_depth};
use crate::depth_scale::DepthScale;
use crate::error::COLOR_IMAGE;
use crate::files::is_there;
use crate::listing::{
    NamePattern, NumberedFile, folder_name, has_numbered_files, left_out_beside, no_frames_in, numbered_files,
    pose_coverage,
};
use crate::own_camera::{OwnCamera, no_camera};
use crate::recorded_poses::PoseCoverage;
use crate::scene::{FramePart, FrameParts, LeftOut, entry};
use crate::text::{PinholeMatrix, read_pose};
use crate::{DatasetError, DatasetSettings, Format, RecordedFrame, Scene};
use splatseg_geometry::SegmentMap;
use std::path::{Path, PathBuf};

/// Layout of an exported ScanNet folder, for messages.
pub(crate) const LAYOUT: &str = "color/0.jpg, depth/0.png, pose/0.txt (optional), ..., \
                                 intrinsic/intrinsic_color.txt, intrinsic/intrinsic_depth.txt, instance-filt/0.png or *_2d-instance-filt.zip \
                                 (optional)";

const COLOR: NamePattern = NamePattern { prefix: "", suffixes: &[".png", ".jpg", ".jpeg"] };

const DEPTH: NamePattern = NamePattern { prefix: "", suffixes: DEPTH_SUFFIXES };
const POSE: NamePattern = NamePattern { prefix: "", suffixes: &[".txt"] };

/// A ScanNet scene exported to folders.
#[derive(Debug)]
pub struct ScannetScene {
    name: String,
    folder: PathBuf,
    frames: Vec<NumberedFile>,
    cameras: Cameras,
    depth_scale: DepthScale,
    poses: PoseCoverage,
    labels: Option<InstanceLabels>,
    left_out: Vec<LeftOut>,
}

impl ScannetScene {
    /// Lists the frames of a scene's folder, sorted by number, and reads its cameras. Uses only `fx` to `cy` and
    /// `depth_scale` of `settings`.
    ///
    /// # Errors
    /// If the folder cannot be read, colour or depth images are missing, there is a folder of poses without any, an
    /// intrinsics file is missing (and `fx` is not set) or damaged, or the labels' zip file is damaged.
    pub fn open(folder: &Path, settings: &DatasetSettings) -> Result<Self, DatasetError> {
        settings.validate()?;
        let color_folder = folder.join("color");
        let frames = numbered_files(&color_folder, COLOR)?;
        if frames.is_empty() {
            return Err(no_frames_in(&color_folder, "<number>.jpg or .png"));
        }
        let others = [(folder.join("depth"), DEPTH), (folder.join("pose"), POSE)];
        for ((part, pattern), expected) in others.iter().zip([DEPTH_FILE_NAMES, "<number>.txt"]) {
            let may_be_missing = pattern.suffixes == POSE.suffixes && !is_there(part);
            if !may_be_missing && !has_numbered_files(part, *pattern) {
                return Err(no_frames_in(part, expected));
            }
        }
        let left_out = left_out_beside(&frames, &color_folder, &others);
        let name = folder_name(folder);
        let poses = pose_coverage(&frames, &folder.join("pose"), POSE);
        let cameras = read_cameras(folder, &frames, settings)?;
        let labels = InstanceLabels::in_folder(folder, &name)?;
        let depth_scale = DepthScale::MILLIMETRES.or_of(settings);
        Ok(Self { name, folder: folder.to_owned(), frames, cameras, depth_scale, poses, labels, left_out })
    }

    fn depth_path(&self, file: &NumberedFile) -> PathBuf {
        depth_path(&self.folder.join("depth"), &file.stem)
    }

    fn pose_path(&self, file: &NumberedFile) -> PathBuf {
        self.folder.join("pose").join(format!("{}.txt", file.stem))
    }
}

fn read_cameras(folder: &Path, frames: &[NumberedFile], settings: &DatasetSettings) -> Result<Cameras, DatasetError> {
    if let Some(camera) = OwnCamera::from_settings(settings)? {
        return Ok(Cameras::Own(camera));
    }
    if !is_there(&folder.join("intrinsic")) {
        let images: Vec<&Path> = frames.iter().map(|frame| frame.path.as_path()).collect();
        return Err(no_camera(folder, "intrinsic/intrinsic_color.txt and intrinsic/intrinsic_depth.txt", &images));
    }
    Ok(Cameras::Recorded { color: read_camera(folder, "color")?, depth: read_camera(folder, "depth")? })
}

fn read_camera(folder: &Path, camera: &str) -> Result<Camera, DatasetError> {
    let path = folder.join("intrinsic").join(format!("intrinsic_{camera}.txt"));
    Ok(Camera { matrix: PinholeMatrix::read(&path)?, path })
}

/// Returns the required parts of an exported scene, each with true if the folder has it.
pub(crate) fn parts(path: &Path) -> Vec<(&'static str, bool)> {
    let has = |part: &str| path.join(part).is_dir();
    let mut parts = ["color/", "depth/", "intrinsic/"].map(|part| (part, has(part))).to_vec();
    // Not required, but a sign of the format.
    parts.extend(Some(("pose/", true)).filter(|(part, _)| has(part)));
    parts
}

/// Returns true if an exported scene has poses.
pub(crate) fn is_whole(path: &Path) -> bool {
    path.join("pose").is_dir()
}

/// Returns true if a folder contains an exported ScanNet scene.
pub(crate) fn looks_like(path: &Path) -> bool {
    let has = |folder: &str| path.join(folder).is_dir();
    has("color") && has("depth") && (has("pose") || has("intrinsic"))
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
        // Pose first: it is quick to read and the most likely to be damaged.
        let pose = read_pose(&self.pose_path(file))?;
        let depth = read_depth(&self.depth_path(file), self.depth_scale)?;
        let (intrinsics, color) = self.cameras.color_at_depth(read_color(&file.path)?, depth.size())?;
        let name = file.stem.clone();
        FrameParts { name, timestamp: None, color, depth, intrinsics, world_from_camera: pose }.into_frame()
    }

    fn has_poses(&self) -> bool {
        self.poses.has_poses()
    }

    fn without_pose(&self) -> &[LeftOut] {
        self.poses.without_pose()
    }

    fn has_ground_truth(&self) -> bool {
        self.labels.is_some()
    }

    fn read_ground_truth(&self, index: usize) -> Result<Option<SegmentMap>, DatasetError> {
        let file = entry(&self.frames, index, &self.name)?;
        let Some(source) = &self.labels else { return Ok(None) };
        let Some((path, labels)) = source.read(&file.stem)? else { return Ok(None) };
        // That of another frame if this frame's image is damaged: the labels are good.
        let others = || self.frames.iter().find_map(|other| depth_size(&self.depth_path(other)).ok());
        let depth = depth_size(&self.depth_path(file)).or_else(|error| others().ok_or(error))?;
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
            (_, FramePart::Intrinsics) => self.cameras.place(),
            (None, _) => self.folder.clone(),
        }
    }
}
