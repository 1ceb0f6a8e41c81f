//! Exponentials and the error function, written so that a loop over them becomes vector code.
//!
//! [`exp`](exp()) and [`exp2`] are for the networks and differ only in how they reduce their argument. [`exp_negative`]
//! computes blending weights. It uses separate products and sums, which give the same bits on every processor and are
//! fast on all of them: with `f32::mul_add`, a processor without FMA would call a library function per step.

use std::f32::consts::{LN_2, LOG2_E};

/// 1.5 · 2^23: adding it to a small number rounds the number to an integer, which ends up in the lowest bits.
const ROUND: f32 = 12_582_912.0;

/// e^r · 2^n for |r| ≤ ln 2 / 2, where n is the integer in the lowest bits of `shifted`. Uses the minimax polynomial of
/// Cephes' expf.
#[inline(always)]
fn scaled_exp(r: f32, shifted: f32) -> f32 {
    let mut p = 1.987_569_1e-4;
    p = f32::mul_add(p, r, 1.398_199_9e-3);
    p = f32::mul_add(p, r, 8.333_452e-3);
    p = f32::mul_add(p, r, 4.166_579_6e-2);
    p = f32::mul_add(p, r, 0.166_666_65);
    p = f32::mul_add(p, r, 0.5);
    let e = f32::mul_add(p, r * r, r) + 1.0;
    let exponent = (shifted.to_bits() << 23).wrapping_add(127 << 23);
    e * f32::from_bits(exponent)
}

/// e^x for x in [-87, 88], within 2 units in the last place.
#[inline(always)]
pub fn exp(x: f32) -> f32 {
    let shifted = f32::mul_add(x, LOG2_E, ROUND);
    let n = shifted - ROUND;
    // ln 2 in two parts; the first has few enough bits that its product with n is exact.
    let r = f32::mul_add(n, 2.121_944_4e-4, f32::mul_add(n, -0.693_359_4, x));
    scaled_exp(r, shifted)
}

/// 2^x for x ≤ 127, within 2 units in the last place; 0 below -126.
#[inline(always)]
pub fn exp2(x: f32) -> f32 {
    let clamped = x.max(-127.0);
    let shifted = clamped + ROUND;
    scaled_exp((clamped - (shifted - ROUND)) * LN_2, shifted)
}

/// e^-x for x ≥ 0, with a relative error of at most 6e-7; about 1e-9 beyond x = 21.
#[inline(always)]
pub fn exp_negative(x: f32) -> f32 {
    // e^-x = 2^-y with y = n - f, |f| <= 1/2; beyond 2^-30 nothing can be blended.
    let y = x * LOG2_E;
    let y = if y < 30.0 { y } else { 30.0 };
    let y = if y > 0.0 { y } else { 0.0 };
    let shifted = y + ROUND;
    let n = shifted.to_bits().wrapping_sub(ROUND.to_bits());
    let t = ((shifted - ROUND) - y) * LN_2;
    let series = 1.0 / 720.0;
    let series = series * t + 1.0 / 120.0;
    let series = series * t + 1.0 / 24.0;
    let series = series * t + 1.0 / 6.0;
    let series = series * t + 0.5;
    let series = series * t + 1.0;
    let series = series * t + 1.0;
    series * f32::from_bits(127u32.wrapping_sub(n) << 23)
}

/// The error function within 4 units in the last place: a ratio of polynomials in x² fitted on [-4, 4], with the
/// coefficients of Eigen and XLA. Outside, erf is ±1 in single precision.
#[inline(always)]
pub fn erf(x: f32) -> f32 {
    let x = if x > 4.0 { 4.0 } else { x };
    let x = if x < -4.0 { -4.0 } else { x };
    let square = x * x;
    let mut p = -2.726_142_3e-10;
    p = f32::mul_add(p, square, 2.770_681_4e-8);
    p = f32::mul_add(p, square, -2.101_024e-6);
    p = f32::mul_add(p, square, -5.692_506_4e-5);
    p = f32::mul_add(p, square, -7.349_906_3e-4);
    p = f32::mul_add(p, square, -2.954_6e-3);
    p = f32::mul_add(p, square, -1.609_603_3e-2);
    let mut q = -1.456_607_2e-5;
    q = f32::mul_add(q, square, -2.133_740_6e-4);
    q = f32::mul_add(q, square, -1.682_827e-3);
    q = f32::mul_add(q, square, -7.373_329e-3);
    q = f32::mul_add(q, square, -1.426_473_9e-2);
    x * p / q
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exponentials_are_accurate() {
        for step in 0..200_000 {
            let x = (step as f32).mul_add(-0.0007, 60.0);
            let (found, expected) = (f64::from(exp(x)), f64::from(x).exp());
            assert!((found - expected).abs() <= 2e-7 * expected, "exp({x}) is {found} instead of {expected}");
        }
    }

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

    #[test]
    fn negative_exponentials_are_accurate() {
        for step in 0..60_000 {
            let x = step as f32 * 1e-4;
            let relative = (f64::from(exp_negative(x)) / (-f64::from(x)).exp() - 1.0).abs();
            assert!(relative < 6e-7, "exp(-{x}) is off by {relative}");
        }
        assert!(exp_negative(1e30) < 1e-8 && exp_negative(f32::INFINITY) < 1e-8);
    }
}
