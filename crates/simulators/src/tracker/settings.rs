//! The error model of the simulated tracker.

use splatseg_settings::{Allowed, settings};

settings! {
    /// The error model of [`SimTracker`](crate::SimTracker). Rates are probabilities. Lengths are pixels of the framed
    /// image. `docs/dev/SIM_TRACKER.md` explains the choice of the defaults.
    #[derive(Copy)]
    pub struct SimTrackerSettings in "sim_tracker" {
        /// Probability that a track is lost when its object comes into view again after being hidden.
        loss_rate: f64 = 1.0, Allowed::between(0.0, 1.0);
        /// Fraction of these losses that last until the next prompt. The others end by themselves.
        lasting_loss_fraction: f64 = 0.9, Allowed::between(0.0, 1.0);
        /// Mean length of the other losses, in frames that show the object (geometrically distributed).
        loss_frames: f64 = 5.0, Allowed::between(1.0, 1e6);
        /// Probability, per track and frame, that it swaps its object with the nearest other track.
        swap_rate: f64 = 0.2, Allowed::between(0.0, 1.0);
        /// Probability, per track and frame, that it switches to the object of the nearest other track.
        duplicate_rate: f64 = 0.2, Allowed::between(0.0, 1.0);
        /// Probability, per track and frame, that its mask begins to grow into a neighbouring object.
        drift_rate: f64 = 0.2, Allowed::between(0.0, 1.0);
        /// Growth of a drifting mask per frame, pixels.
        drift_px_per_frame: f64 = 6.0, Allowed::between(0.0, 1000.0);
    }
}

impl SimTrackerSettings {
    /// A tracker that makes no errors.
    pub const PERFECT: Self = Self {
        loss_rate: 0.0,
        lasting_loss_fraction: 0.0,
        loss_frames: 1.0,
        swap_rate: 0.0,
        duplicate_rate: 0.0,
        drift_rate: 0.0,
        drift_px_per_frame: 0.0,
    };
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_out_of_range_are_named() {
        let perfect = SimTrackerSettings::PERFECT;
        let error = perfect.with(|settings| settings.swap_rate = 1.5).validate().unwrap_err();
        assert_eq!(error.to_string(), "sim_tracker.swap_rate is 1.5, expected 0 to 1");
        assert!(perfect.with(|settings| settings.loss_frames = 0.0).validate().is_err());
        assert!(perfect.with(|settings| settings.drift_rate = f64::NAN).validate().is_err());
        assert!(SimTrackerSettings::default().validate().is_ok());
    }
}
