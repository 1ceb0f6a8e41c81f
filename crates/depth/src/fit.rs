//! Scale, shift and smooth residual that make a prediction fit depth that is known better.
//!
//! Predictors are trained up to scale and shift of the inverse depth (MiDaS: Ranftl et al., TPAMI 2022), or predict metres
//! with a scale that wanders from frame to frame. So the inverse depth is multiplied and shifted, and what remains, which
//! is smooth, is taken away, too. Things that have moved since, and edges that a prediction blurs, are outliers.

use crate::residual::{Measurements, Residual};
use splatseg_geometry::{CowImage, Image};

/// About the number of pixels that a fit looks at.
const SAMPLES: usize = 6000;

/// A fit needs at least this many.
const MIN_SAMPLES: usize = 60;

/// Relative deviation of a depth that counts half.
const USUAL_ERROR: f32 = 0.05;

/// Pixels whose depth deviates by more than this are of another surface: the logarithm of the ratio.
const MAX_ERROR: f32 = 0.4;

/// Steps of the robust fit.
const STEPS: usize = 10;

/// A prior on the shift: as many pixels that say that it is zero, as a share of all.
const SHIFT_PRIOR: f32 = 0.15;

/// Scale and shift that are assumed until a prediction is compared: those of the previous frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FitPrior {
    /// Factor of the inverse depth.
    pub scale: f32,
    /// Shift of the inverse depth, 1/m.
    pub shift: f32,
}

impl Default for FitPrior {
    /// A prediction in metres.
    fn default() -> Self {
        Self { scale: 1.0, shift: 0.0 }
    }
}

/// A correction of a prediction: scale, shift and a smooth residual.
#[derive(Clone, Debug, PartialEq)]
pub struct DepthFit {
    prior: FitPrior,
    residual: Residual,
    /// Median deviation after the fit, relative; 0 if nothing was known to compare with.
    pub error: f32,
    /// Share of the prediction that could be compared, 0 to 1.
    pub compared: f32,
}

/// A pixel of the prediction and of the known depth.
struct Pair {
    place: (f32, f32),
    /// Inverse depths.
    predicted: f32,
    known: f32,
}

impl DepthFit {
    /// The fit of a prediction that cannot be compared with anything.
    pub fn of_prior(prior: FitPrior) -> Self {
        Self { prior, residual: Residual::default(), error: 0.0, compared: 0.0 }
    }

    /// Fits predicted depth to known depth of the same view, `[height, width]` each, of any sizes, 0 where there is none. With
    /// too little to compare it is that of the prior.
    pub fn new(predicted: &CowImage<'_, f32>, known: &CowImage<'_, f32>, prior: FitPrior) -> Self {
        let (pairs, all) = pairs(predicted, known);
        if pairs.len() < MIN_SAMPLES {
            return Self::of_prior(prior);
        }
        let global = global_fit(&pairs, prior);
        let log_error = |pair: &Pair| (pair.known / (global.scale * pair.predicted + global.shift)).ln();
        let mut measurements = Measurements::default();
        for pair in &pairs {
            let error = log_error(pair);
            if error.abs() < MAX_ERROR {
                measurements.add(pair.place, error, weight(error));
            }
        }
        let residual = measurements.solved();
        let mut errors: Vec<f32> = pairs.iter().map(|pair| (log_error(pair) - residual.at(pair.place)).abs()).collect();
        errors.sort_unstable_by(f32::total_cmp);
        let error = errors.get(errors.len() / 2).copied().unwrap_or(0.0);
        Self { prior: global, residual, error, compared: pairs.len() as f32 / all.max(1) as f32 }
    }

    /// Scale and shift, for the next frame.
    pub fn prior(&self) -> FitPrior {
        self.prior
    }

    /// A prediction that fits, metres, `[height, width]`.
    pub fn apply(&self, predicted: &CowImage<'_, f32>) -> Image<f32> {
        let (width, height) = predicted.size();
        Image::from_fn(width, height, |column, row| {
            let depth = predicted[(column, row)];
            if depth <= 0.0 {
                return 0.0;
            }
            let inverse = self.prior.scale / depth + self.prior.shift;
            let inverse = inverse * self.residual.at(place((column, row), (width, height))).exp();
            if inverse > 0.0 { 1.0 / inverse } else { 0.0 }
        })
    }
}

/// A pixel's place as shares of the width and the height.
fn place((column, row): (usize, usize), (width, height): (usize, usize)) -> (f32, f32) {
    ((column as f32 + 0.5) / width as f32, (row as f32 + 0.5) / height as f32)
}

/// Pixels that have both depths, and how many of these pixels are predicted.
fn pairs(predicted: &CowImage<'_, f32>, known: &CowImage<'_, f32>) -> (Vec<Pair>, usize) {
    let (width, height) = known.size();
    let step = ((width * height) as f32 / SAMPLES as f32).sqrt().ceil().max(1.0) as usize;
    let (mut found, mut all) = (Vec::new(), 0);
    for row in (step / 2..height).step_by(step) {
        for column in (step / 2..width).step_by(step) {
            let place = place((column, row), (width, height));
            let at = (
                ((place.0 * predicted.width() as f32) as usize).min(predicted.width() - 1),
                ((place.1 * predicted.height() as f32) as usize).min(predicted.height() - 1),
            );
            let (predicted, known) = (predicted[at], known[(column, row)]);
            if predicted > 0.0 {
                all += 1;
                if known > 0.0 {
                    found.push(Pair { place, predicted: 1.0 / predicted, known: 1.0 / known });
                }
            }
        }
    }
    (found, all)
}

/// Weight of a relative error: a Cauchy distribution.
fn weight(error: f32) -> f32 {
    1.0 / (1.0 + (error / USUAL_ERROR) * (error / USUAL_ERROR))
}

/// Scale and shift by iteratively reweighted least squares, from the median ratio.
fn global_fit(pairs: &[Pair], prior: FitPrior) -> FitPrior {
    let mut ratios: Vec<f32> = pairs.iter().map(|pair| pair.known / pair.predicted).collect();
    ratios.sort_unstable_by(f32::total_cmp);
    let start = FitPrior { scale: ratios[ratios.len() / 2], shift: 0.0 };
    let mut fit = start;
    for _ in 0..STEPS {
        // Of the relative error (scale · predicted + shift) / known − 1.
        let [mut aa, mut ab, mut bb, mut a, mut b, mut sum] = [0.0f64; 6];
        for pair in pairs {
            let error = ((fit.scale * pair.predicted + fit.shift) / pair.known).max(1e-6).ln();
            let weight = f64::from(weight(error));
            let (scale, shift) = (f64::from(pair.predicted / pair.known), f64::from(1.0 / pair.known));
            (aa, ab, bb) = (aa + weight * scale * scale, ab + weight * scale * shift, bb + weight * shift * shift);
            (a, b, sum) = (a + weight * scale, b + weight * shift, sum + weight);
        }
        let typical = b / sum.max(1e-9);
        let held = f64::from(SHIFT_PRIOR) * sum * typical * typical;
        let (bb, b) = (bb + held, b + held * f64::from(prior.shift));
        let determinant = aa * bb - ab * ab;
        let next = FitPrior {
            scale: ((a * bb - ab * b) / determinant) as f32,
            shift: ((aa * b - ab * a) / determinant) as f32,
        };
        // A small scale with a large shift would flatten everything to one depth.
        let is_possible =
            |fit: &FitPrior| fit.scale.is_finite() && fit.shift.is_finite() && fit.scale > 0.2 * start.scale;
        if !is_possible(&next) {
            break;
        }
        fit = next;
    }
    fit
}

#[cfg(test)]
mod tests {
    use super::*;

    fn room(column: usize, row: usize) -> f32 {
        let (x, y) = (column as f32 / 160.0, row as f32 / 120.0);
        1.0 / (0.25 + 0.3 * x + 0.2 * y + if (0.4..0.6).contains(&x) { 0.4 } else { 0.0 })
    }

    /// Largest relative error of a fitted prediction.
    fn largest_error(found: &Image<f32>) -> f32 {
        let errors = (0..120).flat_map(|row| (0..160).map(move |column| (column, row)));
        errors.map(|at| (found[at] / room(at.0, at.1) - 1.0).abs()).fold(0.0, f32::max)
    }

    #[test]
    fn scale_and_shift_are_found() {
        let known = Image::from_fn(160, 120, room);
        let predicted = known.map(|depth| 1.0 / ((1.0 / depth - 0.05) / 1.7));
        let fit = DepthFit::new(&predicted, &known, FitPrior { scale: 1.0, shift: 0.05 });
        assert!((fit.prior().scale - 1.7).abs() < 0.02 && (fit.prior().shift - 0.05).abs() < 0.01, "{:?}", fit.prior());
        assert!(largest_error(&fit.apply(&predicted)) < 0.01);
    }

    #[test]
    fn a_bent_prediction_is_straightened_and_outliers_are_ignored() {
        let known = Image::from_fn(160, 120, |column, row| match () {
            () if column < 30 => 0.0,
            // Somebody stands there now.
            () if (100..130).contains(&column) && row > 40 => 0.9,
            () => room(column, row),
        });
        let predicted = Image::from_fn(160, 120, |column, row| {
            let bend = 0.08 * (column as f32 / 50.0).sin() + 0.06 * (row as f32 / 45.0).cos();
            1.2 * room(column, row) * bend.exp()
        });
        let fit = DepthFit::new(&predicted, &known, FitPrior::default());
        let fitted = fit.apply(&predicted);
        for at in [(40, 20), (80, 60), (90, 110), (150, 30), (150, 110)] {
            let error = (fitted[at] / room(at.0, at.1) - 1.0).abs();
            assert!(error < 0.04, "{at:?}: {error}");
        }
        assert!(fit.error < 0.03 && (0.75..0.85).contains(&fit.compared), "{fit:?}");
    }

    #[test]
    fn without_anything_to_compare_the_prior_holds() {
        let predicted = Image::filled(160, 120, 2.0);
        let prior = FitPrior { scale: 0.5, shift: 0.0 };
        let fit = DepthFit::new(&predicted, &Image::filled(160, 120, 0.0), prior);
        assert_eq!(fit, DepthFit::of_prior(prior));
        assert_eq!(fit.apply(&predicted)[(3, 4)], 4.0);
    }
}
