//! Activation functions.

use crate::exp::{exp, normal_cdf};
use crate::instructions::{Instructions, LANES};
use rayon::prelude::*;

/// Activation function after a layer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Activation {
    /// The identity.
    None,
    /// max(x, 0).
    Relu,
    /// x · σ(x).
    Silu,
    /// x · Φ(x), exact.
    Gelu,
    /// x · σ(1.702 x), the approximation of [`Self::Gelu`] that the first CLIP networks have.
    QuickGelu,
}

impl Activation {
    /// Applies the activation in place. Fast within [`Instructions::run`].
    #[inline(always)]
    pub fn apply(self, values: &mut [f32]) {
        match self {
            Self::None => {}
            Self::Relu => relu(values),
            Self::Silu => silu(values),
            Self::Gelu => gelu(values),
            Self::QuickGelu => quick_gelu(values),
        }
    }

    /// Applies the activation in place, on all threads.
    pub fn apply_parallel(self, values: &mut [f32]) {
        let instructions = Instructions::best();
        values.par_chunks_mut(1024 * LANES).for_each(|values| {
            instructions.run(
                #[inline(always)]
                || self.apply(values),
            );
        });
    }
}

/// max(x, 0); keeps NaN.
#[inline(always)]
fn relu(values: &mut [f32]) {
    for value in values {
        *value = if *value < 0.0 { 0.0 } else { *value };
    }
}

/// x · σ(x) = x / (1 + e^-x), to about 2 units in the last place.
#[inline(always)]
fn silu(values: &mut [f32]) {
    scaled_silu(values, 1.0);
}

/// x · σ(1.702 x).
#[inline(always)]
fn quick_gelu(values: &mut [f32]) {
    scaled_silu(values, 1.702);
}

/// x · σ(scale · x).
#[inline(always)]
fn scaled_silu(values: &mut [f32], scale: f32) {
    for value in values {
        // Comparisons rather than `clamp`, to keep NaN.
        let z = -scale * *value;
        let z = if z > 88.0 { 88.0 } else { z };
        let z = if z < -87.0 { -87.0 } else { z };
        *value /= 1.0 + exp(z);
    }
}

/// x · Φ(x), with Φ the cumulative distribution function of the normal distribution.
#[inline(always)]
fn gelu(values: &mut [f32]) {
    for value in values {
        *value *= normal_cdf(*value);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Inputs at which the exponential overflows or underflows, and NaN.
    #[test]
    fn silu_holds_at_the_extremes() {
        let values = [0.0, -0.0, 1e-30, -1e-4, 3.0, -20.0, 86.0, -86.0, -89.0, 500.0, -500.0, 3e38, -3e38, f32::NAN];
        for instructions in Instructions::available() {
            let mut output = values;
            instructions.run(|| silu(&mut output));
            for (value, found) in values.iter().zip(&output) {
                let x = f64::from(*value);
                let expected = x / (1.0 + (-x).exp());
                // Below -88 the sigmoid stays at e^-88.
                let close = (f64::from(*found) - expected).abs() <= 4e-7 * expected.abs() + 1e-38 * x.abs() + 1e-30;
                assert!(close || (value.is_nan() && found.is_nan()), "silu({value}) is {found}, not {expected}");
            }
        }
    }

    /// Compares with the power series of erf in double precision, and with its limits.
    #[test]
    fn gelu_is_exact() {
        let series = |x: f64| {
            let (mut term, mut sum) = (x, x);
            for n in 1..200 {
                term *= -x * x / f64::from(n);
                sum += term / f64::from(2 * n + 1);
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
    fn quick_gelu_is_a_steeper_silu() {
        for x in [-60.0f32, -3.0, -0.5, 0.0, 0.7, 4.0, 100.0] {
            let mut found = [x];
            Activation::QuickGelu.apply(&mut found);
            let expected = f64::from(x) / (1.0 + (-1.702 * f64::from(x)).exp());
            assert!((f64::from(found[0]) - expected).abs() <= 5e-7 * expected.abs() + 1e-30, "{x}: {found:?}");
        }
    }

    #[test]
    fn relu_keeps_positive_values() {
        let mut values = [-1.0, 0.0, 2.0, f32::NAN];
        relu(&mut values);
        assert!(values[..3] == [0.0, 0.0, 2.0] && values[3].is_nan());
    }
}
