//! `exp` for many values at once.

use pulp::Arch;

/// 2^x for x ≤ 0 within 2 units in the last place; 0 below -126. Written so that the compiler turns a loop over it
/// into vector code.
#[inline(always)]
fn exp2(x: f32) -> f32 {
    // Adding 1.5 · 2^23 leaves the nearest integer in the low bits of the mantissa.
    const ROUND: f32 = 12_582_912.0;
    let clamped = x.max(-127.0);
    let shifted = clamped + ROUND;
    let fraction = clamped - (shifted - ROUND);
    // Taylor series of 2^f around 0, for |f| <= 0.5.
    let mut value = 1.525_273_3e-5;
    value = f32::mul_add(value, fraction, 1.540_353e-4);
    value = f32::mul_add(value, fraction, 1.333_355_8e-3);
    value = f32::mul_add(value, fraction, 9.618_129e-3);
    value = f32::mul_add(value, fraction, 5.550_411e-2);
    value = f32::mul_add(value, fraction, 2.402_265e-1);
    value = f32::mul_add(value, fraction, 6.931_472e-1);
    value = f32::mul_add(value, fraction, 1.0);
    let exponent = shifted.to_bits().wrapping_sub(ROUND.to_bits()).wrapping_add(127);
    value * f32::from_bits(exponent << 23)
}

/// One block of scores of the running softmax: updates each row's maximum and sum, replaces the scores by
/// exp(score - maximum), and returns in `rescale` by what each row's earlier results must be multiplied.
/// `scores` is `[rows, columns]`, times log2(e).
pub fn softmax_block(
    arch: Arch,
    scores: &mut [f32],
    columns: usize,
    running: &mut [RunningSoftmax],
    rescale: &mut [f32],
) {
    arch.dispatch(
        #[inline(always)]
        || {
            for ((row, state), rescale) in scores.chunks_exact_mut(columns).zip(running).zip(rescale) {
                let maximum = state.maximum.max(maximum(row));
                *rescale = exp2(state.maximum - maximum);
                let mut sums = [0f32; 16];
                let (blocks, rest) = row.as_chunks_mut::<16>();
                for block in blocks {
                    for (value, sum) in block.iter_mut().zip(&mut sums) {
                        *value = exp2(*value - maximum);
                        *sum += *value;
                    }
                }
                for value in rest {
                    *value = exp2(*value - maximum);
                    sums[0] += *value;
                }
                state.sum = state.sum * *rescale + sums.iter().sum::<f32>();
                state.maximum = maximum;
            }
        },
    );
}

#[inline(always)]
fn maximum(row: &[f32]) -> f32 {
    let mut lanes = [f32::NEG_INFINITY; 16];
    let (blocks, rest) = row.as_chunks::<16>();
    for block in blocks {
        for (lane, value) in lanes.iter_mut().zip(block) {
            *lane = if *value > *lane { *value } else { *lane };
        }
    }
    rest.iter().chain(&lanes).copied().fold(f32::NEG_INFINITY, f32::max)
}

/// Multiplies each row of `values`, `[rows, columns]`, by its factor.
pub fn scale_rows(arch: Arch, values: &mut [f32], columns: usize, factors: &[f32]) {
    arch.dispatch(
        #[inline(always)]
        || {
            for (row, factor) in values.chunks_exact_mut(columns).zip(factors) {
                if *factor != 1.0 {
                    row.iter_mut().for_each(|value| *value *= factor);
                }
            }
        },
    );
}

/// Maximum so far, and sum of exponentials relative to it.
#[derive(Clone, Copy)]
pub struct RunningSoftmax {
    pub maximum: f32,
    pub sum: f32,
}

impl RunningSoftmax {
    /// Before the first score. The maximum is finite so that differences of maxima are numbers.
    pub const EMPTY: Self = Self { maximum: -1e30, sum: 0.0 };
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn powers_of_two_are_accurate() {
        for step in 0..200_000 {
            let x = -(step as f32) * 0.0007;
            let (found, expected) = (f64::from(exp2(x)), f64::from(x).exp2());
            assert!((found - expected).abs() <= 2e-7 * expected + 1e-37, "{x}: {found} instead of {expected}");
        }
        assert_eq!(exp2(-1e30), 0.0);
        assert_eq!(exp2(0.0), 1.0);
    }
}
