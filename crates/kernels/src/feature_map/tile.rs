//! Tiles of outputs: sums of products held in registers, then activation, residual and store.

use crate::Activation;
use crate::instructions::{LANES, multiply_add};
use pulp::Simd;

/// Adds the products of `ROWS` output channels to `first` and stores the sums in `out`.
///
/// `channels` yields the values of each input channel, starting at the tile's first position; a tap is an offset from
/// there. `weights` is `[inputs, taps, rows]`.
#[inline(always)]
pub(super) fn sum_products<
    'a,
    S: Simd,
    const ROWS: usize,
    const VECTORS: usize,
    const FUSED: bool,
    const TAPS: usize,
>(
    simd: S,
    channels: impl Iterator<Item = &'a [f32]>,
    taps: &[usize; TAPS],
    weights: &[f32],
    first: [[S::f32s; VECTORS]; ROWS],
    out: &mut [[S::f32s; VECTORS]; ROWS],
) {
    let mut sums = first;
    for (channel, weights) in channels.zip(weights.chunks_exact(TAPS * ROWS)) {
        for (tap, weights) in taps.iter().zip(weights.as_chunks::<ROWS>().0) {
            let (pixels, _) = S::as_simd_f32s(&channel[*tap..][..VECTORS * S::F32_LANES]);
            let mut vectors = [simd.splat_f32s(0.0); VECTORS];
            vectors.copy_from_slice(pixels);
            for row in 0..ROWS {
                let factor = simd.splat_f32s(weights[row]);
                for vector in 0..VECTORS {
                    sums[row][vector] = multiply_add::<S, FUSED>(simd, factor, vectors[vector], sums[row][vector]);
                }
            }
        }
    }
    // `out` is separate memory, so that `sums` stays in registers.
    for (out, sums) in out.iter_mut().zip(sums) {
        for (out, sum) in out.iter_mut().zip(sums) {
            *out = sum;
        }
    }
}

/// Applies the activation to whole vectors.
#[inline(always)]
pub(super) fn finish(activation: Activation, values: &mut [f32]) {
    for lanes in values.as_chunks_mut::<LANES>().0 {
        activation.apply(lanes);
    }
}

/// Copies the first values to `out` and adds the residual, if any.
#[inline(always)]
pub(super) fn write(values: &[f32], residual: Option<&[f32]>, out: &mut [f32]) {
    match residual {
        Some(residual) => {
            out.iter_mut()
                .zip(values.iter().zip(residual))
                .for_each(|(out, (value, residual))| *out = value + residual);
        }
        None => out.copy_from_slice(&values[..out.len()]),
    }
}
