//! The settings of the memory: the paper's constants, and the choices where the paper is silent.

use serde::{Deserialize, Serialize};
use thiserror::Error;

/// What Gaussians remember of segments.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum MemoryKind {
    /// Votes: how often a Gaussian was seen as which segment.
    #[default]
    Evidence,
    /// The paper's: a feature vector, learnt by gradient descent.
    Features,
}

impl MemoryKind {
    /// Its name in settings and files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Evidence => "evidence",
            Self::Features => "features",
        }
    }
}

/// Where the map grows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum GrowthRule {
    /// `missing` for the memory of evidence, `paper` for that of features.
    #[default]
    Auto,
    /// Only what the map lacks: where nothing covers the pixel, or a surface lies in front of the remembered one. Fine
    /// at borders, coarse inside segments.
    Missing,
    /// The paper's (SplaTAM's): one Gaussian per pixel, also behind the remembered surface.
    Paper,
}

/// Settings of a [`SplatMemory`](crate::SplatMemory). Those of the paper have the paper's values.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MemorySettings {
    /// What Gaussians remember of segments.
    pub kind: MemoryKind,

    /// Where the map grows.
    pub growth: GrowthRule,
    /// A pixel is uncovered, and gets a new Gaussian, where the rendered silhouette is below this (rule `paper`).
    pub growth_silhouette: f32,
    /// A surface is missing where the alphas of the Gaussians up to its depth come to less than this (rule `missing`).
    pub growth_coverage: f32,
    /// Depths that differ by more than this, metres, are those of two surfaces. Rule `missing` adds Gaussians where the
    /// frame's surface lies in front of the rendered one, rule `paper` also where it lies behind.
    pub depth_disparity: f32,
    /// Neighbouring depths that differ by more than this fraction are a depth edge (rule `missing`).
    pub edge_disparity: f32,
    /// Largest spacing of Gaussians inside a segment, pixels: 1, 2, 4 or 8 (rule `missing`).
    pub growth_spacing: usize,
    /// A Gaussian may have a spacing of this many times its distance to the nearest border (rule `missing`).
    pub spacing_per_distance: f32,
    /// Standard deviation of a new Gaussian per spacing between Gaussians (rule `missing`; the paper's has 1).
    pub radius_per_spacing: f32,
    /// A Gaussian that this many frames saw through, none of them seeing it in between, is removed; 0: never.
    pub removal_frames: u8,
    /// A Gaussian is seen through where the observed surface lies behind it by more than this, metres...
    pub removal_margin: f32,
    /// ...or by more than this fraction of the distance, whichever is more.
    pub removal_margin_relative: f32,
    /// Most Gaussians that are kept. Beyond it those not seen for longest are removed.
    pub max_gaussians: usize,

    /// What the frame's own prediction weighs beside remembered votes (`evidence`).
    pub observation_weight: f32,
    /// What a frame without a prediction weighs, as a vote for no segment, relative to a prediction (`evidence`).
    pub no_segment_weight: f32,
    /// Most votes that a Gaussian holds: more are scaled down, so that it can change its mind (`evidence`).
    pub max_votes: f32,
    /// Whether segments without depth (screens, glass, sky), which no Gaussian can carry, are linked from frame to frame
    /// by the camera's motion (`evidence`).
    pub depthless: bool,
    /// Votes seen at a pixel must exceed this for a segment to be expected there (`evidence`).
    pub min_evidence: f32,
    /// A Gaussian is counted at a pixel only if it lies within this distance of the depth observed there, metres
    /// (`evidence`).
    pub depth_tolerance: f32,
    /// Blend weights below this are not counted (`evidence`).
    pub min_weight: f32,
    /// Alphas below this are not blended (`evidence`; the paper's memory blends down to 1/255).
    pub min_alpha: f32,
    /// A pixel is finished when so little light would come through (`evidence`; the paper's memory has 1e-4).
    pub min_transmittance: f32,

    /// Channels of a segment-id feature (D); 1 stores the id itself (`features`).
    pub feature_dim: usize,
    /// Codes made at the start, and added in one block whenever they run out (N; `features`).
    pub num_codes: usize,
    /// The best code's inner product must exceed this for a pixel to have a segment (`features`).
    pub decode_threshold: f32,
    /// What the confidence ‖f‖ of a remembered segment loses in a frame that does not confirm it (C_conf; `features`).
    pub confidence_decay: f32,
    /// Gradient-descent steps on the features per frame (N_opt; `features`).
    pub num_steps: usize,
    /// Weight of the confidence term, MSE(‖F̂‖, ‖F‖) (λ_mag; `features`).
    pub magnitude_weight: f32,
    /// Weight of the direction term, 1 − cos(F̂, F) (λ_dir; `features`).
    pub direction_weight: f32,
    /// Step size (`features`). Losses are summed over pixels and each Gaussian's step is divided by the sum of its blend
    /// weights, so that one value is stable at every distance; it must stay below 1 / `magnitude_weight`. Not in the
    /// paper.
    pub learning_rate: f32,
    /// A pixel is learnt only where the memory shows another segment than the target, where the confidences differ by
    /// more than this, where the directions differ (`active_min_cosine`), or within `active_margin` of such a pixel.
    /// Must be below `confidence_decay`, or fading is never learnt. Negative: every pixel (`features`). Not in the paper.
    pub active_tolerance: f32,
    /// Directions differ if their cosine is below this; see `active_tolerance` (`features`). Not in the paper.
    pub active_min_cosine: f32,
    /// See `active_tolerance`, pixels (`features`). Not in the paper.
    pub active_margin: usize,
    /// Blend weights below this are left out of learning, not of rendering (`features`). Not in the paper.
    pub learning_min_weight: f32,
}

impl Default for MemorySettings {
    fn default() -> Self {
        Self {
            kind: MemoryKind::default(),
            growth: GrowthRule::default(),
            growth_silhouette: 0.5,
            growth_coverage: 0.3,
            depth_disparity: 0.15,
            edge_disparity: 0.05,
            growth_spacing: 8,
            spacing_per_distance: 2.0,
            radius_per_spacing: 0.6,
            removal_frames: 3,
            removal_margin: 0.1,
            removal_margin_relative: 0.04,
            max_gaussians: 10_000_000,
            observation_weight: 1.0,
            no_segment_weight: 0.1,
            max_votes: 4.0,
            depthless: true,
            min_evidence: 0.3,
            depth_tolerance: 0.2,
            min_weight: 0.01,
            min_alpha: 0.02,
            min_transmittance: 0.01,
            feature_dim: 28,
            num_codes: 512,
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
    /// The rule that `growth` stands for.
    pub fn growth_rule(&self) -> GrowthRule {
        match (self.growth, self.kind) {
            (GrowthRule::Auto, MemoryKind::Evidence) => GrowthRule::Missing,
            (GrowthRule::Auto, MemoryKind::Features) => GrowthRule::Paper,
            (rule, _) => rule,
        }
    }

    /// Whether segments without depth are remembered.
    pub(crate) fn links_depthless(&self) -> bool {
        self.depthless && self.kind == MemoryKind::Evidence
    }

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
        if ![1, 2, 4, 8].contains(&self.growth_spacing) {
            return error("growth_spacing", self.growth_spacing.to_string(), "1, 2, 4 or 8");
        }
        if !(1..=u32::MAX as usize).contains(&self.max_gaussians) {
            return error("max_gaussians", self.max_gaussians.to_string(), "1 to 4294967295");
        }
        for (field, value) in self.positive_numbers() {
            if !(value.is_finite() && value > 0.0) {
                return error(field, value.to_string(), "a positive number");
            }
        }
        for (field, value) in self.non_negative_numbers() {
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

    fn positive_numbers(&self) -> [(&'static str, f32); 6] {
        [
            ("spacing_per_distance", self.spacing_per_distance),
            ("radius_per_spacing", self.radius_per_spacing),
            ("max_votes", self.max_votes),
            ("depth_tolerance", self.depth_tolerance),
            ("min_alpha", self.min_alpha),
            ("min_transmittance", self.min_transmittance),
        ]
    }

    fn non_negative_numbers(&self) -> [(&'static str, f32); 16] {
        [
            ("growth_silhouette", self.growth_silhouette),
            ("growth_coverage", self.growth_coverage),
            ("depth_disparity", self.depth_disparity),
            ("edge_disparity", self.edge_disparity),
            ("removal_margin", self.removal_margin),
            ("removal_margin_relative", self.removal_margin_relative),
            ("observation_weight", self.observation_weight),
            ("no_segment_weight", self.no_segment_weight),
            ("min_evidence", self.min_evidence),
            ("min_weight", self.min_weight),
            ("decode_threshold", self.decode_threshold),
            ("confidence_decay", self.confidence_decay),
            ("magnitude_weight", self.magnitude_weight),
            ("direction_weight", self.direction_weight),
            ("learning_rate", self.learning_rate),
            ("learning_min_weight", self.learning_min_weight),
        ]
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
        assert!(MemorySettings { growth_spacing: 3, ..MemorySettings::default() }.validate().is_err());
        assert!(MemorySettings { max_votes: 0.0, ..MemorySettings::default() }.validate().is_err());
    }

    #[test]
    fn each_kind_grows_by_its_own_rule() {
        let rule = |kind, growth| MemorySettings { kind, growth, ..MemorySettings::default() }.growth_rule();
        assert_eq!(rule(MemoryKind::Evidence, GrowthRule::Auto), GrowthRule::Missing);
        assert_eq!(rule(MemoryKind::Features, GrowthRule::Auto), GrowthRule::Paper);
        assert_eq!(rule(MemoryKind::Features, GrowthRule::Missing), GrowthRule::Missing);
        assert_eq!(rule(MemoryKind::Evidence, GrowthRule::Paper), GrowthRule::Paper);
    }
}
