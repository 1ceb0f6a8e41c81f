//! The settings of the memory: the paper's constants, and the choices where the paper is silent.

use splatseg_settings::{Allowed, Choice, choices, settings};

choices! {
    /// What Gaussians remember of segments.
    pub enum MemoryKind, default Evidence {
        /// Votes: how often a Gaussian was seen as which segment.
        Evidence = "evidence",
        /// The paper's: a feature vector, learnt by gradient descent.
        Features = "features",
    }
}

choices! {
    /// Where the map grows.
    pub enum GrowthRule, default Auto {
        /// `missing` for the memory of evidence, `paper` for that of features.
        Auto = "auto",
        /// Only what the map lacks: where nothing covers the pixel, or a surface lies in front of the remembered one.
        /// Fine at borders, coarse inside segments.
        Missing = "missing",
        /// The paper's (SplaTAM's): one Gaussian per pixel, also behind the remembered surface.
        Paper = "paper",
    }
}

settings! {
    /// Settings of a [`SplatMemory`](crate::SplatMemory). Those of the paper have the paper's values.
    pub struct MemorySettings in "memory" {
        /// What Gaussians remember of segments.
        kind: MemoryKind = MemoryKind::Evidence, Allowed::Names(MemoryKind::NAMES);
        /// Where the map grows.
        growth: GrowthRule = GrowthRule::Auto, Allowed::Names(GrowthRule::NAMES);
        /// The map covers a pixel from this rendered silhouette on. Rule `paper` adds a Gaussian where it does not; segments
        /// without depth are remembered only there.
        growth_silhouette: f32 = 0.5, Allowed::between(0.0, 1.0);
        /// A surface is missing where the alphas of the Gaussians up to its depth come to less than this (rule
        /// `missing`).
        growth_coverage: f32 = 0.3, Allowed::between(0.0, 1.0), only "memory.growth = missing";
        /// Depths that differ by more than this, metres, are those of two surfaces. Rule `missing` adds Gaussians where
        /// the frame's surface lies in front of the rendered one, rule `paper` also where it lies behind.
        depth_disparity: f32 = 0.15, Allowed::between(0.0, 1000.0);
        /// Neighbouring depths that differ by more than this fraction are a depth edge (rule `missing`).
        edge_disparity: f32 = 0.05, Allowed::between(0.0, 1000.0), only "memory.growth = missing";
        /// Largest spacing of Gaussians inside a segment, pixels: 1, 2, 4 or 8 (rule `missing`).
        growth_spacing: usize = 8, Allowed::OneOf(&[1.0, 2.0, 4.0, 8.0]), only "memory.growth = missing";
        /// A Gaussian may have a spacing of this many times its distance to the nearest border (rule `missing`).
        spacing_per_distance: f32 = 2.0, Allowed::above_up_to(0.0, 1000.0), only "memory.growth = missing";
        /// Standard deviation of a new Gaussian per spacing between Gaussians (rule `missing`; the paper's has 1).
        radius_per_spacing: f32 = 0.6, Allowed::above_up_to(0.0, 10.0), only "memory.growth = missing";
        /// A Gaussian that this many frames saw through, none of them seeing it in between, is removed; 0: never.
        removal_frames: u8 = 3, Allowed::between(0.0, 255.0);
        /// A Gaussian is seen through where the observed surface lies behind it by more than this, metres...
        removal_margin: f32 = 0.1, Allowed::between(0.0, 1000.0);
        /// ...or by more than this fraction of the distance, whichever is more.
        removal_margin_relative: f32 = 0.04, Allowed::between(0.0, 1000.0);
        /// Most Gaussians that are kept. Beyond it those not seen for longest are removed.
        max_gaussians: usize = 10_000_000, Allowed::between(1.0, 1e8);
        /// What the frame's own prediction weighs beside remembered votes.
        observation_weight: f32 = 1.0, Allowed::between(0.0, 1000.0), only "memory.kind = evidence";
        /// What a frame without a prediction weighs, as a vote for no segment, relative to a prediction.
        no_segment_weight: f32 = 0.1, Allowed::between(0.0, 1000.0), only "memory.kind = evidence";
        /// Most votes that a Gaussian holds: more are scaled down, so that it can change its mind.
        max_votes: f32 = 4.0, Allowed::above_up_to(0.0, 1e6), only "memory.kind = evidence";
        /// Whether segments without depth (screens, glass, sky), which no Gaussian can carry, are linked from frame to
        /// frame by the camera's motion.
        depthless: bool = true, Allowed::Switch, only "memory.kind = evidence";
        /// Votes seen at a pixel must exceed this for a segment to be expected there.
        min_evidence: f32 = 0.3, Allowed::between(0.0, 1e6), only "memory.kind = evidence";
        /// A Gaussian is counted at a pixel only if it lies within this distance of the depth observed there, metres.
        depth_tolerance: f32 = 0.2, Allowed::above_up_to(0.0, 1000.0), only "memory.kind = evidence";
        /// Blend weights below this are not counted.
        min_weight: f32 = 0.01, Allowed::between(0.0, 1.0), only "memory.kind = evidence";
        /// Alphas below this are not blended (the paper's memory blends down to 1/255).
        min_alpha: f32 = 0.02, Allowed::above_up_to(0.0, 1.0), only "memory.kind = evidence";
        /// A pixel is finished when so little light would come through (the paper's memory has 1e-4).
        min_transmittance: f32 = 0.01, Allowed::above_up_to(0.0, 1.0), only "memory.kind = evidence";
        /// Channels of a segment-id feature (D); 1 stores the id itself.
        feature_dim: usize = 28, Allowed::between(1.0, 256.0), only "memory.kind = features";
        /// Codes made at the start, and added in one block whenever they run out (N).
        num_codes: usize = 512, Allowed::between(1.0, 2048.0), only "memory.kind = features";
        /// The best code's inner product must exceed this for a pixel to have a segment.
        decode_threshold: f32 = 0.5, Allowed::between(0.0, 1.0), only "memory.kind = features";
        /// What the confidence ‖f‖ of a remembered segment loses in a frame that does not confirm it (C_conf).
        confidence_decay: f32 = 0.1, Allowed::between(0.0, 1.0), only "memory.kind = features";
        /// Whether the part of a matched segment that its prediction leaves out stays and fades as an unmatched segment
        /// does; otherwise it is dropped. The paper: false.
        fade_matched: bool = true, Allowed::Switch, only "memory.kind = features";
        /// Whether a pixel that no prediction covers and whose feature shows no segment loses `confidence_decay`;
        /// otherwise it loses all of its confidence. The paper: true.
        fade_undecoded: bool = false, Allowed::Switch, only "memory.kind = features";
        /// An unmatched remembered segment is hidden in a frame whose predictions cover more than this fraction of it: the
        /// rest of its confidence falls below `decode_threshold`. 1: never. The paper does not say.
        max_covered_fraction: f64 = 1.0, Allowed::between(0.0, 1.0), only "memory.kind = features";
        /// Gradient-descent steps on the features per frame (N_opt).
        num_steps: usize = 20, Allowed::between(0.0, 200.0), only "memory.kind = features";
        /// Weight of the confidence term, MSE(‖F̂‖, ‖F‖) (λ_mag).
        magnitude_weight: f32 = 50.0, Allowed::between(0.0, 1e6), only "memory.kind = features";
        /// Weight of the direction term, 1 − cos(F̂, F) (λ_dir).
        direction_weight: f32 = 1.0, Allowed::between(0.0, 1e6), only "memory.kind = features";
        /// Step size along a feature, which is confidence: a fraction of the gradient divided by the curvature, so that it
        /// is safe at every distance. The paper gives no value.
        learning_rate: f32 = 0.5, Allowed::between(0.0, 1.0), only "memory.kind = features";
        /// The same across it, where it turns towards another id. With 0.5 an id turns within the 20 steps of a frame, as
        /// the paper says; with 0.01 that takes two or three frames, so one wrong mask does little harm.
        direction_learning_rate: f32 = 0.01, Allowed::between(0.0, 1.0), only "memory.kind = features";
        /// A pixel is learnt only where the memory shows another segment than the target, where the confidences differ
        /// by more than this, where the directions differ (`active_min_cosine`), or within `active_margin` of such a
        /// pixel. Must be below `confidence_decay`, or fading is never learnt. Negative: every pixel. Not in the paper.
        active_tolerance: f32 = 0.09, Allowed::between(-1.0, 1.0), only "memory.kind = features";
        /// Whether the pixels that a frame's new Gaussians cover are learnt in the same frame, for which the map is
        /// rendered once more. New Gaussians show the target already. The paper: true.
        learn_new: bool = false, Allowed::Switch, only "memory.kind = features";
        /// Directions differ if their cosine is below this; see `active_tolerance`. Not in the paper.
        active_min_cosine: f32 = 0.95, Allowed::between(-1.0, 1.0), only "memory.kind = features";
        /// See `active_tolerance`, pixels. Not in the paper.
        active_margin: usize = 1, Allowed::between(0.0, 100.0), only "memory.kind = features";
        /// Blend weights below this are left out of learning, not of rendering. Not in the paper.
        learning_min_weight: f32 = 0.005, Allowed::between(0.0, 1.0), only "memory.kind = features";
    }
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

    /// Depths of one surface differ by no more than this, metres, if it is `distance` away.
    pub(crate) fn same_surface_margin(&self, distance: f32) -> f32 {
        self.removal_margin.max(self.removal_margin_relative * distance)
    }

    /// Whether segments without depth are remembered.
    pub(crate) fn links_depthless(&self) -> bool {
        self.depthless && self.kind == MemoryKind::Evidence
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_are_checked() {
        assert_eq!(MemorySettings::default().validate(), Ok(()));
        let error = MemorySettings::default().with(|memory| memory.feature_dim = 0).validate().unwrap_err();
        assert_eq!(error.to_string(), "memory.feature_dim is 0, expected 1 to 256");
        assert!(MemorySettings::default().with(|memory| memory.learning_rate = f32::NAN).validate().is_err());
        assert!(MemorySettings::default().with(|memory| memory.growth_spacing = 3).validate().is_err());
        assert!(MemorySettings::default().with(|memory| memory.max_votes = 0.0).validate().is_err());
    }

    #[test]
    fn each_kind_grows_by_its_own_rule() {
        let rule = |kind, growth| {
            MemorySettings::default().with(|memory| (memory.kind, memory.growth) = (kind, growth)).growth_rule()
        };
        assert_eq!(rule(MemoryKind::Evidence, GrowthRule::Auto), GrowthRule::Missing);
        assert_eq!(rule(MemoryKind::Features, GrowthRule::Auto), GrowthRule::Paper);
        assert_eq!(rule(MemoryKind::Features, GrowthRule::Missing), GrowthRule::Missing);
        assert_eq!(rule(MemoryKind::Evidence, GrowthRule::Paper), GrowthRule::Paper);
    }
}
