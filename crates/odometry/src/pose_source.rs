//! The camera's pose for each frame.

use crate::{CameraPose, InputDoubt, PoseEvent};
use splatseg_geometry::{
    CameraFrame, FrameAnchor, KeyframeId, MapCorrection, Pose, QuarterTurn, RemappedId, SegmentMap,
};
use std::collections::BTreeMap;
use thiserror::Error;

/// Determines the pose of each frame before the method processes it.
///
/// For each frame, [`Self::pose`] is called, then [`Self::receive`] with what the method has found. [`Self::finish`] is
/// called after the last one.
pub trait PoseSource: Send {
    /// The pose of the next frame, and what else the source has found out with it.
    ///
    /// # Errors
    /// If the frame cannot be used without a pose. The frame is skipped; the next call is for the next frame, and its
    /// update has what this one would have told.
    fn pose(&mut self, frame: &CameraFrame<'_>, input: PoseInput<'_>) -> Result<PoseUpdate, PoseSourceError>;

    /// Receives what the method has found: at once the ids that a correction of the map has joined, and after the frame
    /// its segments.
    fn receive(&mut self, _found: MethodFindings<'_>) {}

    /// The keyframes as they are now.
    fn keyframes(&self) -> BTreeMap<KeyframeId, KeyframePlace> {
        BTreeMap::new()
    }

    /// The keyframe of this number as in [`Self::keyframes`], for a source that finds it faster.
    fn keyframe(&self, id: KeyframeId) -> Option<KeyframePlace> {
        self.keyframes().remove(&id)
    }

    /// The turn after which images of the camera are upright, as [`PoseUpdate::turn`] told it with the latest frame.
    fn turn(&self) -> QuarterTurn {
        QuarterTurn::None
    }

    /// Returns, after the last frame, doubts that only all frames together justify.
    fn finish(&mut self) -> Vec<InputDoubt> {
        Vec::new()
    }

    /// Returns the state after the latest frame as bytes of a [`StateBlock`](splatseg_files::StateBlock), for
    /// [`Self::restore`] of another source with the same settings. `None` if there is nothing to save.
    fn save(&self, _scope: StateScope) -> Option<Vec<u8>> {
        None
    }

    /// Continues with a saved state, before the first frame. A source without keyframes ignores those of a map.
    ///
    /// # Errors
    /// If the state is damaged, of another scope or from another kind of source.
    fn restore(&mut self, scope: StateScope, _state: &[u8]) -> Result<(), PoseSourceError> {
        match scope {
            StateScope::Map => Ok(()),
            StateScope::Run => Err(PoseSourceError::State("this source of poses has no state".to_owned())),
        }
    }
}

/// Input of a source of poses for a frame.
#[derive(Clone, Copy, Debug, Default)]
pub struct PoseInput<'a> {
    /// Index of the frame in its source.
    pub index: usize,
    /// The pose that came with the frame, camera to world.
    pub given: Option<&'a Pose>,
    /// Corrected poses of earlier frames that became known with this one, by increasing index. Only poses that come
    /// with the frames are corrected from outside.
    pub corrected: &'a [(usize, Pose)],
}

impl<'a> PoseInput<'a> {
    /// A frame with or without a pose, and no corrections.
    pub const fn new(index: usize, given: Option<&'a Pose>) -> Self {
        Self { index, given, corrected: &[] }
    }
}

/// Output of a source of poses for a frame.
#[derive(Clone, Debug, PartialEq)]
pub struct PoseUpdate {
    /// The frame's pose.
    pub pose: CameraPose,
    /// The keyframe to which the surfaces of the frame are attached.
    pub anchor: FrameAnchor,
    /// The correction of earlier poses that the frame has brought. The map must be corrected before the frame is
    /// processed.
    pub correction: Option<MapCorrection>,
    /// News about the camera and the map.
    pub events: Vec<PoseEvent>,
    /// Doubts about the input that have arisen, each once.
    pub doubts: Vec<InputDoubt>,
    /// The turn after which images of the camera, as it is held now, are upright. [`QuarterTurn::None`] if that is not
    /// known.
    pub turn: QuarterTurn,
}

impl From<CameraPose> for PoseUpdate {
    /// A pose without anything else.
    fn from(pose: CameraPose) -> Self {
        let (anchor, turn) = (FrameAnchor::default(), QuarterTurn::None);
        Self { pose, anchor, correction: None, events: Vec::new(), doubts: Vec::new(), turn }
    }
}

/// Result of the method for a frame.
#[derive(Clone, Copy, Debug, Default)]
pub struct MethodFindings<'a> {
    /// Ids that turned out to be the same object.
    pub remapped: &'a [RemappedId],
    /// The frame's segments, `[height, width]`, 0 for none, with the ids that are left; `None` before it is processed.
    pub segments: Option<&'a SegmentMap>,
}

/// Where a keyframe is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KeyframePlace {
    /// Its pose, camera to world.
    pub world_from_keyframe: Pose,
    /// The part of the map that it is in, from 0: where parts are relative to each other is not known.
    pub part: u32,
}

/// Purpose of a saved state.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum StateScope {
    /// The same run goes on with the next frame: all that its poses depend on.
    Run,
    /// Another run uses the map: the keyframes by which a camera finds its place in it.
    Map,
}

/// The poses that come with the frames.
#[derive(Clone, Copy, Debug, Default)]
pub struct GivenPoses;

/// Errors determining a frame's pose.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum PoseSourceError {
    /// The frame came without a pose.
    #[error("frame {frame} has no pose")]
    Missing {
        /// The frame's name.
        frame: String,
    },
    /// A saved state cannot be used.
    #[error("the saved state of the camera's poses cannot be used: {0}")]
    State(String),
}

impl PoseSource for GivenPoses {
    fn pose(&mut self, frame: &CameraFrame<'_>, input: PoseInput<'_>) -> Result<PoseUpdate, PoseSourceError> {
        let given = input.given.copied().map(|pose| CameraPose::given(pose).into());
        given.ok_or_else(|| PoseSourceError::Missing { frame: frame.name().to_owned() })
    }
}
