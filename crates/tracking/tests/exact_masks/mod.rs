//! FastSAM-Splat in the synthetic room, with the true masks as predictions: they are exact and carry no id.

#![allow(dead_code)] // Each test file uses a part.

use splatseg_dataset::{Scene, SyntheticScene};
use splatseg_geometry::{Mask, RgbdFrame, ScoredMask, SegmentId, SegmentMap};
use splatseg_memory::{MemoryKind, MemorySettings};
use splatseg_segmenter::{Segmenter, SegmenterError};
use splatseg_tracking::{FastSamSplat, FastSamSplatSettings};
use std::collections::BTreeMap;

/// Masks of fewer pixels are not predicted, and smaller segments not shown.
pub const MIN_AREA: usize = 12;

/// A segmenter that finds nothing by itself; the tests hand masks over.
struct Nothing;

impl Segmenter for Nothing {
    fn name(&self) -> &str {
        "nothing"
    }

    fn segment(&mut self, _: &RgbdFrame) -> Result<Vec<ScoredMask>, SegmenterError> {
        Ok(Vec::new())
    }
}

/// The method, with an empty memory.
pub fn method(memory: MemorySettings) -> FastSamSplat {
    let settings = FastSamSplatSettings { memory, min_segment_area: MIN_AREA, ..FastSamSplatSettings::default() };
    FastSamSplat::new(Box::new(Nothing), settings, &mut |_| {}).unwrap()
}

/// The default memory.
pub fn evidence() -> MemorySettings {
    MemorySettings::default()
}

/// The paper's memory, with a codebook that is made at once.
pub fn features() -> MemorySettings {
    MemorySettings { kind: MemoryKind::Features, num_codes: 64, ..MemorySettings::default() }
}

/// The ids that a frame shows.
pub fn truth(scene: &SyntheticScene, index: usize) -> SegmentMap {
    scene.read_ground_truth(index).unwrap().unwrap()
}

/// True masks of at least [`MIN_AREA`] pixels, in an order that changes from frame to frame.
pub fn masks(truth: &SegmentMap, index: usize) -> Vec<ScoredMask> {
    let mut masks: Vec<ScoredMask> = Mask::of_segments(truth)
        .into_iter()
        .filter(|(_, mask)| mask.area() >= MIN_AREA)
        .map(|(_, mask)| ScoredMask { mask, score: 1.0 })
        .collect();
    let count = masks.len().max(1);
    masks.rotate_left(index * 7 % count);
    masks
}

/// Adds the pixels of each (true id, output id) pair.
pub fn count_pairs(pairs: &mut BTreeMap<(SegmentId, SegmentId), usize>, truth: &SegmentMap, output: &SegmentMap) {
    for pair in truth.pixels().iter().zip(output.pixels()) {
        *pairs.entry((*pair.0, *pair.1)).or_insert(0) += 1;
    }
}
