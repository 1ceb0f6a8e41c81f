//! Settings of the memory: the paper's constants, and our choices where the paper is silent.

use crate::MemoryKind;
use splatseg_geometry::SegmentId;
use splatseg_settings::{Allowed, Choice, choices, settings};
use std::collections::BTreeSet;

/// Depths of one surface differ by at most this fraction of the distance, or `memory.depth_tolerance` if that is more.
pub(crate) const RELATIVE_TOLERANCE: f32 = 0.05;

/// The map covers a pixel if the accumulated alpha of its Gaussians there is at least this.
pub const COVERED: f32 = 0.3;

choices! {
    /// Rule for adding Gaussians to the map.
    pub enum GrowthRule, default Auto {
        /// `missing` with `memory.kind = evidence`, `paper` with `memory.kind = features`.
        Auto = "auto",
        /// Only where the map lacks a surface: nothing covers the pixel, or the observed surface lies in front of the
        /// remembered one. Fine at borders, coarse inside segments.
        Missing = "missing",
        /// The paper's (SplaTAM's): one Gaussian per pixel, also behind the remembered surface.
        Paper = "paper",
    }
}

settings! {
    /// Settings of a [`SplatMemory`](crate::SplatMemory). Those from the paper default to its values unless noted.
    pub struct MemorySettings in "memory" {
        /// How Gaussians remember segments.
        kind: MemoryKind = MemoryKind::Evidence, Allowed::Names(MemoryKind::names());
        /// Rule for adding Gaussians to the map.
        growth: GrowthRule = GrowthRule::Auto, Allowed::Names(GrowthRule::NAMES);
        /// Rule `paper` adds a Gaussian where the rendered silhouette is below this.
        growth_silhouette: f32 = 0.5, Allowed::between(0.0, 1.0), only "memory.growth = paper";
        /// Rule `paper` also adds a Gaussian where rendered and observed depth differ by more than this, metres.
        depth_disparity: f32 = 0.15, Allowed::between(0.0, 1000.0), only "memory.growth = paper";
        /// Depths of one surface differ by at most this, metres, or by 5 % of the distance if that is more.
        depth_tolerance: f32 = 0.1, Allowed::between(0.0, 1000.0), only "memory.kind = evidence or memory.growth = missing";
        /// Maximum spacing of Gaussians inside a segment, pixels: 1, 2, 4 or 8 (rule `missing`).
        growth_spacing: usize = 8, Allowed::OneOf(&[1.0, 2.0, 4.0, 8.0]), only "memory.growth = missing";
        /// A Gaussian is removed once this many frames have seen through it and none has seen it in between; 0: never.
        removal_frames: u8 = 3, Allowed::between(0.0, 255.0);
        /// Maximum number of Gaussians. Beyond it, those unseen for longest are removed.
        max_gaussians: usize = 10_000_000, Allowed::between(1.0, 1e8);
        /// Weight of a vote for no segment, where nothing is predicted. A vote for a prediction weighs 1.
        no_segment_weight: f32 = 0.1, Allowed::between(0.0, 1000.0), only "memory.kind = evidence";
        /// Weight of a vote for a prediction that the memory contradicts.
        contradicted_weight: f32 = 0.25, Allowed::between(0.0, 1000.0), only "memory.kind = evidence";
        /// A prediction whose colours differ from those of the expected segment is another thing, and replaces it.
        compare_colors: bool = true, Allowed::Switch, only "memory.kind = evidence";
        /// Maximum sum of a Gaussian's votes. Larger sums are scaled down, so that new votes can outweigh old ones.
        max_votes: f32 = 4.0, Allowed::above_up_to(0.0, 1e6), only "memory.kind = evidence";
        /// Channels of a segment-id feature (D); 1 stores the id itself.
        feature_dim: usize = 28, Allowed::between(1.0, 256.0), only "memory.kind = features";
        /// Codes created at the start, and added in one block whenever they run out (N).
        num_codes: usize = 512, Allowed::between(1.0, 2048.0), only "memory.kind = features";
        /// A pixel has a segment only if the inner product of its feature with the best code exceeds this.
        decode_threshold: f32 = 0.5, Allowed::between(0.0, 1.0), only "memory.kind = features";
        /// Confidence ‖f‖ that a remembered segment loses in a frame that does not confirm it (C_conf).
        confidence_decay: f32 = 0.1, Allowed::between(0.0, 1.0), only "memory.kind = features";
        /// The part of a matched segment outside its prediction fades, as an unmatched segment does, instead of being
        /// dropped. The paper: false.
        fade_matched: bool = true, Allowed::Switch, only "memory.kind = features";
        /// A pixel without a prediction whose feature shows no segment loses only `confidence_decay` of its confidence
        /// instead of all of it. The paper: true.
        fade_undecoded: bool = false, Allowed::Switch, only "memory.kind = features";
        /// An unmatched remembered segment is hidden in a frame whose predictions cover more than this fraction of it:
        /// its confidence in the rest of it falls below `decode_threshold`. 1: never. The paper does not say.
        max_covered_fraction: f64 = 1.0, Allowed::between(0.0, 1.0), only "memory.kind = features";
        /// Gradient-descent steps on the features per frame (N_opt).
        num_steps: usize = 20, Allowed::between(0.0, 200.0), only "memory.kind = features";
        /// Weight of the confidence term, MSE(‖F̂‖, ‖F‖) (λ_mag).
        magnitude_weight: f32 = 50.0, Allowed::between(0.0, 1e6), only "memory.kind = features";
        /// Weight of the direction term, 1 − cos(F̂, F) (λ_dir).
        direction_weight: f32 = 1.0, Allowed::between(0.0, 1e6), only "memory.kind = features";
        /// Step size along a feature, which changes its confidence: a fraction of the gradient divided by the
        /// curvature, so that the step is safe at every distance. The paper gives no value.
        learning_rate: f32 = 0.5, Allowed::between(0.0, 1.0), only "memory.kind = features";
        /// Step size across a feature, which turns it towards another id. With 0.5 an id turns within the 20 steps of a
        /// frame, as in the paper; with 0.01 that takes two or three frames, so that one wrong mask does little harm.
        direction_learning_rate: f32 = 0.01, Allowed::between(0.0, 1.0), only "memory.kind = features";
        /// A pixel is learnt only if memory and target differ there in the segment, in the confidence by more than
        /// this, or in the direction (`active_min_cosine`), or if it is within `active_margin` of such a pixel. Must be
        /// below `confidence_decay`, or fading is never learnt. Negative: every pixel. Not in the paper.
        active_tolerance: f32 = 0.09, Allowed::between(-1.0, 1.0), only "memory.kind = features";
        /// Learn the pixels that a frame's new Gaussians cover in the same frame, which renders the map once more. New
        /// Gaussians already show the target. The paper: true.
        learn_new: bool = false, Allowed::Switch, only "memory.kind = features";
        /// Directions differ if their cosine is below this; see `active_tolerance`. Not in the paper.
        active_min_cosine: f32 = 0.95, Allowed::between(-1.0, 1.0), only "memory.kind = features";
        /// Margin around pixels that are learnt, pixels; see `active_tolerance`. Not in the paper.
        active_margin: usize = 1, Allowed::between(0.0, 100.0), only "memory.kind = features";
        /// Blend weights below this are ignored in learning, but not in rendering. Not in the paper.
        learning_min_weight: f32 = 0.005, Allowed::between(0.0, 1.0), only "memory.kind = features";
    }
}

impl MemorySettings {
    /// Maximum difference of the depths of one surface at this distance; both in metres.
    pub(crate) fn tolerance_at(&self, distance: f32) -> f32 {
        self.depth_tolerance.max(RELATIVE_TOLERANCE * distance)
    }

    /// Weight of a vote for an id, given the ids of the frame's contradicted predictions.
    pub(crate) fn vote_weight(&self, id: SegmentId, contradicted: &BTreeSet<SegmentId>) -> f32 {
        match id {
            0 => self.no_segment_weight,
            id if contradicted.contains(&id) => self.contradicted_weight,
            _ => 1.0,
        }
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
}
