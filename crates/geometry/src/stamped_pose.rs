//! A camera pose at a time.

use crate::Pose;

/// A camera pose at a time: one line of a trajectory.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StampedPose {
    /// The time in seconds, from any origin.
    pub seconds: f64,
    /// The camera's pose.
    pub world_from_camera: Pose,
}
