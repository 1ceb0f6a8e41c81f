//! How much the simulated tracker errs.

use crate::TrackerError;
use serde::{Deserialize, Serialize};
use std::ops::RangeInclusive;

/// The error model of [`SimTracker`](crate::SimTracker). Rates are probabilities in [0, 1], lengths are pixels of the
/// framed image. How the defaults were chosen stands in `docs/SIM_TRACKER.md`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SimTrackerSettings {
    /// Probability that a track is lost when its object comes into view again after it was hidden.
    pub loss_rate: f64,
    /// Share of these losses that last for good; the others end by themselves.
    pub lasting_loss_share: f64,
    /// Mean length of the others, in frames that show the object (geometrically distributed). At least 1.
    pub loss_frames: f64,
    /// Probability, per track and frame, that it swaps its object with the nearest other track.
    pub swap_rate: f64,
    /// Probability, per track and frame, that it leaves its object and follows that of the nearest other track.
    pub duplicate_rate: f64,
    /// Probability, per track and frame, that its mask begins to grow into a neighbouring object.
    pub drift_rate: f64,
    /// How far a drifting mask grows in a frame, pixels.
    pub drift_px_per_frame: f64,
}

impl Default for SimTrackerSettings {
    fn default() -> Self {
        Self {
            loss_rate: 1.0,
            lasting_loss_share: 0.9,
            loss_frames: 5.0,
            swap_rate: 0.2,
            duplicate_rate: 0.2,
            drift_rate: 0.2,
            drift_px_per_frame: 6.0,
        }
    }
}

impl SimTrackerSettings {
    /// A tracker that makes no error.
    pub const PERFECT: Self = Self {
        loss_rate: 0.0,
        lasting_loss_share: 0.0,
        loss_frames: 1.0,
        swap_rate: 0.0,
        duplicate_rate: 0.0,
        drift_rate: 0.0,
        drift_px_per_frame: 0.0,
    };

    /// The settings, if all are in range.
    ///
    /// # Errors
    /// [`TrackerError::Setting`] names the first that is not.
    pub fn validated(self) -> Result<Self, TrackerError> {
        let rates = [
            ("sim_tracker.loss_rate", self.loss_rate),
            ("sim_tracker.lasting_loss_share", self.lasting_loss_share),
            ("sim_tracker.swap_rate", self.swap_rate),
            ("sim_tracker.duplicate_rate", self.duplicate_rate),
            ("sim_tracker.drift_rate", self.drift_rate),
        ];
        for (field, found) in rates {
            check(field, found, 0.0..=1.0, "0 to 1")?;
        }
        check("sim_tracker.loss_frames", self.loss_frames, 1.0..=1e6, "1 to 1000000 frames")?;
        check("sim_tracker.drift_px_per_frame", self.drift_px_per_frame, 0.0..=1000.0, "0 to 1000 pixels")?;
        Ok(self)
    }
}

fn check(
    field: &'static str,
    found: f64,
    range: RangeInclusive<f64>,
    expected: &'static str,
) -> Result<(), TrackerError> {
    if range.contains(&found) {
        return Ok(());
    }
    Err(TrackerError::Setting { field, found: found.to_string(), expected })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn impossible_rates_are_named() {
        let error = SimTrackerSettings { swap_rate: 1.5, ..SimTrackerSettings::PERFECT }.validated().unwrap_err();
        assert_eq!(error.to_string(), "sim_tracker.swap_rate is 1.5, expected 0 to 1");
        assert!(SimTrackerSettings { loss_frames: 0.0, ..SimTrackerSettings::PERFECT }.validated().is_err());
        assert!(SimTrackerSettings { drift_rate: f64::NAN, ..SimTrackerSettings::PERFECT }.validated().is_err());
        assert!(SimTrackerSettings::default().validated().is_ok());
    }
}
