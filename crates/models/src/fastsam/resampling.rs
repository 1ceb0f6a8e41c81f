//! Linear resampling along one axis, like `interpolate(…, mode="bilinear", align_corners=False)` along each axis.

use std::ops::Range;

/// Maximum number of source samples per target sample, after two consecutive resamplings.
const MAX_TAPS: usize = 4;

/// A target sample as a weighted sum of neighbouring source samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Taps {
    /// First source sample.
    pub first: usize,
    /// Number of source samples.
    pub count: usize,
    /// Weights of the source samples; 0 after the last.
    pub weights: [f32; MAX_TAPS],
}

/// The taps of every target sample.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Resampling(Vec<Taps>);

impl Resampling {
    /// Scales `from` samples to `to`; positions beyond the centre of the first or last sample use that sample.
    pub fn linear(from: usize, to: usize) -> Self {
        Self::from_window(from, 0..from, to, 1)
    }

    /// Scales `from` samples up by the integer `upscaling`, then scales `window`, in samples of the upscaled line, to
    /// `to` samples. Both steps are linear, so together they form one weighted sum of a few source samples.
    pub fn from_window(from: usize, window: Range<usize>, to: usize, upscaling: usize) -> Self {
        let upscaled = from * upscaling;
        let taps_at = |target: usize| {
            let mut weights = [0.0; 2 * 2];
            let mut places = [0; 2 * 2];
            let mut count = 0;
            for (place, weight) in interpolated(target, window.len(), to) {
                for (source, share) in interpolated(window.start + place, from, upscaled) {
                    (places[count], weights[count]) = (source, weight * share);
                    count += 1;
                }
            }
            Taps::sum(&places, &weights)
        };
        Self((0..to).map(taps_at).collect())
    }

    /// Range of source samples that a range of target samples depends on.
    pub fn sources(&self, targets: Range<usize>) -> Range<usize> {
        let Some(taps) = self.0.get(targets).filter(|taps| !taps.is_empty()) else { return 0..0 };
        // Source positions increase with target positions.
        taps[0].first..taps.iter().map(|taps| taps.first + taps.count).max().unwrap_or(0)
    }

    /// The taps of a range of target samples.
    pub fn taps(&self, targets: Range<usize>) -> &[Taps] {
        &self.0[targets]
    }
}

/// Returns the two of `from` samples between which sample `target` of `to` lies, with their weights.
fn interpolated(target: usize, from: usize, to: usize) -> [(usize, f64); 2] {
    let position = ((target as f64 + 0.5) * from as f64 / to as f64 - 0.5).max(0.0);
    let first = (position as usize).min(from - 1);
    let fraction = position - first as f64;
    [(first, 1.0 - fraction), ((first + 1).min(from - 1), fraction)]
}

impl Taps {
    /// Merges weighted samples that are close together.
    fn sum(places: &[usize], weights: &[f64]) -> Self {
        let mixed = || places.iter().zip(weights).filter(|(_, weight)| **weight != 0.0);
        let first = mixed().map(|(place, _)| *place).min().unwrap_or(0);
        let last = mixed().map(|(place, _)| *place).max().unwrap_or(0);
        let mut total = [0.0; MAX_TAPS];
        for (place, weight) in mixed() {
            total[place - first] += weight;
        }
        Self { first, count: last - first + 1, weights: total.map(|weight| weight as f32) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn apply(resampling: &Resampling, line: &[f32]) -> Vec<f32> {
        let weighted_sum =
            |taps: &Taps| (0..taps.count).map(|tap| taps.weights[tap] * line[taps.first + tap]).sum::<f32>();
        resampling.0.iter().map(weighted_sum).collect()
    }

    #[test]
    fn lines_are_interpolated_as_in_pytorch() {
        // torch.nn.functional.interpolate of [1, 3, 2] to 6 and of [1, 3, 2, 8] to 2, bilinear.
        let doubled = apply(&Resampling::linear(3, 6), &[1.0, 3.0, 2.0]);
        assert_eq!(doubled, [1.0, 1.5, 2.5, 2.75, 2.25, 2.0]);
        assert_eq!(apply(&Resampling::linear(4, 2), &[1.0, 3.0, 2.0, 8.0]), [2.0, 5.0]);
        assert_eq!(apply(&Resampling::linear(3, 3), &[1.0, 3.0, 2.0]), [1.0, 3.0, 2.0]);
    }

    proptest! {
        #[test]
        fn one_pass_equals_two_steps(line in prop::collection::vec(-9f32..9.0, 1..20), upscaling in 1usize..5,
                                        to in 1usize..70, cut in (0usize..20, 0usize..20)) {
            let from = line.len();
            let upscaled = apply(&Resampling::linear(from, from * upscaling), &line);
            let start = cut.0.min(upscaled.len() - 1);
            let window = start..(start + 1 + cut.1).min(upscaled.len());
            let expected = apply(&Resampling::linear(window.len(), to), &upscaled[window.clone()]);
            let resampling = Resampling::from_window(from, window, to, upscaling);
            for (found, expected) in apply(&resampling, &line).iter().zip(&expected) {
                prop_assert!((found - expected).abs() < 1e-4, "{} {}", found, expected);
            }
            let sources = resampling.sources(0..to);
            prop_assert!(sources.end <= from && resampling.0.iter().all(|m| m.first >= sources.start));
        }
    }
}
