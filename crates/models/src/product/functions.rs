//! Functions of many values at once, written so that the compiler turns a loop over them into vector code.

/// 2^x within 2 units in the last place, for x ≤ 127; 0 below -126.
#[inline(always)]
pub(crate) fn exp2(x: f32) -> f32 {
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

/// e^x for x in [-87, 88], within 2 units in the last place.
#[inline(always)]
fn exp(x: f32) -> f32 {
    const ROUND: f32 = 12_582_912.0;
    let shifted = f32::mul_add(x, core::f32::consts::LOG2_E, ROUND);
    let n = shifted - ROUND;
    // ln 2 in two parts, the first with so few bits that n times it is exact.
    let r = f32::mul_add(n, 2.121_944_4e-4, f32::mul_add(n, -0.693_359_4, x));
    // Minimax polynomial of Cephes' expf on [-ln 2 / 2, ln 2 / 2].
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

/// max(x, 0); NaN stays.
#[inline(always)]
pub(crate) fn relu(values: &mut [f32]) {
    for value in values {
        *value = if *value < 0.0 { 0.0 } else { *value };
    }
}

/// x · σ(x) = x / (1 + e^-x), to about 2 units in the last place.
#[inline(always)]
pub(crate) fn silu(values: &mut [f32]) {
    for value in values {
        // Comparisons rather than `clamp`, so that NaN stays.
        let z = -*value;
        let z = if z > 88.0 { 88.0 } else { z };
        let z = if z < -87.0 { -87.0 } else { z };
        *value /= 1.0 + exp(z);
    }
}

/// x · Φ(x), with Φ the normal distribution's cumulative function.
#[inline(always)]
pub(crate) fn gelu(values: &mut [f32]) {
    for value in values {
        let x = *value;
        *value = 0.5 * x * (1.0 + erf(x * core::f32::consts::FRAC_1_SQRT_2));
    }
}

/// The error function within 4 units in the last place: a ratio of polynomials in x² fitted on [-4, 4] (the coefficients
/// are those of Eigen's and XLA's), outside of which erf is ±1 in single precision.
#[inline(always)]
fn erf(x: f32) -> f32 {
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
    use super::super::Instructions;
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

    /// The activation where its exponential over- and underflows, and where numbers are none.
    #[test]
    fn silu_holds_at_the_extremes() {
        let values = [0.0, -0.0, 1e-30, -1e-4, 3.0, -20.0, 86.0, -86.0, -89.0, 500.0, -500.0, 3e38, -3e38, f32::NAN];
        for instructions in Instructions::available() {
            let mut output = values;
            instructions.vectorized(|| silu(&mut output));
            for (value, found) in values.iter().zip(&output) {
                let x = f64::from(*value);
                let expected = x / (1.0 + (-x).exp());
                // Below -88 the sigmoid stays at e^-88.
                let close = (f64::from(*found) - expected).abs() <= 4e-7 * expected.abs() + 1e-38 * x.abs() + 1e-30;
                assert!(close || (value.is_nan() && found.is_nan()), "silu({value}) is {found}, not {expected}");
            }
        }
    }

    /// Against the power series of erf in double precision, and its limits.
    #[test]
    fn gelu_is_exact() {
        let series = |x: f64| {
            let (mut term, mut sum) = (x, x);
            for n in 1..200 {
                term *= -x * x / n as f64;
                sum += term / (2 * n + 1) as f64;
            }
            sum * core::f64::consts::FRAC_2_SQRT_PI
        };
        for step in -4000..4000 {
            let x = step as f32 * 0.001;
            let mut found = [x];
            gelu(&mut found);
            let x = f64::from(x);
            let expected = 0.5 * x * (1.0 + series(x * core::f64::consts::FRAC_1_SQRT_2));
            assert!((f64::from(found[0]) - expected).abs() <= 3e-7 * x.abs(), "gelu({x}) is {found:?}, not {expected}");
        }
        let mut limits = [50.0, -50.0, f32::NAN];
        gelu(&mut limits);
        assert!((limits[0] - 50.0).abs() < 1e-5 && limits[1].abs() < 1e-5 && limits[2].is_nan(), "{limits:?}");
    }

    #[test]
    fn relu_keeps_what_is_positive() {
        let mut values = [-1.0, 0.0, 2.0, f32::NAN];
        relu(&mut values);
        assert!(values[..3] == [0.0, 0.0, 2.0] && values[3].is_nan());
    }
}
