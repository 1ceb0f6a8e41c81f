//! The oracle's error model.

use serde::Serialize;
use splatseg_settings::{Allowed, Choice, SettingError, choices, settings};

choices! {
    /// A preset of error rates.
    pub enum OraclePreset, default Perfect {
        /// No errors: the true segments as they are.
        Perfect = "perfect",
        /// Errors with which a method without memory scores about the same as FastSAM in the paper's ScanNet-MV table.
        /// `docs/dev/ORACLE.md` describes the calibration.
        FastsamLike = "fastsam-like",
    }
}

settings! {
    /// Settings of the oracle: a preset, and values that override it.
    ///
    /// Settings that are not given have the preset's values. So `preset = "fastsam-like"` with `miss_rate = 0.0` is
    /// this preset without misses in single frames. [`OracleSettings::resolved`] returns the values in use.
    pub struct OracleSettings in "oracle" {
        /// Preset for the settings that are not given.
        preset: OraclePreset = OraclePreset::Perfect, Allowed::Names(OraclePreset::NAMES);
        /// Fraction of objects that are never found.
        persistent_miss_rate: Option<f64> = None, Allowed::between(0.0, 1.0);
        /// Probability that a mask (an object, a piece of one, or merged objects) is not found in a frame, drawn
        /// independently for each frame.
        miss_rate: Option<f64> = None, Allowed::between(0.0, 1.0);
        /// Probability that an object is found in pieces in a frame, cut by straight lines in the image.
        split_rate: Option<f64> = None, Allowed::between(0.0, 1.0);
        /// Maximum number of pieces of a split object. The number is uniformly distributed from 2 to this.
        max_parts: Option<usize> = None, Allowed::between(2.0, 16.0);
        /// Probability that an object is merged with a neighbour that touches it in the frame. The neighbour is drawn
        /// with a probability proportional to the length of the shared border. Objects without neighbours are not
        /// merged.
        merge_rate: Option<f64> = None, Allowed::between(0.0, 1.0);
        /// Fraction of the frames in which a fixed random draw per object decides whether and how it is split or
        /// merged. In the other frames a fresh draw decides. The rates do not depend on this setting.
        persistence: Option<f64> = None, Allowed::between(0.0, 1.0);
        /// Standard deviation of the displacement of a mask's outline along each axis, pixels. The displacement is
        /// smooth along the outline and independent from frame to frame.
        boundary_jitter_px: Option<f32> = None, Allowed::between(0.0, 50.0);
        /// Distance over which the outline's displacement varies, pixels.
        boundary_wavelength_px: Option<f32> = None, Allowed::between(1.0, 1000.0);
        /// Expected number of false positives in a frame: masks at random positions, Poisson distributed.
        false_positives_per_frame: Option<f64> = None, Allowed::between(0.0, 100.0);
        /// Median radius of false positives, pixels.
        false_positive_radius_px: Option<f32> = None, Allowed::between(1.0, 1000.0);
        /// Objects and masks with fewer pixels in a frame are not found.
        min_area_px: Option<usize> = None, Allowed::between(0.0, 1e9);
        /// Standard deviation of the score noise. Without noise a score is 0.4 + 0.6 · IoU with the best-fitting true
        /// object: 1 for an exact mask, FastSAM's confidence threshold for one without overlap.
        score_noise: Option<f32> = None, Allowed::between(0.0, 1.0);
    }
}

/// Parameters of the error model. Rates are probabilities in [0, 1]. Lengths are pixels of the framed image.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct OracleErrorModel {
    /// See [`OracleSettings::persistent_miss_rate`].
    pub persistent_miss_rate: f64,
    /// See [`OracleSettings::miss_rate`].
    pub miss_rate: f64,
    /// See [`OracleSettings::split_rate`].
    pub split_rate: f64,
    /// See [`OracleSettings::max_parts`].
    pub max_parts: usize,
    /// See [`OracleSettings::merge_rate`].
    pub merge_rate: f64,
    /// See [`OracleSettings::persistence`].
    pub persistence: f64,
    /// See [`OracleSettings::boundary_jitter_px`].
    pub boundary_jitter_px: f32,
    /// See [`OracleSettings::boundary_wavelength_px`].
    pub boundary_wavelength_px: f32,
    /// See [`OracleSettings::false_positives_per_frame`].
    pub false_positives_per_frame: f64,
    /// See [`OracleSettings::false_positive_radius_px`].
    pub false_positive_radius_px: f32,
    /// See [`OracleSettings::min_area_px`].
    pub min_area_px: usize,
    /// See [`OracleSettings::score_noise`].
    pub score_noise: f32,
}

impl OraclePreset {
    /// The error model of the preset.
    pub fn error_model(self) -> OracleErrorModel {
        match self {
            Self::Perfect => PERFECT,
            Self::FastsamLike => FASTSAM_LIKE,
        }
    }
}

const PERFECT: OracleErrorModel = OracleErrorModel {
    persistent_miss_rate: 0.0,
    miss_rate: 0.0,
    split_rate: 0.0,
    max_parts: 3,
    merge_rate: 0.0,
    persistence: 0.5,
    boundary_jitter_px: 0.0,
    boundary_wavelength_px: 16.0,
    false_positives_per_frame: 0.0,
    false_positive_radius_px: 12.0,
    min_area_px: 0,
    score_noise: 0.0,
};

/// Calibrated as described in `docs/dev/ORACLE.md`.
const FASTSAM_LIKE: OracleErrorModel = OracleErrorModel {
    persistent_miss_rate: 0.1,
    miss_rate: 0.03,
    split_rate: 0.06,
    max_parts: 3,
    merge_rate: 0.03,
    persistence: 0.7,
    boundary_jitter_px: 1.0,
    boundary_wavelength_px: 16.0,
    false_positives_per_frame: 1.0,
    false_positive_radius_px: 12.0,
    min_area_px: 60,
    score_noise: 0.1,
};

impl OracleSettings {
    /// Returns the preset's error model, overridden by the given values.
    ///
    /// # Errors
    /// [`SettingError`] for the first value that is out of range.
    pub fn resolved(&self) -> Result<OracleErrorModel, SettingError> {
        self.validate()?;
        let preset = self.preset.error_model();
        Ok(OracleErrorModel {
            persistent_miss_rate: self.persistent_miss_rate.unwrap_or(preset.persistent_miss_rate),
            miss_rate: self.miss_rate.unwrap_or(preset.miss_rate),
            split_rate: self.split_rate.unwrap_or(preset.split_rate),
            max_parts: self.max_parts.unwrap_or(preset.max_parts),
            merge_rate: self.merge_rate.unwrap_or(preset.merge_rate),
            persistence: self.persistence.unwrap_or(preset.persistence),
            boundary_jitter_px: self.boundary_jitter_px.unwrap_or(preset.boundary_jitter_px),
            boundary_wavelength_px: self.boundary_wavelength_px.unwrap_or(preset.boundary_wavelength_px),
            false_positives_per_frame: self.false_positives_per_frame.unwrap_or(preset.false_positives_per_frame),
            false_positive_radius_px: self.false_positive_radius_px.unwrap_or(preset.false_positive_radius_px),
            min_area_px: self.min_area_px.unwrap_or(preset.min_area_px),
            score_noise: self.score_noise.unwrap_or(preset.score_noise),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_single_setting_replaces_the_presets_value() {
        let text = r#"{"preset": "fastsam-like", "miss_rate": 0.0}"#;
        let settings: OracleSettings = serde_json::from_str(text).unwrap();
        let expected = OracleErrorModel { miss_rate: 0.0, ..FASTSAM_LIKE };
        assert_eq!(settings.resolved().unwrap(), expected);
        assert_eq!(serde_json::to_string(&settings).unwrap(), r#"{"preset":"fastsam-like","miss_rate":0.0}"#);
        assert_eq!(OracleSettings::default().resolved().unwrap(), PERFECT);
        assert!(serde_json::from_str::<OracleSettings>(r#"{"misses": 0.1}"#).is_err());
    }

    #[test]
    fn rates_out_of_range_are_named() {
        let error = OracleSettings::default().with(|oracle| oracle.split_rate = Some(1.5)).resolved().unwrap_err();
        assert_eq!(error.to_string(), "oracle.split_rate is 1.5, expected 0 to 1");
        assert!(OracleSettings::default().with(|oracle| oracle.miss_rate = Some(f64::NAN)).resolved().is_err());
        assert!(OracleSettings::default().with(|oracle| oracle.max_parts = Some(1)).resolved().is_err());
        assert!(OracleSettings::default().with(|oracle| oracle.boundary_wavelength_px = Some(0.0)).resolved().is_err());
    }
}
