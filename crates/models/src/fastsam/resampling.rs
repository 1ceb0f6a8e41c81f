//! Linear resampling of lines, as `interpolate(…, mode="bilinear", align_corners=False)` does along each axis.

use std::ops::Range;

/// Most source samples that a target sample is mixed from, after two resamplings in a row.
const MAX_TAPS: usize = 4;

/// A target sample as a mixture of neighbouring source samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Mixture {
    /// First source sample.
    pub first: usize,
    /// How many there are.
    pub count: usize,
    /// Their weights; 0 after the last.
    pub weights: [f32; MAX_TAPS],
}

/// How every target sample is mixed from source samples.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Resampling(Vec<Mixture>);

impl Resampling {
    /// `from` samples scaled to `to`; positions beyond the first and last sample's centre take that sample.
    pub fn linear(from: usize, to: usize) -> Self {
        Self::of_window(from, 0..from, to, 1)
    }

    /// `from` samples, first scaled up by the whole number `upscaling`; `window`, in samples of the upscaled line, is then
    /// scaled to `to` samples. Both steps are linear, so together they are one mixture of few source samples.
    pub fn of_window(from: usize, window: Range<usize>, to: usize, upscaling: usize) -> Self {
        let upscaled = from * upscaling;
        let mixture = |target: usize| {
            let mut weights = [0.0; 2 * 2];
            let mut places = [0; 2 * 2];
            let mut taps = 0;
            for (place, weight) in interpolated(target, window.len(), to) {
                for (source, share) in interpolated(window.start + place, from, upscaled) {
                    (places[taps], weights[taps]) = (source, weight * share);
                    taps += 1;
                }
            }
            Mixture::sum(&places, &weights)
        };
        Self((0..to).map(mixture).collect())
    }

    /// The source samples that target samples of a range are mixed from.
    pub fn sources(&self, targets: Range<usize>) -> Range<usize> {
        let Some(mixtures) = self.0.get(targets).filter(|mixtures| !mixtures.is_empty()) else { return 0..0 };
        // Sources move on with targets.
        mixtures[0].first..mixtures.iter().map(|mixture| mixture.first + mixture.count).max().unwrap_or(0)
    }

    /// The mixtures of a range of target samples.
    pub fn mixtures(&self, targets: Range<usize>) -> &[Mixture] {
        &self.0[targets]
    }
}

/// The two samples between which sample `target` of `to` lies among `from`, with their weights.
fn interpolated(target: usize, from: usize, to: usize) -> [(usize, f64); 2] {
    let position = ((target as f64 + 0.5) * from as f64 / to as f64 - 0.5).max(0.0);
    let first = (position as usize).min(from - 1);
    let fraction = position - first as f64;
    [(first, 1.0 - fraction), ((first + 1).min(from - 1), fraction)]
}

impl Mixture {
    /// The sum of weighted samples that lie close together.
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
        let mix = |mixture: &Mixture| {
            (0..mixture.count).map(|tap| mixture.weights[tap] * line[mixture.first + tap]).sum::<f32>()
        };
        resampling.0.iter().map(mix).collect()
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
        fn one_mixture_equals_two_steps(line in prop::collection::vec(-9f32..9.0, 1..20), upscaling in 1usize..5,
                                        to in 1usize..70, cut in (0usize..20, 0usize..20)) {
            let from = line.len();
            let upscaled = apply(&Resampling::linear(from, from * upscaling), &line);
            let start = cut.0.min(upscaled.len() - 1);
            let window = start..(start + 1 + cut.1).min(upscaled.len());
            let expected = apply(&Resampling::linear(window.len(), to), &upscaled[window.clone()]);
            let resampling = Resampling::of_window(from, window, to, upscaling);
            for (found, expected) in apply(&resampling, &line).iter().zip(&expected) {
                prop_assert!((found - expected).abs() < 1e-4, "{} {}", found, expected);
            }
            let sources = resampling.sources(0..to);
            prop_assert!(sources.end <= from && resampling.0.iter().all(|m| m.first >= sources.start));
        }
    }
}
