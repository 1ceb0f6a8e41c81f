//! The camera's pose for each frame.

use crate::{CameraPose, InputDoubt, PoseEvent};
use splatseg_geometry::{CameraFrame, FrameAnchor, KeyframeId, MapCorrection, Pose, RemappedId, SegmentMap};
use std::collections::BTreeMap;
use thiserror::Error;

/// Determines the pose of each frame before the method processes it.
pub trait PoseSource: Send {
    /// The pose of the next frame. `given` is the pose that came with the frame, camera to world.
    ///
    /// # Errors
    /// If the frame cannot be used without a pose. The frame is skipped; the next call is for the next frame.
    fn pose(&mut self, frame: &CameraFrame<'_>, given: Option<&Pose>) -> Result<CameraPose, PoseSourceError>;

    /// Receives the segments that the method found in the latest frame, `[height, width]`, 0 for none.
    fn set_segments(&mut self, _segments: &SegmentMap) {}

    /// Announces the next frame: its index in its source, and the corrected poses of earlier frames that became known with
    /// it, by increasing index. Only poses that come with the frames are corrected from outside.
    fn begin_frame(&mut self, _index: usize, _corrected: &[(usize, Pose)]) {}

    /// The keyframe to which the surfaces of the latest frame are attached.
    fn anchor(&self) -> FrameAnchor {
        FrameAnchor::default()
    }

    /// Returns the correction of earlier poses that the latest frame brought. The map must be corrected before that frame
    /// is processed.
    fn take_correction(&mut self) -> Option<MapCorrection> {
        None
    }

    /// Returns what the latest frame has told about the camera and the map.
    fn take_events(&mut self) -> Vec<PoseEvent> {
        Vec::new()
    }

    /// Receives the ids that the method has found to be the same object.
    fn remap(&mut self, _remapped: &[RemappedId]) {}

    /// The present poses of all keyframes, camera to world.
    fn keyframe_poses(&self) -> BTreeMap<KeyframeId, Pose> {
        BTreeMap::new()
    }

    /// The part of the map that each keyframe is in, from 0: where parts are relative to each other is not known.
    fn keyframe_parts(&self) -> BTreeMap<KeyframeId, u32> {
        BTreeMap::new()
    }

    /// Returns the keyframes as bytes of a [`StateBlock`](splatseg_files::StateBlock), to be saved with a map. `None` if
    /// there are none.
    fn keyframes(&self) -> Option<Vec<u8>> {
        None
    }

    /// Loads the keyframes of a saved map, before the first frame: the camera is somewhere in that map.
    ///
    /// # Errors
    /// If the bytes are damaged.
    fn load_keyframes(&mut self, _keyframes: &[u8]) -> Result<(), PoseSourceError> {
        Ok(())
    }

    /// Doubts of the tracked frames about the camera's focal length, a sentence each. Empty if nothing is conspicuous.
    fn calibration_warnings(&self) -> Vec<String> {
        Vec::new()
    }

    /// Returns the contradictions that the latest frame has revealed between what came with the frames and what they show,
    /// each once.
    fn take_input_doubts(&mut self) -> Vec<InputDoubt> {
        Vec::new()
    }

    /// Returns, after the last frame, contradictions that more frames would have been awaited for.
    fn take_last_input_doubts(&mut self) -> Vec<InputDoubt> {
        Vec::new()
    }

    /// Returns the state that [`Self::restore`] needs to continue with the next frame, as bytes of a
    /// [`StateBlock`](splatseg_files::StateBlock). `None` if there is no state.
    fn save(&self) -> Option<Vec<u8>> {
        None
    }

    /// Restores a state from [`Self::save`].
    ///
    /// # Errors
    /// If the state is damaged or from another kind of source.
    fn restore(&mut self, _state: &[u8]) -> Result<(), PoseSourceError> {
        Err(PoseSourceError::State("this source of poses has no state".to_owned()))
    }
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
    fn pose(&mut self, frame: &CameraFrame<'_>, given: Option<&Pose>) -> Result<CameraPose, PoseSourceError> {
        let given = given.copied().map(CameraPose::given);
        given.ok_or_else(|| PoseSourceError::Missing { frame: frame.name().to_owned() })
    }
}
