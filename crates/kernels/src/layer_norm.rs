//! Layer normalisation.

use crate::instructions::{Instructions, LANES};
use rayon::prelude::*;

/// Rows per job.
const ROW_BLOCK: usize = 64;

/// The parameters of a layer normalisation.
#[derive(Clone, Copy, Debug)]
pub struct LayerNorm<'a> {
    /// Scale of each channel.
    pub weight: &'a [f32],
    /// Offset of each channel; same length as `weight`.
    pub bias: &'a [f32],
    /// Added to the variance.
    pub epsilon: f32,
}

impl LayerNorm<'_> {
    /// Normalises every row of `rows` `[n, channels]` to mean 0 and variance 1, then multiplies by `weight` and adds
    /// `bias`. Fast within [`Instructions::run`].
    #[inline(always)]
    pub fn apply(&self, rows: &mut [f32]) {
        for row in rows.chunks_exact_mut(self.weight.len()) {
            let mean = sum(row, |value| value) / row.len() as f32;
            let variance = sum(row, |value| (value - mean) * (value - mean)) / row.len() as f32;
            let scale = 1.0 / (variance + self.epsilon).sqrt();
            for ((value, weight), bias) in row.iter_mut().zip(self.weight).zip(self.bias) {
                *value = (*value - mean) * scale * weight + bias;
            }
        }
    }

    /// [`Self::apply`] on all threads.
    pub fn apply_parallel(&self, rows: &mut [f32]) {
        let instructions = Instructions::best();
        rows.par_chunks_mut(ROW_BLOCK * self.weight.len()).for_each(|rows| {
            instructions.run(
                #[inline(always)]
                || self.apply(rows),
            );
        });
    }
}

/// Sum of `term` over a row, computed in lanes.
#[inline(always)]
fn sum(row: &[f32], term: impl Fn(f32) -> f32) -> f32 {
    let (blocks, rest) = row.as_chunks::<LANES>();
    if blocks.is_empty() {
        return rest.iter().map(|value| term(*value)).sum();
    }
    let mut lanes = [0.0; LANES];
    for block in blocks {
        (0..LANES).for_each(|lane| lanes[lane] += term(block[lane]));
    }
    lanes.iter().sum::<f32>() + rest.iter().map(|value| term(*value)).sum::<f32>()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_normalised() {
        for width in [1, 5, 16, 37, 256] {
            let weight: Vec<f32> = (0..width).map(|index| 1.0 + index as f32 * 0.01).collect();
            let bias: Vec<f32> = (0..width).map(|index| index as f32 * 0.1 - 1.0).collect();
            let rows: Vec<f32> = (0..70 * width).map(|index| (index * 37 % 101) as f32 / 25.0 + 3.0).collect();
            let mut found = rows.clone();
            LayerNorm { weight: &weight, bias: &bias, epsilon: 1e-5 }.apply_parallel(&mut found);
            for (row, found) in rows.chunks(width).zip(found.chunks(width)) {
                let mean = row.iter().map(|value| f64::from(*value)).sum::<f64>() / width as f64;
                let variance = row.iter().map(|value| (f64::from(*value) - mean).powi(2)).sum::<f64>() / width as f64;
                for (index, value) in row.iter().enumerate() {
                    let normal = (f64::from(*value) - mean) / (variance + 1e-5).sqrt();
                    let expected = normal * f64::from(weight[index]) + f64::from(bias[index]);
                    assert!((f64::from(found[index]) - expected).abs() < 2e-5, "width {width}: {found:?}");
                }
            }
        }
    }
}
