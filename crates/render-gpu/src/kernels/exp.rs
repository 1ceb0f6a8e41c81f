//! The exponential of the blend weights, step for step that of the CPU (`splatseg_kernels::exp::exp_negative`).

use cubecl::prelude::*;
use std::f32::consts::{LN_2, LOG2_E};

/// 1.5 · 2^23: adding it to a small number rounds that to an integer and leaves the integer in the lowest bits.
const ROUND: f32 = 12_582_912.0;
/// The bits of [`ROUND`].
const ROUND_BITS: u32 = 0x4b40_0000;

/// e^-x for x ≥ 0, with a relative error of at most 6e-7; about 1e-9 beyond x = 21.
#[cube]
pub(crate) fn exp_negative(x: f32) -> f32 {
    let y = clamp_to(x * LOG2_E, 30.0);
    // The integer is read off the bits: a compiler may take `(y + ROUND) - ROUND` for `y`.
    let n = u32::reinterpret(y + ROUND) - ROUND_BITS;
    let t = (f32::cast_from(n) - y) * LN_2;
    let series = t * (1.0f32 / 720.0f32) + 1.0f32 / 120.0f32;
    let series = series * t + 1.0f32 / 24.0f32;
    let series = series * t + 1.0f32 / 6.0f32;
    let series = series * t + 0.5;
    let series = series * t + 1.0;
    let series = series * t + 1.0;
    series * f32::reinterpret((127u32 - n) << 23u32)
}

/// A number between 0 and `max`; `max` for what is not a number.
#[cube]
fn clamp_to(y: f32, max: f32) -> f32 {
    let below = select(y < max, y, max);
    select(below > 0.0, below, 0.0)
}

/// Writes the exponentials of `input`; for tests.
#[cube(launch)]
pub(crate) fn exp_negative_all(input: &[f32], output: &mut [f32]) {
    if ABSOLUTE_POS < output.len() {
        output[ABSOLUTE_POS] = exp_negative(input[ABSOLUTE_POS]);
    }
}
