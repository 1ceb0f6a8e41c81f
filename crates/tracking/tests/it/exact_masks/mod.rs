//! FastSAM-Splat in the synthetic room, with the true masks as predictions, without their ids.

use splatseg_geometry::{Mask, ScoredMask, SegmentId, SegmentMap};
use splatseg_memory::{MemoryKind, MemorySettings};
use splatseg_tracking::{FastSamSplat, FastSamSplatSettings};
use std::collections::BTreeMap;

/// Minimum area of predictions and of shown segments, pixels.
pub const MIN_AREA: usize = 12;

/// Creates the method with an empty memory.
pub fn method(memory: MemorySettings) -> FastSamSplat {
    let settings = FastSamSplatSettings::default().with(|settings| {
        settings.memory = memory;
        settings.min_area = MIN_AREA;
    });
    FastSamSplat::new(settings, 0, &mut |_| {}).unwrap()
}

/// The default memory.
pub fn evidence() -> MemorySettings {
    MemorySettings::default()
}

/// The paper's memory with a small codebook, which is generated quickly.
pub fn features() -> MemorySettings {
    MemorySettings::default().with(|settings| {
        settings.kind = MemoryKind::Features;
        settings.num_codes = 64;
    })
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
