//! Exponentials and the normal distribution, written so that a loop over them becomes vector code.
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

/// Φ(x), the cumulative distribution function of the normal distribution, with an error of at most 2e-7.
///
/// `(Φ(x) - 1/2) / x` as a polynomial in x², fitted on [-5.2, 5.2] so that the largest error of Φ is smallest. It is
/// written in `u`, which is x² mapped to [-1, 1]: there its terms hardly cancel. It has no division, which takes as long
/// as all of its steps. Beyond 5.2, Φ stays at its value there.
#[inline(always)]
pub fn normal_cdf(x: f32) -> f32 {
    // Comparisons rather than `clamp`, to keep NaN.
    let x = if x > 5.2 { 5.2 } else { x };
    let x = if x < -5.2 { -5.2 } else { x };
    let u = f32::mul_add(x * x, 2.0 / (5.2 * 5.2), -1.0);
    let mut p = 2.023_896_8e-4;
    p = f32::mul_add(p, u, -5.622_904e-4);
    p = f32::mul_add(p, u, 6.007_602e-4);
    p = f32::mul_add(p, u, -9.785_158e-4);
    p = f32::mul_add(p, u, 2.662_442e-3);
    p = f32::mul_add(p, u, -5.067_367_6e-3);
    p = f32::mul_add(p, u, 8.010_09e-3);
    p = f32::mul_add(p, u, -1.235_336e-2);
    p = f32::mul_add(p, u, 1.813_392_3e-2);
    p = f32::mul_add(p, u, -2.476_345e-2);
    p = f32::mul_add(p, u, 3.196_232_4e-2);
    p = f32::mul_add(p, u, -3.992_54e-2);
    p = f32::mul_add(p, u, 5.002_611e-2);
    p = f32::mul_add(p, u, -6.774_381e-2);
    p = f32::mul_add(p, u, 0.135_949_98);
    f32::mul_add(p, x, 0.5)
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
