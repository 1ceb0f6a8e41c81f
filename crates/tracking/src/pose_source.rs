//! The camera's pose for each frame.

use splatseg_geometry::{CameraFrame, Pose};
use splatseg_memory::SplatMemory;
use thiserror::Error;

/// Determines the pose of each frame before the method processes it.
pub trait PoseSource: Send {
    /// The pose of the next frame, camera to world. `given` is the pose that came with the frame. `memory` is the
    /// method's memory after the previous frame, if the method has one.
    ///
    /// # Errors
    /// If the pose cannot be determined. The frame is skipped; the next call is for the next frame.
    fn pose(
        &mut self,
        frame: &CameraFrame<'_>,
        given: Option<&Pose>,
        memory: Option<&SplatMemory>,
    ) -> Result<Pose, PoseSourceError>;
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
}

impl PoseSource for GivenPoses {
    fn pose(
        &mut self,
        frame: &CameraFrame<'_>,
        given: Option<&Pose>,
        _: Option<&SplatMemory>,
    ) -> Result<Pose, PoseSourceError> {
        given.copied().ok_or_else(|| PoseSourceError::Missing { frame: frame.name().to_owned() })
    }
}
