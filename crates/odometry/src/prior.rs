//! The motion model: where the camera is expected before the images are compared.

use crate::linear::Matrix6;
use crate::se3::{self, Twist};
use serde::{Deserialize, Serialize};
use splatseg_geometry::Pose;
use std::time::Duration;

/// Share of the last motion that the next frame is expected to repeat. Less than 1, so that directions that nothing
/// measures come to rest.
const INERTIA: f64 = 0.8;

/// The prediction's error is believed to be at least this: metres per axis, radians per axis.
const MIN_PREDICTION_ERROR: (f64, f64) = (0.004, 0.005);

/// The prediction's error is believed to be at most this: metres per axis, radians per axis.
pub(crate) const MAX_PREDICTION_ERROR: (f64, f64) = (0.3, 0.4);

/// The prediction's error before any is known.
const FIRST_PREDICTION_ERROR: (f64, f64) = (0.03, 0.04);

/// A Gaussian around a predicted pose.
#[derive(Clone, Copy, Debug)]
pub(crate) struct MotionPrior {
    /// The predicted pose.
    pub(crate) predicted: Pose,
    /// Standard deviations of the prediction: of the position along each axis, metres, and of the rotation about each
    /// axis, radians.
    pub(crate) deviations: (f64, f64),
}

impl MotionPrior {
    /// The same prior in other coordinates: `self.predicted` was in those that `from_old` converts from.
    pub(crate) fn in_coordinates(&self, from_old: &Pose) -> Self {
        Self { predicted: *from_old * self.predicted, ..*self }
    }

    /// Adds the prior's part of the normal equations at a pose, for an update from the left.
    pub(crate) fn add_to(&self, pose: &Pose, hessian: &mut Matrix6, gradient: &mut Twist) {
        // exp(error) · predicted = pose, and d(error)/d(ξ) ≈ 1 for small errors. The position that counts is that of
        // the camera: rotation about the keyframe's origin also moves the camera, by little, as it is close.
        let error = se3::logarithm(&(*pose * self.predicted.inverse()));
        let (translation, rotation) = self.deviations;
        for (index, part) in error.into_iter().enumerate() {
            let deviation = if index < 3 { translation } else { rotation };
            let information = 1.0 / (deviation * deviation);
            hessian[index][index] += information;
            gradient[index] += information * part;
        }
    }
}

/// State after the latest frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct LastFrame {
    pub(crate) world_from_camera: Pose,
    /// Previous camera from camera; the identity after a loss.
    pub(crate) motion: Pose,
    /// Running mean of the prediction's error: metres, radians.
    pub(crate) prediction_error: (f64, f64),
    pub(crate) timestamp: Option<Duration>,
    /// Time to the frame before.
    pub(crate) interval: Option<f64>,
    /// Number of frames since the last tracked one.
    pub(crate) lost_frames: usize,
}

impl LastFrame {
    pub(crate) fn first(world_from_camera: Pose, timestamp: Option<Duration>) -> Self {
        let prediction_error = FIRST_PREDICTION_ERROR;
        Self { world_from_camera, motion: Pose::IDENTITY, prediction_error, timestamp, interval: None, lost_frames: 0 }
    }

    /// The pose expected for a frame.
    pub(crate) fn prior(&self, timestamp: Option<Duration>, motion: Option<&Pose>) -> MotionPrior {
        let share = match (self.seconds_to(timestamp), self.interval) {
            (Some(now), Some(before)) => (now / before).clamp(0.2, 5.0),
            _ => 1.0,
        };
        let motion = motion.copied().unwrap_or_else(|| se3::scaled(&self.motion, share * INERTIA));
        let growth = share.max(1.0) * (1 + self.lost_frames.min(1000)) as f64;
        let bounded = |error: f64, least: f64, most: f64| (1.5 * error * growth).clamp(least, most);
        let deviations = (
            bounded(self.prediction_error.0, MIN_PREDICTION_ERROR.0, MAX_PREDICTION_ERROR.0),
            bounded(self.prediction_error.1, MIN_PREDICTION_ERROR.1, MAX_PREDICTION_ERROR.1),
        );
        MotionPrior { predicted: self.world_from_camera * motion, deviations }
    }

    /// The state after a frame in which tracking was lost.
    pub(crate) fn lost(&self) -> Self {
        Self { lost_frames: self.lost_frames.saturating_add(1), motion: Pose::IDENTITY, ..*self }
    }

    pub(crate) fn after(&self, world_from_camera: &Pose, prior: &MotionPrior, timestamp: Option<Duration>) -> Self {
        let (translation, rotation) = se3::size(&(prior.predicted.inverse() * *world_from_camera));
        let mean = |old: f64, new: f64| 0.8 * old + 0.2 * new;
        let (motion, prediction_error) = match self.lost_frames {
            0 => {
                let motion = self.world_from_camera.inverse() * *world_from_camera;
                (motion, (mean(self.prediction_error.0, translation), mean(self.prediction_error.1, rotation)))
            }
            _ => (Pose::IDENTITY, self.prediction_error),
        };
        let interval = self.seconds_to(timestamp);
        Self { world_from_camera: *world_from_camera, motion, prediction_error, timestamp, interval, lost_frames: 0 }
    }

    /// Time from this frame to one with a timestamp, seconds, if it is positive.
    fn seconds_to(&self, timestamp: Option<Duration>) -> Option<f64> {
        let seconds = timestamp?.checked_sub(self.timestamp?)?.as_secs_f64();
        (seconds > 0.0).then_some(seconds)
    }
}
