//! Replica (Straub et al., 2019) as rendered for iMAP and laid out by NICE-SLAM: `results/frame000000.jpg`,
//! `results/depth000000.png` (16-bit) and, if there are poses, `traj.txt` with one camera-to-world matrix per line (16
//! numbers, row-major).
//!
//! The camera is described by `cam_params.json` in the scene's folder or its parent, as in NICE-SLAM's archive:
//! `{"camera": {"w", "h", "fx", "fy", "cx", "cy", "scale"}}`, with `scale` depth units per metre.

use crate::decode::read_color;
use crate::depth_file::{DEPTH_SUFFIXES, depth_path, read_depth};
use crate::depth_scale::DepthScale;
use crate::files::is_there;
use crate::listing::{NamePattern, NumberedFile, folder_name, has_numbered_files, left_out_beside, numbered_files};
use crate::own_camera::{OwnCamera, at_resolution, camera_place};
use crate::plausibility::warn_once;
use crate::recorded_poses::{LOST, PoseCoverage, tracked};
use crate::scene::{FramePart, FrameParts, LeftOut, entry, require_registered};
use crate::text::{read_json, read_text_with_numbers, shortened};
use crate::{DatasetError, DatasetSettings, Format, RecordedFrame, Scene};
use serde::Deserialize;
use splatseg_geometry::{Intrinsics, Pose, SegmentMap};
use std::path::{Path, PathBuf};

/// Layout of a Replica folder, for messages.
pub(crate) const LAYOUT: &str = "results/frame000000.jpg, results/depth000000.png, ..., traj.txt (optional), cam_params.json (optional, here or one folder up)";

const COLOR: NamePattern = NamePattern { prefix: "frame", suffixes: &[".png", ".jpg", ".jpeg"] };
const DEPTH: NamePattern = NamePattern { prefix: "depth", suffixes: DEPTH_SUFFIXES };
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
    scale: f64,
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
    /// Row-major, camera-to-world; `None` without a file of poses.
    trajectory: Option<Vec<[f64; 16]>>,
    poses: PoseCoverage,
    own_camera: Option<OwnCamera>,
    intrinsics: Intrinsics,
    /// Where the intrinsics are from, for messages.
    camera_source: String,
    depth_scale: DepthScale,
    left_out: Vec<LeftOut>,
}

impl ReplicaScene {
    /// Lists the frames of a scene's folder, sorted by number, and reads its trajectory and camera. Uses only `fx` to
    /// `cy` and `depth_scale` of `settings`.
    ///
    /// # Errors
    /// If the folder has no colour or no depth images, or the trajectory or camera file is damaged.
    pub fn open(folder: &Path, settings: &DatasetSettings) -> Result<Self, DatasetError> {
        settings.validate()?;
        let images = folder.join(IMAGES_FOLDER);
        let frames = numbered_files(&images, COLOR)?;
        if frames.is_empty() {
            return Err(DatasetError::NoFrames { path: images, expected: "frame<number>.jpg or .png" });
        }
        if !has_numbered_files(&images, DEPTH) {
            return Err(DatasetError::NoFrames { path: images, expected: "depth<number>.png" });
        }
        let path = folder.join(TRAJECTORY);
        let trajectory = if is_there(&path) { Some(read_trajectory(&path)?) } else { None };
        let own_camera = OwnCamera::from_settings(settings)?;
        let StatedCamera { intrinsics, camera_source, depth_scale } = read_camera(folder, settings)?;
        let left_out = left_out_beside(&frames, &images, &[(images.clone(), DEPTH)]);
        let (name, folder, poses) = (folder_name(folder), folder.to_owned(), PoseCoverage::NONE);
        let mut scene = Self {
            name,
            folder,
            frames,
            trajectory,
            poses,
            own_camera,
            intrinsics,
            camera_source,
            depth_scale,
            left_out,
        };
        scene.poses = scene.coverage();
        Ok(scene)
    }

    fn depth_path(&self, file: &NumberedFile) -> PathBuf {
        let digits = file.stem.trim_start_matches(COLOR.prefix);
        depth_path(&self.folder.join(IMAGES_FOLDER), &format!("depth{digits}"))
    }

    /// Returns the file and line of a pose, for messages.
    fn pose_path(&self, line: usize) -> PathBuf {
        PathBuf::from(format!("{}: line {}", self.folder.join(TRAJECTORY).display(), line.saturating_add(1)))
    }

    /// Returns the trajectory line, from 0, of a frame: the line at the frame's index if there are as many lines as
    /// frames, otherwise the line at its number, e.g. if every tenth image was kept with the whole trajectory.
    fn trajectory_line(&self, index: usize, file: &NumberedFile) -> usize {
        if self.trajectory.as_ref().is_some_and(|lines| lines.len() == self.frames.len()) {
            return index;
        }
        usize::try_from(file.number).unwrap_or(usize::MAX)
    }

    /// Counts the frames in which tracking was lost.
    fn coverage(&self) -> PoseCoverage {
        let Some(lines) = &self.trajectory else { return PoseCoverage::NONE };
        let is_lost = |(index, file): &(usize, &NumberedFile)| {
            lines.get(self.trajectory_line(*index, file)).is_some_and(|pose| pose.iter().any(|part| !part.is_finite()))
        };
        let lost = self.frames.iter().enumerate().filter(is_lost).count();
        PoseCoverage::new(self.frames.len(), [(lost, format!("whose pose in {TRAJECTORY} {LOST}"))])
    }

    /// Returns the pose of a frame; `None` if it has none.
    fn pose(&self, index: usize, file: &NumberedFile) -> Result<Option<Pose>, DatasetError> {
        let Some(lines) = &self.trajectory else { return Ok(None) };
        let line = self.trajectory_line(index, file);
        let matrix = lines.get(line).ok_or_else(|| DatasetError::Field {
            path: self.folder.join(TRAJECTORY),
            field: format!("pose of {}", file.stem),
            found: format!("{} lines", lines.len()),
            expected: format!("one for each of {} frames, or at least {}", self.frames.len(), line.saturating_add(1)),
        })?;
        tracked(Pose::from_row_major(*matrix), || self.pose_path(line))
    }
}

/// Returns the required parts of a scene, each with true if the folder has it.
pub(crate) fn parts(path: &Path) -> Vec<(&'static str, bool)> {
    let images = path.join(IMAGES_FOLDER);
    let folder = ("results/", images.is_dir());
    if path.join(TRAJECTORY).is_file() {
        return vec![(TRAJECTORY, true), folder];
    }
    // Other programs name folders like that, too, so it takes more without a trajectory.
    let color = ("results/frame<number>.jpg or .png", has_numbered_files(&images, COLOR));
    vec![folder, color, ("results/depth<number>.png", has_numbered_files(&images, DEPTH))]
}

/// Returns true if a scene has poses.
pub(crate) fn is_whole(path: &Path) -> bool {
    path.join(TRAJECTORY).is_file()
}

/// Returns true if a folder contains a scene.
pub(crate) fn looks_like(path: &Path) -> bool {
    parts(path).iter().all(|(_, is_present)| *is_present)
}

fn read_trajectory(path: &Path) -> Result<Vec<[f64; 16]>, DatasetError> {
    let text = read_text_with_numbers(path, "camera trajectory", MAX_TRAJECTORY_BYTES)?;
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

/// The camera and the unit of depth.
struct StatedCamera {
    intrinsics: Intrinsics,
    camera_source: String,
    depth_scale: DepthScale,
}

/// Reads the camera and the unit of depth, or warns that the published ones are assumed.
fn read_camera(folder: &Path, settings: &DatasetSettings) -> Result<StatedCamera, DatasetError> {
    let own = folder.join(CAMERA_FILE);
    let shared = folder.canonicalize().ok().and_then(|full| Some(full.parent()?.join(CAMERA_FILE)));
    let (params, path, camera_source) =
        match [Some(own.clone()), shared].into_iter().flatten().find(|path| path.is_file()) {
            Some(path) => {
                let file: CameraFile = read_json(&path, "camera file", MAX_CAMERA_FILE_BYTES)?;
                let source = format!("{} says", path.display());
                (file.camera, path, source)
            }
            None => {
                warn_of_published_camera(folder, settings);
                (PUBLISHED, own, "the published Replica has, which is assumed".to_owned())
            }
        };
    let CameraParams { w, h, fx, fy, cx, cy, scale } = params;
    let depth_scale = DepthScale::stated(scale, (&path, "camera.scale"), settings)?;
    let camera = Intrinsics { fx, fy, cx, cy, width: w, height: h };
    let intrinsics = camera.validated().map_err(|source| DatasetError::Intrinsics { path, source })?;
    Ok(StatedCamera { intrinsics, camera_source, depth_scale })
}

/// Warns that the camera or the unit of depth is assumed, unless the settings have them.
fn warn_of_published_camera(folder: &Path, settings: &DatasetSettings) {
    let CameraParams { w, h, fx, scale, .. } = PUBLISHED;
    let camera = format!("camera (focal length {fx} for {w}x{h} pixels: --fx)");
    let unit = format!("unit of depth ({scale} per metre: --depth-scale)");
    let assumed = match (settings.fx, settings.depth_scale) {
        (None, None) => format!("{camera} and {unit}"),
        (None, Some(_)) => camera,
        (Some(_), None) => unit,
        (Some(_), Some(_)) => return,
    };
    warn_once(format!("{}: no {CAMERA_FILE}: assuming the published Replica's {assumed}", folder.display()));
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
        let pose = self.pose(index, file)?;
        let depth_path = self.depth_path(file);
        let depth = read_depth(&depth_path, self.depth_scale)?;
        let color = read_color(&file.path)?;
        require_registered(&color, &depth, &depth_path)?;
        let intrinsics = match self.own_camera {
            Some(camera) => camera.intrinsics(color.size()),
            None => at_resolution(&self.intrinsics, color.size(), (&file.path, &self.camera_source))?,
        };
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
            (_, FramePart::Intrinsics) => camera_place(self.own_camera.as_ref(), &self.folder.join(CAMERA_FILE)),
            (None, _) => self.folder.clone(),
        }
    }
}
