//! The interface that every format implements, and the assembly of frames from their parts.

use crate::error::DEPTH_IMAGE;
use crate::{CorrectedPose, DatasetError, Format, GuessedCamera};
use glam::DVec3;
use splatseg_geometry::{CameraFrame, Image, Intrinsics, Pose, RgbdFrame, SegmentMap};
use std::fmt::Debug;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// A recorded or rendered RGB-D video whose frames can be read in any order, from any thread.
///
/// Implement this trait for your own kind of scene, and report its errors as [`DatasetError::Other`].
pub trait Scene: Debug + Send + Sync {
    /// Returns the scene's name, e.g. that of its folder.
    fn name(&self) -> &str;

    /// Returns the number of frames.
    fn frame_count(&self) -> usize;

    /// Returns the name of frame `index`, e.g. `frame-000150` or `42`. Empty past the last frame.
    fn frame_name(&self, index: usize) -> String;

    /// Reads frame `index` and the pose of its camera. The frame's name is [`Scene::frame_name`].
    ///
    /// The pose is `None` if none was recorded for this frame: its file, line or message is missing, or contains NaN or
    /// infinity, because tracking was lost.
    ///
    /// # Errors
    /// [`DatasetError`] with the file and the problem, also for a damaged pose: one that is not a rigid transform, or
    /// text that is not numbers. Other frames can still be read.
    fn read_recorded(&self, index: usize) -> Result<RecordedFrame, DatasetError>;

    /// Reads frame `index`, which must have a pose.
    ///
    /// # Errors
    /// As [`Scene::read_recorded`], and [`DatasetError::NoPose`].
    fn read_frame(&self, index: usize) -> Result<RgbdFrame<'static>, DatasetError> {
        let RecordedFrame { frame, world_from_camera } = self.read_recorded(index)?;
        match world_from_camera {
            Some(pose) => Ok(frame.at(pose)),
            None => Err(DatasetError::NoPose { scene: self.name().to_owned(), frame: frame.name().to_owned() }),
        }
    }

    /// Returns true if at least one frame is expected to have a pose. Reads no frame.
    fn has_poses(&self) -> bool {
        true
    }

    /// Returns false if no frame has depth, so that it must be predicted. Reads no frame.
    fn has_depth(&self) -> bool {
        true
    }

    /// Returns the camera that is assumed if nothing describes it: `--fx` sets it. `None` if it is known. Reads no frame.
    fn guessed_camera(&self) -> Option<GuessedCamera> {
        None
    }

    /// Returns the direction that is up in the world of the scene's poses, a unit vector, if the format defines it: phones
    /// measure gravity. Reads no frame.
    fn world_up(&self) -> Option<DVec3> {
        None
    }

    /// Returns the frames without a pose in a scene that has others, one entry per reason, as far as this was known when
    /// the scene was opened.
    fn without_pose(&self) -> &[LeftOut] {
        &[]
    }

    /// Returns the corrected poses that became known with the frames of a range, at most one per corrected frame (the
    /// last), by increasing frame. A pose that became known with a frame corrects an earlier one. Reads no frame.
    fn corrections(&self, _known_with: Range<usize>) -> Vec<CorrectedPose> {
        Vec::new()
    }

    /// Returns true if the scene has ground truth segments.
    fn has_ground_truth(&self) -> bool;

    /// Reads the ground truth segments of frame `index`, with the same size as the frame returned by
    /// [`Scene::read_frame`]. Returns `None` if this frame, or the whole scene, is not labelled.
    ///
    /// # Errors
    /// [`DatasetError`] names the file and the problem.
    fn read_ground_truth(&self, index: usize) -> Result<Option<SegmentMap>, DatasetError>;

    /// Returns the scene's format. `None` for scenes implemented outside this crate.
    fn format(&self) -> Option<Format> {
        None
    }

    /// Returns the size `(width, height)` of the stored colour image of frame `index`, if [`Scene::read_frame`] returns
    /// it with another size. Otherwise `None`.
    fn stored_color_size(&self, _index: usize) -> Option<(usize, usize)> {
        None
    }

    /// Returns the frames that were found but skipped when the scene was opened, one entry per reason.
    fn left_out(&self) -> &[LeftOut] {
        &[]
    }

    /// Returns the sources of the scene's data, one line each, if its files do not make them obvious.
    fn sources(&self) -> &[String] {
        &[]
    }

    /// Returns the file that contains a part of frame `index`, for messages.
    fn file_of(&self, index: usize, _part: FramePart) -> PathBuf {
        PathBuf::from(format!("{}: frame {}", self.name(), self.frame_name(index)))
    }
}

/// A part of a frame that may be stored in its own file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FramePart {
    /// The depth image.
    Depth,
    /// The camera's pose.
    Pose,
    /// The camera's intrinsics.
    Intrinsics,
}

/// A frame as it was recorded.
#[derive(Clone, Debug, PartialEq)]
pub struct RecordedFrame {
    /// The images and the camera's intrinsics.
    pub frame: CameraFrame<'static>,
    /// The camera's pose, if it was recorded for this frame.
    pub world_from_camera: Option<Pose>,
}

impl From<RgbdFrame<'static>> for RecordedFrame {
    fn from(frame: RgbdFrame<'static>) -> Self {
        let world_from_camera = Some(*frame.world_from_camera());
        Self { frame: frame.into_camera_frame(), world_from_camera }
    }
}

/// Frames that a scene contains but skips, or that lack something.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LeftOut {
    /// Number of frames.
    pub count: usize,
    /// Reason, e.g. `without a colour image`.
    pub what: String,
}

impl LeftOut {
    /// Keeps the reasons that apply to at least one frame.
    pub(crate) fn list<const N: usize>(kinds: [(usize, String); N]) -> Vec<Self> {
        kinds.into_iter().filter(|(count, _)| *count > 0).map(|(count, what)| Self { count, what }).collect()
    }
}

/// Data of one frame, as read by a format.
pub(crate) struct FrameParts {
    pub(crate) name: String,
    pub(crate) timestamp: Option<Duration>,
    pub(crate) color: Image<[u8; 3]>,
    pub(crate) depth: Image<f32>,
    pub(crate) intrinsics: Intrinsics,
    pub(crate) world_from_camera: Option<Pose>,
}

impl FrameParts {
    /// Builds the frame. Its parts must have the same size. [`require_registered`] checks this earlier, with the file's
    /// name.
    pub(crate) fn into_frame(self) -> Result<RecordedFrame, DatasetError> {
        let Self { name, timestamp, color, depth, intrinsics, world_from_camera } = self;
        let frame = CameraFrame::new(name.clone(), color, depth, intrinsics)
            .map_err(|source| DatasetError::Frame { name, source })?;
        Ok(RecordedFrame { frame: frame.with_timestamp(timestamp), world_from_camera })
    }
}

/// Checks that the depth image read from `depth_path` has the size of its colour image.
pub(crate) fn require_registered(
    color: &Image<[u8; 3]>,
    depth: &Image<f32>,
    depth_path: &Path,
) -> Result<(), DatasetError> {
    if depth.size() == color.size() {
        return Ok(());
    }
    Err(DatasetError::SizesDiffer {
        path: depth_path.to_owned(),
        what: DEPTH_IMAGE,
        found: depth.size(),
        expected: color.size(),
        expected_from: "its colour image",
    })
}

/// Returns the entry of frame `index` in a scene's list of frames.
pub(crate) fn entry<'a, T>(frames: &'a [T], index: usize, scene: &str) -> Result<&'a T, DatasetError> {
    let count = frames.len();
    frames.get(index).ok_or_else(|| DatasetError::NoSuchFrame { scene: scene.to_owned(), index, count })
}
