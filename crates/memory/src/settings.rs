//! The settings of the memory: the paper's constants, and the choices where the paper is silent.

use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Settings of a [`SplatMemory`](crate::SplatMemory). The defaults are the paper's where it gives a value.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MemorySettings {
    /// Channels of a segment-id feature (D); 1 stores the id itself.
    pub feature_dim: usize,
    /// Codes made at the start, and added in one block whenever they run out (N).
    pub num_codes: usize,
    /// A pixel is uncovered, and gets a new Gaussian, where the rendered silhouette is below this.
    pub growth_silhouette: f32,
    /// A pixel gets a new Gaussian where observed and rendered depth differ by more than this, metres.
    pub depth_disparity: f32,
    /// The best code's inner product must exceed this for a pixel to have a segment.
    pub decode_threshold: f32,
    /// What the confidence ‖f‖ of a remembered segment loses in a frame that does not confirm it (C_conf).
    pub confidence_decay: f32,
    /// Gradient-descent steps on the features per frame (N_opt).
    pub num_steps: usize,
    /// Weight of the confidence term, MSE(‖F̂‖, ‖F‖) (λ_mag).
    pub magnitude_weight: f32,
    /// Weight of the direction term, 1 − cos(F̂, F) (λ_dir).
    pub direction_weight: f32,
    /// Step size. Losses are summed over pixels and each Gaussian's step is divided by the sum of its blend weights,
    /// so that one value is stable at every distance; it must stay below 1 / `magnitude_weight`. Not in the paper.
    pub learning_rate: f32,
    /// A pixel is learnt only where the memory shows another segment than the target, where the confidences differ by
    /// more than this, where the directions differ (`active_min_cosine`), or within `active_margin` of such a pixel.
    /// Must be below `confidence_decay`, or fading is never learnt. Negative: every pixel. Not in the paper.
    pub active_tolerance: f32,
    /// Directions differ if their cosine is below this; see `active_tolerance`. Not in the paper.
    pub active_min_cosine: f32,
    /// See `active_tolerance`, pixels. Not in the paper.
    pub active_margin: usize,
    /// Blend weights below this are left out of learning (not of rendering). Not in the paper.
    pub learning_min_weight: f32,
}

impl Default for MemorySettings {
    fn default() -> Self {
        Self {
            feature_dim: 28,
            num_codes: 512,
            growth_silhouette: 0.5,
            depth_disparity: 0.15,
            decode_threshold: 0.5,
            confidence_decay: 0.1,
            num_steps: 20,
            magnitude_weight: 50.0,
            direction_weight: 1.0,
            learning_rate: 0.01,
            active_tolerance: 0.09,
            active_min_cosine: 0.95,
            active_margin: 1,
            learning_min_weight: 0.005,
        }
    }
}

/// A setting outside its range.
#[derive(Clone, Debug, Error, PartialEq)]
#[error("memory.{field} is {found}, expected {expected}")]
pub struct SettingsError {
    /// Name of the field.
    pub field: &'static str,
    /// Its value.
    pub found: String,
    /// What it may be.
    pub expected: &'static str,
}

impl MemorySettings {
    /// Checks every field's range.
    ///
    /// # Errors
    /// [`SettingsError`] names the first field that is out of range.
    pub fn validate(&self) -> Result<(), SettingsError> {
        let error = |field, found: String, expected| Err(SettingsError { field, found, expected });
        if self.feature_dim == 0 || self.feature_dim > 4096 {
            return error("feature_dim", self.feature_dim.to_string(), "1 to 4096");
        }
        if self.num_codes == 0 || self.num_codes > 65_535 {
            return error("num_codes", self.num_codes.to_string(), "1 to 65535");
        }
        let not_negative = [
            ("growth_silhouette", self.growth_silhouette),
            ("depth_disparity", self.depth_disparity),
            ("decode_threshold", self.decode_threshold),
            ("confidence_decay", self.confidence_decay),
            ("magnitude_weight", self.magnitude_weight),
            ("direction_weight", self.direction_weight),
            ("learning_rate", self.learning_rate),
            ("learning_min_weight", self.learning_min_weight),
        ];
        for (field, value) in not_negative {
            if !(value.is_finite() && value >= 0.0) {
                return error(field, value.to_string(), "a number that is not negative");
            }
        }
        for (field, value) in
            [("active_tolerance", self.active_tolerance), ("active_min_cosine", self.active_min_cosine)]
        {
            if value.is_nan() {
                return error(field, value.to_string(), "a number");
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_are_checked() {
        assert_eq!(MemorySettings::default().validate(), Ok(()));
        let error = MemorySettings { feature_dim: 0, ..MemorySettings::default() }.validate().unwrap_err();
        assert_eq!(error.to_string(), "memory.feature_dim is 0, expected 1 to 4096");
        assert!(MemorySettings { learning_rate: f32::NAN, ..MemorySettings::default() }.validate().is_err());
    }
}
