//! How much the oracle errs.

use crate::SegmenterError;
use serde::{Deserialize, Serialize};

/// A set of error rates to start from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum OraclePreset {
    /// No errors: the true segments as they are.
    #[default]
    Perfect,
    /// Errors such that masks without memory score about as FastSAM does in the paper's ScanNet-MV table. How it was
    /// calibrated stands in `docs/ORACLE.md`.
    FastsamLike,
}

/// Settings of the oracle: a preset, and whatever is to differ from it.
///
/// A field that is left out is the preset's, so `preset = "fastsam-like"` with `miss_rate = 0.0` is that preset
/// without misses of single frames. [`OracleSettings::resolved`] gives the numbers in use and states what each means.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct OracleSettings {
    /// Where fields that are left out come from.
    pub preset: OraclePreset,
    /// See [`OracleErrorModel::persistent_miss_rate`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub persistent_miss_rate: Option<f64>,
    /// See [`OracleErrorModel::miss_rate`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub miss_rate: Option<f64>,
    /// See [`OracleErrorModel::split_rate`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub split_rate: Option<f64>,
    /// See [`OracleErrorModel::max_parts`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_parts: Option<usize>,
    /// See [`OracleErrorModel::merge_rate`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub merge_rate: Option<f64>,
    /// See [`OracleErrorModel::persistence`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub persistence: Option<f64>,
    /// See [`OracleErrorModel::boundary_jitter_px`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub boundary_jitter_px: Option<f32>,
    /// See [`OracleErrorModel::boundary_wavelength_px`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub boundary_wavelength_px: Option<f32>,
    /// See [`OracleErrorModel::false_positives_per_frame`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub false_positives_per_frame: Option<f64>,
    /// See [`OracleErrorModel::false_positive_radius_px`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub false_positive_radius_px: Option<f32>,
    /// See [`OracleErrorModel::min_area_px`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub min_area_px: Option<usize>,
    /// See [`OracleErrorModel::score_noise`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub score_noise: Option<f32>,
}

/// Every number of the error model. Rates are probabilities in [0, 1], lengths are pixels of the framed image.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct OracleErrorModel {
    /// Share of the objects that are never found.
    pub persistent_miss_rate: f64,
    /// Probability that a mask (an object, a part of one, or several in one) is not found in a frame, each frame anew.
    pub miss_rate: f64,
    /// Probability that an object is found in pieces in a frame. Lines through it, in the image, cut it.
    pub split_rate: f64,
    /// The most pieces of a split object; their number is uniform in 2 to this. At least 2.
    pub max_parts: usize,
    /// Probability that an object becomes one mask with an object that touches it in the image, in a frame. It is the
    /// neighbour with whom it shares the longest border most often; objects without neighbours stay alone.
    pub merge_rate: f64,
    /// Share of the frames in which an object's lasting disposition decides whether and how it is split or merged,
    /// the same way each time. In the others chance decides anew. The rates hold whatever the persistence.
    pub persistence: f64,
    /// Standard deviation of the displacement of a mask's outline, pixels, along each axis; smooth along the outline,
    /// another one in each frame.
    pub boundary_jitter_px: f32,
    /// Distance along which the outline's displacement changes, pixels. Above 0.
    pub boundary_wavelength_px: f32,
    /// Expected number of masks in a frame that are nothing, placed anywhere. Poisson distributed; at most 100.
    pub false_positives_per_frame: f64,
    /// Typical (median) radius of these, pixels. At least 1.
    pub false_positive_radius_px: f32,
    /// Objects, and masks made of them, with fewer pixels in a frame are not found.
    pub min_area_px: usize,
    /// Standard deviation of the noise of scores, 0 to 1. Without noise a score is 0.4 + 0.6 · IoU with the true object
    /// that fits best: 1 for an exact mask, FastSAM's confidence threshold for one that fits nothing.
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

/// Calibrated as `docs/ORACLE.md` says.
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
    /// The preset's error model with the fields that are given, checked.
    ///
    /// # Errors
    /// [`SegmenterError::Setting`] names a field that is out of its range.
    pub fn resolved(&self) -> Result<OracleErrorModel, SegmenterError> {
        let preset = self.preset.error_model();
        OracleErrorModel {
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
        }
        .validated()
    }
}

impl OracleErrorModel {
    fn validated(self) -> Result<Self, SegmenterError> {
        let rates = [
            ("oracle.persistent_miss_rate", self.persistent_miss_rate),
            ("oracle.miss_rate", self.miss_rate),
            ("oracle.split_rate", self.split_rate),
            ("oracle.merge_rate", self.merge_rate),
            ("oracle.persistence", self.persistence),
            ("oracle.score_noise", f64::from(self.score_noise)),
        ];
        for (field, found) in rates {
            check(field, found, 0.0..=1.0, "0 to 1")?;
        }
        let (jitter, wavelength) = (f64::from(self.boundary_jitter_px), f64::from(self.boundary_wavelength_px));
        check("oracle.boundary_jitter_px", jitter, 0.0..=50.0, "0 to 50 pixels")?;
        check("oracle.boundary_wavelength_px", wavelength, 1.0..=1000.0, "1 to 1000 pixels")?;
        check("oracle.false_positives_per_frame", self.false_positives_per_frame, 0.0..=100.0, "0 to 100")?;
        let radius = f64::from(self.false_positive_radius_px);
        check("oracle.false_positive_radius_px", radius, 1.0..=1000.0, "1 to 1000 pixels")?;
        check("oracle.max_parts", self.max_parts as f64, 2.0..=16.0, "2 to 16")?;
        Ok(self)
    }
}

fn check(
    field: &'static str,
    found: f64,
    range: std::ops::RangeInclusive<f64>,
    expected: &'static str,
) -> Result<(), SegmenterError> {
    if range.contains(&found) {
        return Ok(());
    }
    Err(SegmenterError::Setting { field, found: found.to_string(), expected })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_preset_and_a_single_field_go_together() {
        let text = r#"{"preset": "fastsam-like", "miss_rate": 0.0}"#;
        let settings: OracleSettings = serde_json::from_str(text).unwrap();
        let expected = OracleErrorModel { miss_rate: 0.0, ..FASTSAM_LIKE };
        assert_eq!(settings.resolved().unwrap(), expected);
        assert_eq!(serde_json::to_string(&settings).unwrap(), r#"{"preset":"fastsam-like","miss_rate":0.0}"#);
        assert_eq!(OracleSettings::default().resolved().unwrap(), PERFECT);
        assert!(serde_json::from_str::<OracleSettings>(r#"{"misses": 0.1}"#).is_err());
    }

    #[test]
    fn impossible_rates_are_named() {
        let error = OracleSettings { split_rate: Some(1.5), ..Default::default() }.resolved().unwrap_err();
        assert_eq!(error.to_string(), "segmenter setting oracle.split_rate is 1.5, expected 0 to 1");
        assert!(OracleSettings { miss_rate: Some(f64::NAN), ..Default::default() }.resolved().is_err());
        assert!(OracleSettings { max_parts: Some(1), ..Default::default() }.resolved().is_err());
        assert!(OracleSettings { boundary_wavelength_px: Some(0.0), ..Default::default() }.resolved().is_err());
    }
}
