//! A frame's pose, and how far it can be trusted.

use serde::{Deserialize, Serialize};
use splatseg_geometry::Pose;

/// Whether the camera's pose is known.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum PoseState {
    /// The pose came with the frame.
    Given,
    /// The pose was tracked.
    Tracked,
    /// Tracking is lost. The pose is the last known one; where the camera is now, is unknown.
    Lost,
}

/// A camera's pose with its state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraPose {
    /// The pose, camera to world.
    pub world_from_camera: Pose,
    /// Whether the pose is known.
    pub state: PoseState,
    /// How well the pose fits; `None` for poses that came with the frame, the first frame, and if tracking is lost.
    pub quality: Option<PoseQuality>,
}

/// How well a tracked pose fits its keyframe.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PoseQuality {
    /// Share of the keyframe's points in view, 0 to 1.
    pub overlap: f32,
    /// Share of the measurements that agree with the keyframe, 0 to 1: the mean of depth and image, where both can be
    /// judged.
    pub inliers: f32,
    /// Deviation of the measured depth from the keyframe's surfaces, in units of the noise within the keyframe, or of a
    /// Kinect's if that is more.
    pub residual: f32,
    /// False if the image was too dark, or had too little contrast, to confirm the pose: it is from depth alone.
    pub uses_image: bool,
    /// Standard deviation of the camera's position relative to its keyframe, metres.
    pub position_deviation: f32,
    /// Standard deviation of the camera's rotation relative to its keyframe, radians.
    pub rotation_deviation: f32,
}

impl CameraPose {
    /// A pose that came with the frame.
    pub fn given(world_from_camera: Pose) -> Self {
        Self { world_from_camera, state: PoseState::Given, quality: None }
    }
}
