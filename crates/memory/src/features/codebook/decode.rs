//! Decoding of features to codes.

use super::Codebook;
use splatseg_kernels::inner_products::{LaneMaximum, Panels, product};
use splatseg_kernels::instructions::LANES;
use splatseg_kernels::{Instructions, Vectorize};

/// Squared lengths of features for which the shortcut's tests neither overflow nor underflow.
const SAFE_SQUARES: std::ops::Range<f32> = 1e-20..1e30;

/// Bounds the relative error of sums over `dim` terms and of the length of a code.
pub fn rounding(dim: usize) -> f32 {
    (dim + 8) as f32 * f32::EPSILON
}

impl Codebook {
    /// Decodes a rendered feature `[D]` to the **index** of its code: the segment id minus one.
    ///
    /// This is the code with the largest inner product (the lowest index of equals) among the first `used`, if the
    /// product exceeds `threshold` (0.5 in the paper). With D = 1, the rounded value is the segment id, and `threshold`
    /// is ignored. Returns `None` for "no segment", and for a feature that is not finite or does not have D values.
    pub fn decode(&self, feature: &[f32], used: usize, threshold: f32) -> Option<u32> {
        self.decode_with_hint(feature, None, used, threshold)
    }

    /// Returns the same as [`Codebook::decode`], but faster if `hint` is the index of the right code or the feature is
    /// shorter than `threshold`.
    ///
    /// Let F = v c* + r with c* the hinted code, r ⟂ c*, and θ the angle of F to c*. A code c_j at the angle α_j to c*
    /// has ⟨F, c_j⟩ ≤ v cos α_j + ‖r‖ sin α_j = ‖F‖ cos(θ − α_j), which is below v = ‖F‖ cos θ whenever α_j > 2θ. So c*
    /// wins if F lies within half the angle α to its nearest neighbour: cos²θ > (1 + cos α) / 2. Then v exceeds every
    /// other product by at least ‖F‖ (cos²θ − (1 + cos α) / 2), so a margin on cos²θ also bounds the products'
    /// rounding.
    pub fn decode_with_hint(&self, feature: &[f32], hint: Option<u32>, used: usize, threshold: f32) -> Option<u32> {
        let used = used.min(self.len());
        if feature.len() != self.feature_dim() {
            return None;
        }
        if let [value] = *feature {
            let id = value.round();
            return (id >= 1.0 && id <= used as f32).then(|| id as u32 - 1);
        }
        let hint = hint.filter(|&hint| (hint as usize) < used);
        match self.shortcut(feature, hint, threshold) {
            Some(decoded) => decoded,
            None => self.search(feature, used, threshold),
        }
    }

    /// Returns the result of [`Codebook::search`] if the hinted code alone determines it.
    fn shortcut(&self, feature: &[f32], hint: Option<u32>, threshold: f32) -> Option<Option<u32>> {
        let square = feature.iter().fold(0.0, |sum, value| sum + value * value);
        if !SAFE_SQUARES.contains(&square) {
            return None;
        }
        // Norms of codes, their inner products, this square and the product below each have an error of at most
        // `rounding`.
        let margin = 16.0 * rounding(self.feature_dim());
        if threshold > 0.0 && square * (1.0 + margin) < threshold * threshold {
            return Some(None);
        }
        let index = hint?;
        let coherence = *self.spacing.get()?.coherences.get(index as usize)?;
        // Summed in the order of the search, so that the comparison with the threshold has the same result.
        let pairs = feature.iter().zip(self.vector(index as usize));
        let product = pairs.fold(0.0, |sum, (left, right)| sum + left * right);
        let wins = product > 0.0 && product * product > square * ((1.0 + coherence) / 2.0 + margin);
        wins.then(|| (product > threshold).then_some(index))
    }

    /// Compares the feature with all of the first `used` codes.
    fn search(&self, feature: &[f32], used: usize, threshold: f32) -> Option<u32> {
        let (product, index) = Instructions::best().run(Search { feature, columns: &self.columns, used });
        (product > threshold && product < f32::INFINITY).then_some(index)
    }
}

/// Finds the largest product of `feature` with the first `used` of `columns`, and its index.
struct Search<'a> {
    feature: &'a [f32],
    columns: &'a Panels,
    used: usize,
}

impl Vectorize for Search<'_> {
    type Output = (f32, u32);

    #[inline(always)]
    fn run(self) -> (f32, u32) {
        let mut maximum = LaneMaximum::EMPTY;
        let rows = self.feature.as_chunks::<1>().0;
        for (index, panel) in self.columns.iter().take(self.used.div_ceil(LANES)).enumerate() {
            let [mut products] = product(rows, panel);
            let valid = self.used - index * LANES;
            if valid < LANES {
                products[valid..].fill(f32::NEG_INFINITY);
            }
            maximum.update(&products, index as u32);
        }
        maximum.largest()
    }
}
