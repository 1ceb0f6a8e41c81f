//! Doubling and pooling of feature maps.

use super::FeatureMap;
use crate::instructions::Instructions;
use rayon::prelude::*;

/// Doubles the size of `small` by bilinear interpolation and adds it to `map`. `small` has the size of a layer of stride
/// 2 on `map`, whose first output is centred at row and column `start` of `map`, 0 or 1.
///
/// From 0, this is PyTorch's `interpolate` with `scale_factor=2, mode="bilinear", align_corners=False`, cropped to the
/// size of `map`. The factor is exactly 2 for odd sizes, too: they end half a coarse pixel early. Resizing to an odd size
/// would stretch the map.
///
/// # Panics
/// If the maps have different numbers of channels, one of them is empty, or `small` has another size.
pub fn add_doubled(small: &FeatureMap, map: &mut FeatureMap, start: [usize; 2], instructions: Instructions) {
    assert_eq!(small.channels(), map.channels(), "channels of the maps to add");
    let (layout, below) = (map.layout(), small.layout());
    let columns: Vec<Sample> = samples(below.width, layout.width, start[1]);
    let rows: Vec<Sample> = samples(below.height, layout.height, start[0]);
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

/// Returns the sampling positions that double `from` values to `to` values, from value `start` on. Places beyond the
/// first and the last of the `from` values get that value.
fn samples(from: usize, to: usize, start: usize) -> Vec<Sample> {
    assert_eq!(from, to.saturating_sub(start).div_ceil(2), "half of {to} values from {start} on");
    (0..to)
        .map(|index| {
            let place = ((index as f32 - start as f32 + 0.5) * 0.5 - 0.5).max(0.0);
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
