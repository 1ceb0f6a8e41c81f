//! What every format offers, and how each of them puts a frame together.

use crate::decode::DEPTH_IMAGE;
use crate::{DatasetError, Format};
use splatseg_geometry::{Image, Intrinsics, Pose, RgbdFrame, SegmentMap};
use std::fmt::Debug;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// A recorded or rendered RGB-D video whose frames can be read in any order, from any thread.
///
/// A scene of your own implements this trait and reports its own errors as [`DatasetError::Other`].
pub trait Scene: Debug + Send + Sync {
    /// The scene's name, e.g. its folder's.
    fn name(&self) -> &str;

    /// Number of frames.
    fn frame_count(&self) -> usize;

    /// The name of frame `index`, e.g. `frame-000150` or `42`; empty past the last frame.
    fn frame_name(&self, index: usize) -> String;

    /// Reads frame `index`, which carries the name [`Scene::frame_name`] gives.
    ///
    /// # Errors
    /// [`DatasetError`] names the file and what is wrong with it. Other frames can still be read.
    fn read_frame(&self, index: usize) -> Result<RgbdFrame<'static>, DatasetError>;

    /// Whether the scene comes with true segments.
    fn has_ground_truth(&self) -> bool;

    /// The true segments of frame `index`, of the size of the frame that [`Scene::read_frame`] gives; `None` if this
    /// frame, or the whole scene, is not labelled.
    ///
    /// # Errors
    /// [`DatasetError`] names the file and what is wrong with it.
    fn read_ground_truth(&self, index: usize) -> Result<Option<SegmentMap>, DatasetError>;

    /// The scene's format; `None` for a scene of your own.
    fn format(&self) -> Option<Format> {
        None
    }

    /// The size `(width, height)` in which the colour image of frame `index` is stored, where [`Scene::read_frame`]
    /// gives it another; otherwise `None`.
    fn stored_color_size(&self, _index: usize) -> Option<(usize, usize)> {
        None
    }

    /// The frames that were found on opening and left out, each kind once.
    fn left_out(&self) -> &[LeftOut] {
        &[]
    }

    /// What the scene's parts were found in, one line each, where that is not obvious from its files.
    fn sources(&self) -> &[String] {
        &[]
    }

    /// The file from which a part of frame `index` is read, for messages.
    fn file_of(&self, index: usize, _part: FramePart) -> PathBuf {
        PathBuf::from(format!("{}: frame {}", self.name(), self.frame_name(index)))
    }
}

/// A part of a frame that may have a file of its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FramePart {
    /// The depth image.
    Depth,
    /// The camera's pose.
    Pose,
    /// The camera's intrinsics.
    Intrinsics,
}

/// Frames that a scene found but does not use.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LeftOut {
    /// How many frames there are.
    pub count: usize,
    /// What is wrong with them, e.g. `without a colour image`.
    pub what: String,
}

impl LeftOut {
    /// A list with those kinds of which there are any.
    pub(crate) fn list<const N: usize>(kinds: [(usize, String); N]) -> Vec<Self> {
        kinds.into_iter().filter(|(count, _)| *count > 0).map(|(count, what)| Self { count, what }).collect()
    }
}

/// What a format has read of one frame.
pub(crate) struct FrameParts {
    pub(crate) name: String,
    pub(crate) timestamp: Option<Duration>,
    pub(crate) color: Image<[u8; 3]>,
    pub(crate) depth: Image<f32>,
    pub(crate) intrinsics: Intrinsics,
    pub(crate) world_from_camera: Pose,
}

impl FrameParts {
    /// The frame. Its parts must have the same size, which [`require_registered`] checks earlier, with the file's name.
    pub(crate) fn into_frame(self) -> Result<RgbdFrame<'static>, DatasetError> {
        let Self { name, timestamp, color, depth, intrinsics, world_from_camera } = self;
        RgbdFrame::new(name.clone(), color, depth, intrinsics, world_from_camera)
            .map(|frame| frame.with_timestamp(timestamp))
            .map_err(|source| DatasetError::Frame { name, source })
    }
}

/// Requires that a depth image, read from `depth_path`, has the size of its colour image.
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

/// The entry of frame `index` in the list of a scene's frames.
pub(crate) fn entry<'a, T>(frames: &'a [T], index: usize, scene: &str) -> Result<&'a T, DatasetError> {
    let count = frames.len();
    frames.get(index).ok_or_else(|| DatasetError::NoSuchFrame { scene: scene.to_owned(), index, count })
}
