//! Messages about the source of the camera's poses.

use splatseg::odometry::{CameraPose, PoseMode, PoseState};
use splatseg::summary::RunCounts;

/// From this many frames on, the residuals are judged.
const MIN_FRAMES: usize = 30;

/// Median deviation of the measured depth from the tracked surfaces, in units of a Kinect's deviation, above which the
/// camera's intrinsics or its depth are probably wrong. Kinect videos have 1 to 2.
const MAX_RESIDUAL: f32 = 3.0;

/// Maximum number of messages about lost tracking.
const MAX_MESSAGES: usize = 10;

/// Describes the source of the poses of a scene, at the start of a run.
pub fn described(mode: PoseMode, has_poses: bool) -> &'static str {
    match (mode, has_poses) {
        (PoseMode::Auto, true) => "poses: given; frames without one are tracked",
        (PoseMode::Auto, false) => "poses: none given, the camera is tracked",
        (PoseMode::Given, _) => "poses: given; frames without one are skipped",
        (PoseMode::Refine, true) => "poses: given, refined by tracking",
        (PoseMode::Refine, false) => "poses: none given to refine, the camera is tracked",
        // `PoseMode` may get more values.
        _ => "poses: the camera is tracked",
    }
}

/// Follows the state of the camera's poses during a run.
#[derive(Debug, Default)]
pub struct CameraMessages {
    state: Option<PoseState>,
    messages: usize,
}

impl CameraMessages {
    /// Records a frame. Returns a message if tracking was lost or has resumed.
    pub fn add(&mut self, frame: &str, pose: &CameraPose) -> Option<String> {
        let before = self.state.replace(pose.state);
        let message = match (before, pose.state) {
            (Some(PoseState::Lost), PoseState::Lost) => return None,
            (_, PoseState::Lost) => format!("frame {frame}: tracking of the camera is lost; the map does not change"),
            (Some(PoseState::Lost), _) => format!("frame {frame}: the camera's pose is known again"),
            _ => return None,
        };
        self.messages += 1;
        match self.messages {
            ..=MAX_MESSAGES => Some(message),
            _ => None,
        }
    }
}

/// Returns a warning if the depth fits the tracked camera badly in most frames.
pub fn misfit(counts: &RunCounts) -> Option<String> {
    let residual = counts.pose_residual().filter(|_| counts.pose_residuals.len() >= MIN_FRAMES)?;
    (residual > MAX_RESIDUAL).then(|| {
        format!(
            "the depth of consecutive frames differs by {residual:.1} times a Kinect's noise: check the focal length, the \
             unit of the depth, and whether it is registered to the colour"
        )
    })
}
