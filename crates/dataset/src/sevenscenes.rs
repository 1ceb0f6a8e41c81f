//! 7-Scenes (Shotton et al., CVPR 2013): `frame-000000.color.png`, `.depth.png` (uint16 millimetres) and `.pose.txt`
//! (4x4, camera-to-world), all in the sequence's folder. Poses may be missing, for some frames or for all.
//!
//! The published sequences have no intrinsics, and their depth is not registered to colour. Prepared ones may have
//! registered depth and a `camera-intrinsics.txt` (3x3).

use crate::decode::read_color;
use crate::depth_file::{depth_path, read_depth};
use crate::depth_scale::DepthScale;
use crate::listing::{
    NamePattern, NumberedFile, fits, folder_name, has_numbered_files, left_out_beside, names_in, numbered_files,
    pose_coverage,
};
use crate::own_camera::{OwnCamera, at_resolution, camera_place};
use crate::plausibility::warn_once;
use crate::recorded_poses::PoseCoverage;
use crate::scene::{FramePart, FrameParts, LeftOut, entry, require_registered};
use crate::text::{PinholeMatrix, read_pose};
use crate::{DatasetError, DatasetSettings, DepthRegistration, Format, RecordedFrame, Scene};
use glam::{DVec3, Vec3};
use splatseg_geometry::{Intrinsics, LocalPose, PoseFormat, SegmentMap};
use splatseg_imaging::{CameraPair, register_depth};
use std::path::{Path, PathBuf};

/// Layout of a 7-Scenes folder, for messages.
pub(crate) const LAYOUT: &str = "frame-000000.color.png (or .jpg), frame-000000.depth.png, frame-000000.pose.txt (optional), ..., camera-intrinsics.txt (optional)";

const COLOR: NamePattern = NamePattern { prefix: "frame-", suffixes: &[".color.png", ".color.jpg", ".color.jpeg"] };
const DEPTH: NamePattern = NamePattern { prefix: "frame-", suffixes: DEPTH_SUFFIXES };
const DEPTH_SUFFIXES: &[&str] = &[".depth.png", ".depth.tiff", ".depth.tif", ".depth.npy", ".depth.exr", ".depth.pfm"];
const POSE: NamePattern = NamePattern { prefix: "frame-", suffixes: &[".pose.txt"] };
const INTRINSICS_FILE: &str = "camera-intrinsics.txt";

/// The colour camera according to the data set's page.
const PUBLISHED_COLOR: Intrinsics = Intrinsics { fx: 525.0, fy: 525.0, cx: 320.0, cy: 240.0, width: 640, height: 480 };
/// The depth camera according to the data set's page.
const PUBLISHED_DEPTH: Intrinsics = Intrinsics { fx: 585.0, fy: 585.0, cx: 320.0, cy: 240.0, width: 640, height: 480 };

/// One sequence in the layout of 7-Scenes. It has no ground truth.
///
/// Without `camera-intrinsics.txt`, the published colour camera is assumed (focal length 525, principal point (320,
/// 240), for 640x480 pixels), with a warning.
#[derive(Debug)]
pub struct SevenScenesScene {
    name: String,
    folder: PathBuf,
    frames: Vec<NumberedFile>,
    intrinsics: Option<PinholeMatrix>,
    own_camera: Option<OwnCamera>,
    depth_scale: DepthScale,
    poses: PoseCoverage,
    pose_format: PoseFormat,
    /// Offset between the cameras if depth must be warped, metres.
    registration: Option<f32>,
    left_out: Vec<LeftOut>,
}

impl SevenScenesScene {
    /// Lists the frames of a sequence's folder, sorted by number. Uses only `fx` to `cy`, `depth_scale`,
    /// `register_depth`, `depth_offset_m` and those about poses of `settings`.
    ///
    /// # Errors
    /// If the folder cannot be read, contains no frames or only sequence folders, or its intrinsics are damaged.
    pub fn open(folder: &Path, settings: &DatasetSettings) -> Result<Self, DatasetError> {
        settings.validate()?;
        let own_camera = OwnCamera::from_settings(settings)?;
        let registers = settings.register_depth == DepthRegistration::True;
        let frames = numbered_files(folder, COLOR)?;
        if frames.is_empty() {
            let sequences = sequence_folders(folder);
            return Err(if sequences.is_empty() {
                DatasetError::NoFrames { path: folder.to_owned(), expected: "frame-<number>.color.png or .jpg" }
            } else {
                DatasetError::SeveralSequences { path: folder.to_owned(), sequences }
            });
        }
        let intrinsics_path = folder.join(INTRINSICS_FILE);
        let intrinsics = if intrinsics_path.exists() {
            Some(PinholeMatrix::read(&intrinsics_path)?)
        } else if own_camera.is_some() {
            None
        } else {
            warn_once(format!(
                "{}: no {INTRINSICS_FILE}: assuming the colour camera of the published 7-Scenes (focal length 525){}",
                folder.display(),
                if registers { "" } else { "; their depth needs --register-depth" }
            ));
            None
        };
        let registration = registers.then_some(settings.depth_offset_m);
        let others = [(folder.to_owned(), DEPTH), (folder.to_owned(), POSE)];
        let left_out = left_out_beside(&frames, folder, &others);
        let poses = pose_coverage(&frames, folder, POSE);
        let pose_format = settings.pose_format();
        let (name, folder) = (folder_name(folder), folder.to_owned());
        let depth_scale = DepthScale::MILLIMETRES.or_of(settings);
        Ok(Self {
            name,
            folder,
            frames,
            intrinsics,
            own_camera,
            depth_scale,
            poses,
            pose_format,
            registration,
            left_out,
        })
    }

    fn part_of(&self, file: &NumberedFile, pattern: NamePattern) -> PathBuf {
        self.folder.join(format!("{}{}", file.stem, pattern.suffixes[0]))
    }

    /// Returns the camera of a colour image of `size` `(width, height)`, which is in the file `image`.
    fn color_camera(&self, size: (usize, usize), image: &Path) -> Result<Intrinsics, DatasetError> {
        match (self.own_camera, self.intrinsics) {
            (Some(camera), _) => Ok(camera.intrinsics(size)),
            (None, Some(matrix)) => matrix.for_size(size, &self.folder.join(INTRINSICS_FILE)),
            (None, None) => {
                at_resolution(&PUBLISHED_COLOR, size, (image, "the published 7-Scenes have, whose camera is assumed"))
            }
        }
    }
}

/// Returns the required parts of a sequence, each with true if the folder has it.
pub(crate) fn parts(path: &Path) -> Vec<(&'static str, bool)> {
    [("frame-<number>.color.png or .jpg", COLOR), ("frame-<number>.depth.png", DEPTH)]
        .map(|(part, pattern)| (part, has_numbered_files(path, pattern)))
        .to_vec()
}

/// Returns true if a sequence has poses, or a folder contains folders of sequences.
pub(crate) fn is_whole(path: &Path) -> bool {
    has_numbered_files(path, POSE) || !sequence_folders(path).is_empty()
}

/// Returns true if a folder contains a sequence, or folders of sequences.
pub(crate) fn looks_like(path: &Path) -> bool {
    parts(path).iter().all(|(_, is_present)| *is_present) || !sequence_folders(path).is_empty()
}

fn sequence_folders(path: &Path) -> Vec<String> {
    let pattern = NamePattern { prefix: "seq-", suffixes: &[""] };
    names_in(path).into_iter().filter(|name| fits(name, pattern) && path.join(name).is_dir()).collect()
}

impl Scene for SevenScenesScene {
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
        let depth_path = depth_path(&self.folder, &format!("{}.depth", file.stem));
        // Pose first: it is quick to read and the most likely to be damaged.
        let mut pose = read_pose(&self.part_of(file, POSE))?.map(|stated| self.pose_format.pose(&stated));
        let mut depth = read_depth(&depth_path, self.depth_scale)?;
        let color = read_color(&file.path)?;
        let camera = self.color_camera(color.size(), &file.path)?;
        if let Some(offset_m) = self.registration {
            let depth_camera = PUBLISHED_DEPTH.resized(depth.width(), depth.height());
            let color_from_depth = LocalPose::from_translation(-Vec3::X * offset_m);
            depth = register_depth(&depth, &CameraPair { depth: depth_camera, color: camera, color_from_depth });
            pose = pose.map(|pose| pose * color_from_depth.inverse().at(DVec3::ZERO));
        } else {
            require_registered(&color, &depth, &depth_path)?;
        }
        let name = file.stem.clone();
        FrameParts { name, timestamp: None, color, depth, intrinsics: camera, world_from_camera: pose }.into_frame()
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
        Some(Format::SevenScenes)
    }

    fn left_out(&self) -> &[LeftOut] {
        &self.left_out
    }

    fn file_of(&self, index: usize, part: FramePart) -> PathBuf {
        match (self.frames.get(index), part) {
            (Some(file), FramePart::Depth) => depth_path(&self.folder, &format!("{}.depth", file.stem)),
            (Some(file), FramePart::Pose) => self.part_of(file, POSE),
            (_, FramePart::Intrinsics) => camera_place(self.own_camera.as_ref(), &self.folder.join(INTRINSICS_FILE)),
            (None, _) => self.folder.clone(),
        }
    }
}
