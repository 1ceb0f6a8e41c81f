//! Upsampling and pooling of feature maps.

use super::FeatureMap;
use crate::instructions::Instructions;
use rayon::prelude::*;

/// Enlarges `small` to the size of `map` by bilinear interpolation and adds it to `map`, like PyTorch's `interpolate`
/// with `mode="bilinear", align_corners=False`.
///
/// Along an axis where `small` has half as many pixels as `map`, rounded up, as after a layer of stride 2, the factor is
/// exactly 2. An odd size thus ends half a coarse pixel early (`interpolate` with `scale_factor=2`, then cropped),
/// instead of being stretched.
///
/// # Panics
/// If the maps have different numbers of channels, or one of them is empty.
pub fn add_upsampled(small: &FeatureMap, map: &mut FeatureMap, instructions: Instructions) {
    assert_eq!(small.channels(), map.channels(), "channels of the maps to add");
    let (layout, below) = (map.layout(), small.layout());
    let columns: Vec<Sample> = samples(below.width, layout.width);
    let rows: Vec<Sample> = samples(below.height, layout.height);
    map.values_mut().par_chunks_exact_mut(layout.plane()).enumerate().for_each(|(channel, plane)| {
        let mut wide = vec![0.0; below.height * layout.width];
        instructions.run(
            #[inline(always)]
            || {
                for (row, wide) in wide.chunks_exact_mut(layout.width).enumerate() {
                    let values = small.row(channel, row);
                    for (out, sample) in wide.iter_mut().zip(&columns) {
                        let (low, high) = (values[sample.low], values[sample.high]);
                        *out = low + sample.weight * (high - low);
                    }
                }
                let out_rows = plane[layout.lead()..].chunks_exact_mut(layout.pitch());
                for (out, sample) in out_rows.zip(&rows) {
                    let low = &wide[sample.low * layout.width..][..layout.width];
                    let high = &wide[sample.high * layout.width..][..layout.width];
                    for (out, (low, high)) in out.iter_mut().zip(low.iter().zip(high)) {
                        *out += low + sample.weight * (high - low);
                    }
                }
            },
        );
    });
}

/// An interpolation between two values: `low + weight · (high - low)`.
struct Sample {
    low: usize,
    high: usize,
    weight: f32,
}

/// Returns the sampling positions that resize `from` values to `to` values.
fn samples(from: usize, to: usize) -> Vec<Sample> {
    // A layer of stride 2 makes `from` pixels of 2 · from - 1 as well as of 2 · from, from the same places.
    let scale = if from == to.div_ceil(2) { 0.5 } else { from as f32 / to as f32 };
    (0..to)
        .map(|index| {
            let place = ((index as f32 + 0.5) * scale - 0.5).max(0.0);
            let low = (place as usize).min(from - 1);
            Sample { low, high: (low + 1).min(from - 1), weight: place - low as f32 }
        })
        .collect()
}

/// The mean of every channel, as a map of 1×1 pixel.
///
/// # Panics
/// If the map is empty.
pub fn mean_per_channel(map: &FeatureMap) -> FeatureMap {
    let mut means = FeatureMap::zeros(map.channels(), 1, 1);
    let count = (map.height() * map.width()) as f32;
    for (channel, mut rows) in means.rows_mut().enumerate() {
        let sum: f32 = (0..map.height()).map(|row| map.row(channel, row).iter().sum::<f32>()).sum();
        rows.by_ref().for_each(|row| row[0] = sum / count);
    }
    means
}
