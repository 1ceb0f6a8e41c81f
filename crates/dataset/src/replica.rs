//! Replica (Straub et al., 2019) as rendered for iMAP and laid out by NICE-SLAM: `results/frame000000.jpg`,
//! `results/depth000000.png` (16-bit) and `traj.txt` with one camera-to-world matrix per line (16 numbers, row-major).
//!
//! The camera is described by `cam_params.json` in the scene's folder or its parent, as in NICE-SLAM's archive:
//! `{"camera": {"w", "h", "fx", "fy", "cx", "cy", "scale"}}`, with `scale` depth units per metre.

use crate::decode::{read_color, read_depth};
use crate::files::read_file;
use crate::listing::{NamePattern, NumberedFile, folder_name, has_numbered_files, left_out_beside, numbered_files};
use crate::scene::{FramePart, FrameParts, LeftOut, entry, require_registered};
use crate::text::{read_text, shortened};
use crate::{DatasetError, Format, RecordedFrame, Scene};
use serde::Deserialize;
use splatseg_geometry::{Intrinsics, Pose, SegmentMap};
use std::path::{Path, PathBuf};

/// Layout of a Replica folder, for messages.
pub(crate) const LAYOUT: &str = "results/frame000000.jpg, results/depth000000.png, ..., traj.txt, cam_params.json (optional, here or one folder up)";

const COLOR: NamePattern = NamePattern { prefix: "frame", suffixes: &[".png", ".jpg", ".jpeg"] };
const DEPTH: NamePattern = NamePattern { prefix: "depth", suffixes: &[".png"] };
const IMAGES_FOLDER: &str = "results";
const TRAJECTORY: &str = "traj.txt";
const CAMERA_FILE: &str = "cam_params.json";
/// Larger files are not trajectories: a day at 30 frames a second has 2.6 million.
const MAX_TRAJECTORY_BYTES: u64 = 1 << 30;
const MAX_CAMERA_FILE_BYTES: u64 = 1 << 20;

/// Camera used to render the published scenes.
const PUBLISHED: CameraParams =
    CameraParams { w: 1200, h: 680, fx: 600.0, fy: 600.0, cx: 599.5, cy: 339.5, scale: 6553.5 };

/// `cam_params.json`.
#[derive(Debug, Deserialize)]
struct CameraFile {
    camera: CameraParams,
}

#[derive(Clone, Copy, Debug, Deserialize)]
struct CameraParams {
    w: usize,
    h: usize,
    fx: f32,
    fy: f32,
    cx: f32,
    cy: f32,
    scale: f32,
}

/// A Replica scene in the layout of NICE-SLAM. It has no ground truth segments.
///
/// Without `cam_params.json`, the published camera is assumed: 1200x680 pixels, focal length 600, principal point
/// (599.5, 339.5), 6553.5 depth units per metre. Intrinsics are scaled to the images' size. Depth of 65535, which means
/// 10 m or more in the published scenes, counts as missing.
#[derive(Debug)]
pub struct ReplicaScene {
    name: String,
    folder: PathBuf,
    frames: Vec<NumberedFile>,
    /// Row-major, camera-to-world.
    poses: Vec<[f64; 16]>,
    intrinsics: Intrinsics,
    units_per_metre: f32,
    left_out: Vec<LeftOut>,
}

impl ReplicaScene {
    /// Lists the frames of a scene's folder, sorted by number, and reads its trajectory and camera.
    ///
    /// # Errors
    /// If the folder has no colour or no depth images, or the trajectory is missing, or the trajectory or camera file
    /// is damaged.
    pub fn open(folder: &Path) -> Result<Self, DatasetError> {
        let images = folder.join(IMAGES_FOLDER);
        let frames = numbered_files(&images, COLOR)?;
        if frames.is_empty() {
            return Err(DatasetError::NoFrames { path: images, expected: "frame<number>.jpg or .png" });
        }
        if !has_numbered_files(&images, DEPTH) {
            return Err(DatasetError::NoFrames { path: images, expected: "depth<number>.png" });
        }
        let poses = read_trajectory(&folder.join(TRAJECTORY))?;
        let (intrinsics, units_per_metre) = read_camera(folder)?;
        let left_out = left_out_beside(&frames, &images, &[(images.clone(), DEPTH)]);
        let (name, folder) = (folder_name(folder), folder.to_owned());
        Ok(Self { name, folder, frames, poses, intrinsics, units_per_metre, left_out })
    }

    fn depth_path(&self, file: &NumberedFile) -> PathBuf {
        let digits = file.stem.trim_start_matches(COLOR.prefix);
        self.folder.join(IMAGES_FOLDER).join(format!("depth{digits}.png"))
    }

    /// Returns the file and line of a pose, for messages.
    fn pose_path(&self, line: usize) -> PathBuf {
        PathBuf::from(format!("{}: line {}", self.folder.join(TRAJECTORY).display(), line.saturating_add(1)))
    }

    /// Returns the trajectory line, from 0, of a frame: the line at the frame's index if there are as many lines as
    /// frames, otherwise the line at its number, e.g. if every tenth image was kept with the whole trajectory.
    fn trajectory_line(&self, index: usize, file: &NumberedFile) -> usize {
        if self.poses.len() == self.frames.len() { index } else { usize::try_from(file.number).unwrap_or(usize::MAX) }
    }
}

/// Returns the required parts of a scene, each with true if the folder has it.
pub(crate) fn parts(path: &Path) -> Vec<(&'static str, bool)> {
    vec![(TRAJECTORY, path.join(TRAJECTORY).is_file()), ("results/", path.join(IMAGES_FOLDER).is_dir())]
}

/// Returns true if a folder contains a scene.
pub(crate) fn looks_like(path: &Path) -> bool {
    parts(path).iter().all(|(_, is_present)| *is_present)
}

fn read_trajectory(path: &Path) -> Result<Vec<[f64; 16]>, DatasetError> {
    let text = read_text(path, "camera trajectory", MAX_TRAJECTORY_BYTES)?;
    let lines = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
    let pose = |(index, line): (usize, &str)| {
        let mut matrix = [0.0; 16];
        let mut words = line.split_whitespace();
        let complete = matrix.iter_mut().try_for_each(|entry| {
            *entry = words.next()?.parse().ok()?;
            Some(())
        });
        if complete.is_none() || words.next().is_some() {
            return Err(DatasetError::Field {
                path: path.to_owned(),
                field: format!("line {}", index + 1),
                found: shortened(line),
                expected: "16 numbers, a 4x4 matrix row by row".to_owned(),
            });
        }
        Ok(matrix)
    };
    lines.map(pose).collect()
}

/// Reads the camera and the number of depth units per metre.
fn read_camera(folder: &Path) -> Result<(Intrinsics, f32), DatasetError> {
    let own = folder.join(CAMERA_FILE);
    let shared = folder.canonicalize().ok().and_then(|full| Some(full.parent()?.join(CAMERA_FILE)));
    let (params, path) = match [Some(own.clone()), shared].into_iter().flatten().find(|path| path.is_file()) {
        Some(path) => {
            let bytes = read_file(&path, "camera file", MAX_CAMERA_FILE_BYTES)?;
            let file: CameraFile =
                serde_json::from_slice(&bytes).map_err(|source| DatasetError::Json { path: path.clone(), source })?;
            (file.camera, path)
        }
        None => (PUBLISHED, own),
    };
    let CameraParams { w, h, fx, fy, cx, cy, scale } = params;
    if !(scale.is_finite() && scale > 0.0) {
        return Err(DatasetError::Field {
            path,
            field: "camera.scale".to_owned(),
            found: scale.to_string(),
            expected: "a positive number of depth units per metre".to_owned(),
        });
    }
    let camera = Intrinsics { fx, fy, cx, cy, width: w, height: h };
    Ok((camera.validated().map_err(|source| DatasetError::Intrinsics { path, source })?, scale))
}

impl Scene for ReplicaScene {
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
        let trajectory = self.folder.join(TRAJECTORY);
        let line = self.trajectory_line(index, file);
        let matrix = self.poses.get(line).ok_or_else(|| DatasetError::Field {
            path: trajectory.clone(),
            field: format!("pose of {}", file.stem),
            found: format!("{} lines", self.poses.len()),
            expected: format!("one for each of {} frames, or at least {}", self.frames.len(), line.saturating_add(1)),
        })?;
        let pose = Pose::from_row_major(*matrix)
            .map_err(|source| DatasetError::Pose { path: self.pose_path(line), source })?;
        let depth_path = self.depth_path(file);
        let depth = read_depth(&depth_path, self.units_per_metre)?;
        let color = read_color(&file.path)?;
        require_registered(&color, &depth, &depth_path)?;
        let intrinsics = self.intrinsics.resized(color.width(), color.height());
        let name = file.stem.clone();
        FrameParts { name, timestamp: None, color, depth, intrinsics, world_from_camera: Some(pose) }.into_frame()
    }

    fn has_ground_truth(&self) -> bool {
        false
    }

    fn read_ground_truth(&self, _index: usize) -> Result<Option<SegmentMap>, DatasetError> {
        Ok(None)
    }

    fn format(&self) -> Option<Format> {
        Some(Format::Replica)
    }

    fn left_out(&self) -> &[LeftOut] {
        &self.left_out
    }

    fn file_of(&self, index: usize, part: FramePart) -> PathBuf {
        match (self.frames.get(index), part) {
            (Some(file), FramePart::Depth) => self.depth_path(file),
            (Some(file), FramePart::Pose) => self.pose_path(self.trajectory_line(index, file)),
            (_, FramePart::Intrinsics) => self.folder.join(CAMERA_FILE),
            (None, _) => self.folder.clone(),
        }
    }
}
