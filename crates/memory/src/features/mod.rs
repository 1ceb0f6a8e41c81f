//! The paper's memory: every Gaussian has a feature vector whose direction encodes the segment's id and whose magnitude
//! is the confidence (docs/PAPER.md, "Features").
//!
//! - **Expected**: the rendered feature's best code ([`Decoder`], "Decoding").
//! - **Shown**: the decoded target F̂ ([`target`], "FastSAM-Splat", steps 4 and 5).
//! - **Learnt**: gradient steps from the rendered features towards F̂ ([`Learning`], step 6).

mod codebook;
mod codes;
mod decoding;
mod extension;
mod learning;
mod loss;

pub use codebook::{Codebook, CodebookError, CodebookSettings};
pub use codes::SegmentCodes;

use crate::map::NewGaussian;
use crate::ply::SplatContentView;
use crate::recall::{Recall, StoreTile};
use crate::segment_store::{LearningStats, SegmentStore};
use crate::tile_surface::TileSurface;
use crate::{GrowthRule, MemoryError, MemoryRules, MemorySettings, SegmentBelief};
use codebook::CodebookCache;
use decoding::Decoder;
use learning::Learning;
use splatseg_geometry::{MAX_SEGMENT_ID, SegmentId, SegmentMap};
use splatseg_render::{RasterLimits, Splats, TileWeights, View};
use std::collections::{BTreeMap, BTreeSet};

/// A Gaussian added in this frame prevails where it has at least this alpha in front of the earlier surface: there, the
/// view rendered before is out of date.
const NEW_GAUSSIAN_PREVAILS: f32 = 0.5;

/// Features of the Gaussians and codes of the segments.
#[derive(Debug)]
pub(crate) struct FeatureStore {
    pub settings: MemorySettings,
    pub codes: SegmentCodes,
    /// `[gaussians, D]`.
    pub features: Vec<f32>,
}

impl FeatureStore {
    /// Creates a store for a map without Gaussians. Generating the codebook takes up to a few seconds, unless it is in
    /// the user's cache; `progress` receives the fraction done.
    pub fn new(settings: MemorySettings, seed: u64, progress: &mut dyn FnMut(f32)) -> Result<Self, MemoryError> {
        let codebook_settings =
            CodebookSettings { num_codes: settings.num_codes, feature_dim: settings.feature_dim, seed };
        let cache = CodebookCache::of_user();
        let codebook = Codebook::generate_cached(&codebook_settings, &cache, progress)?;
        let codes = SegmentCodes::new(&settings, codebook, 0, cache);
        Ok(Self { settings, codes, features: Vec::new() })
    }

    /// Restores the store of an earlier run.
    pub fn restored(settings: MemorySettings, codes: SegmentCodes, features: Vec<f32>) -> Self {
        Self { settings, codes, features }
    }

    /// The paper's rules. Every id needs a code.
    pub fn rules_of(settings: &MemorySettings) -> MemoryRules {
        let codes = Codebook::max_len(settings.feature_dim) / settings.num_codes.max(1) * settings.num_codes;
        MemoryRules {
            growth: GrowthRule::Paper,
            limits: RasterLimits::default(),
            compares_frames: false,
            expects_previous_ids: false,
            counts_ids_per_frame: false,
            judges_predictions: false,
            largest_id: codes.min(MAX_SEGMENT_ID as usize) as SegmentId,
        }
    }

    fn decoder(&self) -> Decoder<'_> {
        let threshold = self.settings.decode_threshold;
        Decoder { codebook: self.codes.codebook(), used_codes: self.codes.used(), threshold }
    }
}

/// Returns the target F̂ for rendered features. Predictions have full confidence. Unmatched remembered segments
/// (without a prediction) keep their id, and their confidence falls by `confidence_decay`, not below zero. If
/// predictions cover more than `max_covered_fraction` of such a segment, it falls below `decode_threshold` at once.
/// `fade_matched` and `fade_undecoded` control two other kinds of pixels without a prediction.
pub fn target(expected: &SegmentBelief, predicted: &SegmentMap, settings: &MemorySettings) -> SegmentBelief {
    let matched = if settings.fade_matched { BTreeMap::new() } else { predicted.areas() };
    let hidden = covered_segments(&expected.segments, predicted, settings.max_covered_fraction);
    let decay = settings.confidence_decay;
    let mut target = expected.clone();
    let pixels = target.segments.pixels_mut().iter_mut().zip(target.confidence.pixels_mut());
    for ((segment, confidence), predicted) in pixels.zip(predicted.pixels()) {
        match (*predicted, *segment) {
            (0, 0) if !settings.fade_undecoded => *confidence = 0.0,
            (0, id) if matched.contains_key(&id) => (*segment, *confidence) = (0, 0.0),
            (0, id) if hidden.contains(&id) => {
                *confidence = (confidence.min(settings.decode_threshold) - decay).max(0.0);
            }
            (0, _) => *confidence = (*confidence - decay).max(0.0),
            _ => (*segment, *confidence) = (*predicted, 1.0),
        }
    }
    target
}

/// Returns the unmatched expected segments that predictions cover by more than the fraction `limit`.
fn covered_segments(expected: &SegmentMap, predicted: &SegmentMap, limit: f64) -> BTreeSet<SegmentId> {
    if limit >= 1.0 {
        return BTreeSet::new();
    }
    let mut areas: BTreeMap<SegmentId, (usize, usize)> = BTreeMap::new();
    for (id, predicted) in expected.pixels().iter().zip(predicted.pixels()).filter(|(id, _)| **id != 0) {
        let (all, covered) = areas.entry(*id).or_default();
        *all += 1;
        *covered += usize::from(*predicted != 0);
    }
    let predicted_areas = predicted.areas();
    let is_hidden = |(all, covered): (usize, usize)| covered as f64 > limit * all as f64;
    let unmatched = areas.into_iter().filter(|(id, _)| !predicted_areas.contains_key(id));
    unmatched.filter(|(_, areas)| is_hidden(*areas)).map(|(id, _)| id).collect()
}

impl SegmentStore for FeatureStore {
    fn rules(&self) -> MemoryRules {
        Self::rules_of(&self.settings)
    }

    fn read_tile(&self, tile: &TileWeights, surface: &TileSurface) -> StoreTile {
        let mut rendered = vec![0.0; TileWeights::PIXELS * self.codes.codebook().feature_dim()];
        tile.accumulate(&self.features, self.codes.codebook().feature_dim(), &mut rendered);
        self.decoder().read_tile(surface, rendered)
    }

    fn fuse(&self, recall: &Recall<'_>, predicted: &SegmentMap) -> SegmentMap {
        target(&recall.belief, predicted, &self.settings).decoded(self.settings.decode_threshold)
    }

    fn grow(&mut self, added: &[NewGaussian], recall: &Recall<'_>, predicted: &SegmentMap, _: &BTreeSet<SegmentId>) {
        let feature_dim = self.settings.feature_dim;
        let target = target(&recall.belief, predicted, &self.settings);
        for gaussian in added {
            match target.segments.pixels()[gaussian.pixel] {
                0 => self.features.resize(self.features.len() + feature_dim, 0.0),
                segment => {
                    let confidence = if feature_dim == 1 { 1.0 } else { target.confidence.pixels()[gaussian.pixel] };
                    let code = self.codes.codebook().vector(segment as usize - 1);
                    self.features.extend(code.iter().map(|value| confidence * value));
                }
            }
        }
    }

    fn learn(
        &mut self,
        recall: &Recall<'_>,
        map: &dyn Splats,
        predicted: &SegmentMap,
        _: &BTreeSet<SegmentId>,
    ) -> LearningStats {
        let target = target(&recall.belief, predicted, &self.settings);
        let learning = Learning { settings: &self.settings, codebook: self.codes.codebook(), recall, target: &target };
        let min_weight = self.settings.learning_min_weight;
        let active = if self.settings.learn_new {
            let grown = View::new(map, recall.view.camera());
            grown.active_weights(&learning.active_pixels(&[]), min_weight)
        } else {
            let touched = recall.view.pixels_touched_since(map, &recall.depth, NEW_GAUSSIAN_PREVAILS);
            recall.view.active_weights(&learning.active_pixels(&touched), min_weight)
        };
        learning.descend(&active, &mut self.features)
    }

    fn retain(&mut self, keep: &[bool]) {
        let feature_dim = self.settings.feature_dim;
        let mut kept = 0;
        for (index, _) in keep.iter().enumerate().filter(|(_, keep)| **keep) {
            self.features.copy_within(index * feature_dim..(index + 1) * feature_dim, kept * feature_dim);
            kept += 1;
        }
        self.features.truncate(kept * feature_dim);
    }

    fn new_segment(&mut self, id: SegmentId) -> Result<(), MemoryError> {
        self.codes.new_segment(id)
    }

    fn segment_ids(&self) -> Vec<SegmentId> {
        let mut hint = None;
        let decode = |feature| {
            let threshold = self.settings.decode_threshold;
            let code = self.codes.codebook().decode_with_hint(feature, hint, self.codes.used(), threshold);
            hint = code.or(hint);
            code.map_or(0, |code| code + 1)
        };
        self.features.chunks_exact(self.settings.feature_dim).map(decode).collect()
    }

    fn numbers_per_gaussian(&self) -> usize {
        self.settings.feature_dim
    }

    fn content(&self) -> Option<SplatContentView<'_>> {
        Some(SplatContentView::Features { features: &self.features, codebook: self.codes.codebook() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use splatseg_geometry::Image;

    #[test]
    fn predictions_cover_memory_and_the_unseen_fades() {
        let expected = SegmentBelief {
            segments: SegmentMap::from_pixels(5, 1, vec![3, 3, 4, 4, 0]).unwrap(),
            confidence: Image::from_pixels(5, 1, vec![0.9, 0.9, 0.55, 0.05, 0.3]).unwrap(),
        };
        let predicted = SegmentMap::from_pixels(5, 1, vec![3, 7, 0, 0, 0]).unwrap();
        let target = |settings: &MemorySettings| target(&expected, &predicted, settings);
        let ours = target(&MemorySettings::default());
        assert_eq!(ours.segments.pixels(), [3, 7, 4, 4, 0]);
        assert_near(ours.confidence.pixels(), &[1.0, 1.0, 0.45, 0.0, 0.0]);
        assert_eq!(ours.decoded(0.5).pixels(), [3, 7, 0, 0, 0]);
    }

    #[test]
    fn pixels_without_a_prediction_fade_or_are_dropped_by_the_settings() {
        let expected = SegmentBelief {
            segments: SegmentMap::from_pixels(4, 1, vec![3, 3, 4, 0]).unwrap(),
            confidence: Image::from_pixels(4, 1, vec![0.9, 0.9, 0.9, 0.3]).unwrap(),
        };
        // 3 is matched except for its second pixel; 4 is not matched.
        let predicted = SegmentMap::from_pixels(4, 1, vec![3, 0, 0, 0]).unwrap();
        let paper =
            MemorySettings::default().with(|memory| (memory.fade_matched, memory.fade_undecoded) = (false, true));
        let found = target(&expected, &predicted, &paper);
        assert_eq!(found.segments.pixels(), [3, 0, 4, 0]);
        assert_near(found.confidence.pixels(), &[1.0, 0.0, 0.8, 0.2]);
        let found = target(&expected, &predicted, &MemorySettings::default());
        assert_eq!(found.segments.pixels(), [3, 3, 4, 0]);
        assert_near(found.confidence.pixels(), &[1.0, 0.8, 0.8, 0.0]);
    }

    #[test]
    fn rests_of_covered_segments_are_not_shown() {
        let expected = SegmentBelief {
            segments: SegmentMap::from_pixels(8, 1, vec![3, 3, 3, 3, 4, 4, 5, 5]).unwrap(),
            confidence: Image::filled(8, 1, 0.9),
        };
        // 7 covers half of 3 and 4 is untouched; 5 is matched, and 7 covers a part of it.
        let predicted = SegmentMap::from_pixels(8, 1, vec![7, 7, 0, 0, 0, 0, 7, 5]).unwrap();
        let settings = MemorySettings::default().with(|memory| memory.max_covered_fraction = 0.4);
        let found = target(&expected, &predicted, &settings);
        assert_eq!(found.segments.pixels(), [7, 7, 3, 3, 4, 4, 7, 5], "directions stay");
        assert_near(found.confidence.pixels(), &[1.0, 1.0, 0.4, 0.4, 0.8, 0.8, 1.0, 1.0]);
        assert_eq!(found.decoded(0.5).pixels(), [7, 7, 0, 0, 4, 4, 7, 5]);
        let settings = MemorySettings::default().with(|memory| memory.max_covered_fraction = 0.5);
        assert_eq!(target(&expected, &predicted, &settings).decoded(0.5).pixels(), [7, 7, 3, 3, 4, 4, 7, 5]);
    }

    fn assert_near(found: &[f32], expected: &[f32]) {
        assert_eq!(found.len(), expected.len());
        for (found, expected) in found.iter().zip(expected) {
            assert!((found - expected).abs() < 1e-6, "{found} instead of {expected}");
        }
    }

    #[test]
    fn removed_gaussians_take_their_features_along() {
        let settings = MemorySettings { feature_dim: 2, num_codes: 4, ..MemorySettings::default() };
        let mut store = FeatureStore::new(settings, 0, &mut |_| {}).unwrap();
        store.features = (0..8).map(|value| value as f32).collect();
        store.retain(&[false, true, false, true]);
        assert_eq!(store.features, [2.0, 3.0, 6.0, 7.0]);
    }
}
