//! The motion model: where the camera is expected before the images are compared.

use crate::se3::{self, Twist};
use serde::{Deserialize, Serialize};
use splatseg_geometry::Pose;
use std::time::Duration;

/// Share of the last motion that the next frame is expected to repeat. Less than 1, so that directions that nothing
/// measures come to rest.
const INERTIA: f64 = 0.8;

/// In directions that the images do not measure, the camera is believed to be this close to the prediction, metres, as in
/// [`scaled`].
const ERROR_IF_UNKNOWN: f64 = 0.004;

/// In directions that the images measure, the prediction's error is believed to be at least this, metres. A tighter prior
/// would pull every pose a little towards the prediction, and with each new keyframe that error would stay.
const MIN_ERROR: f64 = 0.03;

/// The prediction's error is believed to be at most this, metres per direction.
pub(crate) const MAX_ERROR: f64 = 0.6;

/// The prediction's error before any is known.
const FIRST_ERROR: f64 = 0.05;

/// How far a rotation moves typical surfaces, metres per radian.
const LEVER: f64 = 2.0;

/// A twist in metres: rotations by the motion of surfaces at [`LEVER`] metres.
pub(crate) fn scaled(twist: &Twist) -> Twist {
    std::array::from_fn(|index| if index < 3 { twist[index] } else { twist[index] * LEVER })
}

/// The inverse of [`scaled`].
pub(crate) fn unscaled(twist: &Twist) -> Twist {
    std::array::from_fn(|index| if index < 3 { twist[index] } else { twist[index] / LEVER })
}

/// A Gaussian around a predicted pose.
#[derive(Clone, Copy, Debug)]
pub(crate) struct MotionPrior {
    /// The predicted pose.
    pub(crate) predicted: Pose,
    /// Standard deviation of the prediction, metres per direction, as in [`scaled`].
    pub(crate) deviation: f64,
}

impl MotionPrior {
    /// The same prior in other coordinates: `self.predicted` was in those that `from_old` converts from.
    pub(crate) fn in_coordinates(&self, from_old: &Pose) -> Self {
        Self { predicted: *from_old * self.predicted, ..*self }
    }

    /// Deviation of a pose from the predicted one, as a twist from the left.
    pub(crate) fn error(&self, pose: &Pose) -> Twist {
        // exp(error) · predicted = pose. The position that counts is that of the camera: rotation about the keyframe's
        // origin also moves the camera, by little, as it is close.
        se3::logarithm(&(*pose * self.predicted.inverse()))
    }

    /// Information about a direction, 1/m², of which `unknown` is 0 if the images measure it and 1 if they do not.
    pub(crate) fn information(&self, unknown: f64) -> f64 {
        let deviation = self.deviation.max(MIN_ERROR);
        1.0 / (deviation * deviation) + unknown / (ERROR_IF_UNKNOWN * ERROR_IF_UNKNOWN)
    }
}

/// State after the latest frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct LastFrame {
    pub(crate) world_from_camera: Pose,
    /// Previous camera from camera; the identity after a loss.
    pub(crate) motion: Pose,
    /// Running mean of the prediction's error, metres.
    pub(crate) prediction_error: f64,
    pub(crate) timestamp: Option<Duration>,
    /// Time to the frame before.
    pub(crate) interval: Option<f64>,
    /// Number of frames since the last tracked one.
    pub(crate) lost_frames: usize,
}

impl LastFrame {
    pub(crate) fn first(world_from_camera: Pose, timestamp: Option<Duration>) -> Self {
        let prediction_error = FIRST_ERROR;
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
        let deviation = (1.5 * self.prediction_error * growth).min(MAX_ERROR);
        MotionPrior { predicted: self.world_from_camera * motion, deviation }
    }

    /// The state after a frame in which tracking was lost.
    pub(crate) fn lost(&self) -> Self {
        Self { lost_frames: self.lost_frames.saturating_add(1), motion: Pose::IDENTITY, ..*self }
    }

    pub(crate) fn after(&self, world_from_camera: &Pose, prior: &MotionPrior, timestamp: Option<Duration>) -> Self {
        let (motion, prediction_error) = match self.lost_frames {
            0 => {
                let error = scaled(&se3::logarithm(&(prior.predicted.inverse() * *world_from_camera)));
                let length = error.iter().map(|part| part * part).sum::<f64>().sqrt();
                (self.world_from_camera.inverse() * *world_from_camera, 0.8 * self.prediction_error + 0.2 * length)
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
