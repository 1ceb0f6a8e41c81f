//! The loss (docs/PAPER.md, "Features"), and its gradient with respect to the rendered features.
//!
//! The loss over pixels p with rendered feature F and target F̂ (codebook vector ĉ times confidence m) is
//! `L = Σ_p λ_mag (m − ‖F‖)² + λ_dir (1 − cos(F̂, F))`. It sums over pixels where the paper averages. The factor
//! 1 / (H·W) between them is constant and part of the step size. The gradient with respect to F is
//!
//! `−2 λ_mag (m − ‖F‖) F/‖F‖ − λ_dir (ĉ − (ĉ·F/‖F‖) F/‖F‖) / ‖F‖`
//!
//! The curvature is `2 λ_mag` along F and `λ_dir / ‖F‖²` across. Across a *Gaussian's* feature it is larger where the
//! Gaussians of a pixel disagree: turning one of them then changes ‖F‖. The share of F that cancels,
//! `κ = 1 − ‖F‖² / (Σ w · Σ w ‖f‖²)`, is 0 where they agree. `4 λ_mag κ` bounds the extra curvature of two groups of
//! Gaussians; half of that suffices for the steps of [`super::learning`], which divide by the curvature.

use crate::{Codebook, MemorySettings, SegmentBelief};
use splatseg_geometry::SegmentId;
use splatseg_kernels::inner_products::dot;
use splatseg_kernels::{AlignedVec, Instructions, Vectorize};
use splatseg_render::{ActiveTile, TileWeights};

/// Features shorter than this have no direction.
pub(super) const TINY: f32 = 1e-6;

/// Features are padded to a multiple of this length.
const LANES: usize = 8;

/// Returns the length of a feature in working memory, where rows fill whole vector registers and cache lines. Two more
/// numbers follow the feature: ‖f‖² and 1, whose weighted sums show where Gaussians disagree. In gradients, the first
/// is the curvature. The rest stays 0. An integer id has no direction and no padding.
pub(crate) fn padded(feature_dim: usize) -> usize {
    match feature_dim {
        1 => 1,
        _ => (feature_dim + 2).next_multiple_of(LANES),
    }
}

/// The loss of one frame.
pub(crate) struct Loss<'a> {
    settings: &'a MemorySettings,
    target: &'a SegmentBelief,
    feature_dim: usize,
    row: usize,
    /// The codebook, `[codes, row]`.
    codes: AlignedVec,
}

impl<'a> Loss<'a> {
    pub fn new(settings: &'a MemorySettings, codebook: &Codebook, target: &'a SegmentBelief) -> Self {
        let row = padded(codebook.feature_dim());
        let mut codes = AlignedVec::zeros(codebook.len() * row);
        for (index, code) in codes.chunks_exact_mut(row).enumerate() {
            code[..codebook.feature_dim()].copy_from_slice(codebook.vector(index));
        }
        Self { settings, target, feature_dim: codebook.feature_dim(), row, codes }
    }

    /// Padded length of a feature; see [`padded`].
    pub fn row(&self) -> usize {
        self.row
    }

    /// Replaces the rendered features of a tile's chosen pixels, `[16, 16, row]`, by the gradient of the loss with
    /// respect to them, followed by the curvature across minus `direction_weight`.
    pub fn differentiate(&self, tile: &ActiveTile, pixels: &mut [f32]) {
        let gradient = TileGradient { loss: self, tile, pixels };
        match self.row {
            8 => Instructions::best().run(Fixed::<8>(gradient)),
            16 => Instructions::best().run(Fixed::<16>(gradient)),
            32 => Instructions::best().run(Fixed::<32>(gradient)),
            _ => gradient.differentiate_chosen(|feature| feature),
        }
    }

    /// Replaces one rendered feature by the gradient and the curvature; see [`Self::differentiate`].
    #[inline(always)]
    fn pixel_gradient(&self, segment: SegmentId, magnitude: f32, feature: &mut [f32]) {
        if let [value] = feature {
            // Integer ids (an ablation) have no direction: the feature is pulled towards the id itself.
            let id = if segment == 0 { 0.0 } else { self.codes[segment as usize - 1] };
            *value = -2.0 * self.settings.magnitude_weight * (id - *value);
            return;
        }
        let (magnitude_weight, direction_weight) = (self.settings.magnitude_weight, self.settings.direction_weight);
        let [squares, weights] = [self.feature_dim, self.feature_dim + 1].map(|at| std::mem::take(&mut feature[at]));
        let norm = dot(feature, feature).sqrt();
        let agreed = norm * norm / (squares * weights).max(TINY * TINY);
        let mut curvature = 2.0 * magnitude_weight * (1.0 - agreed).clamp(0.0, 1.0);
        let radial = -2.0 * magnitude_weight * (magnitude - norm);
        if segment == 0 {
            let scale = if norm > TINY { radial / norm } else { 0.0 };
            feature.iter_mut().for_each(|value| *value *= scale);
        } else {
            let code = &self.codes[(segment as usize - 1) * self.row..][..feature.len()];
            if norm <= TINY {
                // A feature without a direction takes the target's.
                feature.iter_mut().zip(code).for_each(|(value, code)| *value = radial * code);
            } else {
                let cosine = dot(feature, code) / norm;
                let along_code = -direction_weight / norm;
                let along_feature = (radial - along_code * cosine) / norm;
                for (value, code) in feature.iter_mut().zip(code) {
                    *value = along_feature * *value + along_code * code;
                }
                curvature += direction_weight / (norm * norm);
            }
        }
        feature[self.feature_dim] = curvature - direction_weight;
    }
}

/// The loss's gradient over a tile.
struct TileGradient<'a> {
    loss: &'a Loss<'a>,
    tile: &'a ActiveTile,
    pixels: &'a mut [f32],
}

impl TileGradient<'_> {
    /// Differentiates the chosen pixels. `sized` can give features a length known at compile time.
    #[inline(always)]
    fn differentiate_chosen(self, sized: impl Fn(&mut [f32]) -> &mut [f32]) {
        let (left, top) = self.tile.weights.origin();
        for (pixel, feature) in self.pixels.chunks_exact_mut(self.loss.row).enumerate() {
            if self.tile.pixels.contains(pixel as u8) {
                let at = (left + pixel % TileWeights::SIDE, top + pixel / TileWeights::SIDE);
                let (segment, magnitude) = (self.loss.target.segments[at], self.loss.target.confidence[at]);
                self.loss.pixel_gradient(segment, magnitude, sized(feature));
            }
        }
    }
}

/// The gradient of features with a length `C` known at compile time.
struct Fixed<'a, const C: usize>(TileGradient<'a>);

impl<const C: usize> Vectorize for Fixed<'_, C> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        self.0.differentiate_chosen(|feature| match feature.first_chunk_mut::<C>() {
            Some(feature) => feature,
            None => &mut [],
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::CodebookSettings;
    use proptest::prelude::*;

    const FEATURE_DIM: usize = 6;

    fn codebook() -> Codebook {
        let settings = CodebookSettings { num_codes: 5, feature_dim: FEATURE_DIM, seed: 1 };
        Codebook::generate(&settings, &mut |_| {}).unwrap()
    }

    /// The loss of one pixel as defined in docs/PAPER.md, in f64.
    fn loss(settings: &MemorySettings, code: Option<&[f32]>, magnitude: f64, feature: &[f64]) -> f64 {
        let norm = feature.iter().map(|value| value * value).sum::<f64>().sqrt();
        let direction = code.map_or(0.0, |code| {
            1.0 - feature.iter().zip(code).map(|(value, code)| value * f64::from(*code)).sum::<f64>() / norm
        });
        f64::from(settings.magnitude_weight) * (magnitude - norm).powi(2)
            + f64::from(settings.direction_weight) * direction
    }

    /// The gradient of a pixel filled by one Gaussian, and the two numbers after it.
    fn gradient(
        settings: &MemorySettings,
        codebook: &Codebook,
        target: &SegmentBelief,
        (segment, magnitude): (SegmentId, f32),
        feature: [f32; FEATURE_DIM],
    ) -> [f32; 8] {
        let mut gradient = [0.0; 8];
        gradient[..FEATURE_DIM].copy_from_slice(&feature);
        gradient[FEATURE_DIM..].copy_from_slice(&[dot(&feature, &feature), 1.0]);
        Loss::new(settings, codebook, target).pixel_gradient(segment, magnitude, &mut gradient);
        gradient
    }

    #[test]
    fn the_curvature_across_is_that_of_the_direction_where_gaussians_agree_and_more_where_they_do_not() {
        let (settings, codebook) = (MemorySettings::default(), codebook());
        let target = SegmentBelief::empty(1, 1);
        let mut alone = codebook.vector(0).to_vec();
        alone.iter_mut().for_each(|value| *value *= 0.5);
        let alone: [f32; FEATURE_DIM] = alone.try_into().unwrap();
        let found = gradient(&settings, &codebook, &target, (1, 0.5), alone)[FEATURE_DIM];
        assert!((found - (4.0 - 1.0)).abs() < 1e-3, "1 / 0.5² minus direction_weight: {found}");
        // Two Gaussians of weight one half, at right angles: half of their squares is lost.
        let mut mixed = [0.5, 0.5, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0];
        Loss::new(&settings, &codebook, &target).pixel_gradient(0, 0.0, &mut mixed);
        assert!((mixed[FEATURE_DIM] - (2.0 * 50.0 * 0.5 - 1.0)).abs() < 1e-3, "{mixed:?}");
    }

    proptest! {
        #[test]
        fn the_gradient_equals_finite_differences(feature in prop::array::uniform6(-1.0f32..1.0), segment in 0u32..=5,
                                                  magnitude in 0.0f32..1.2) {
            prop_assume!(dot(&feature, &feature) > 0.01);
            let (settings, codebook) = (MemorySettings::default(), codebook());
            let target = SegmentBelief::empty(1, 1);
            let magnitude = if segment == 0 { 0.0 } else { magnitude };
            let gradient = gradient(&settings, &codebook, &target, (segment, magnitude), feature);
            prop_assert_eq!(gradient[FEATURE_DIM + 1], 0.0, "padding stays empty");
            let code = (segment > 0).then(|| codebook.vector(segment as usize - 1));
            let at = feature.map(f64::from);
            for channel in 0..FEATURE_DIM {
                let step = 1e-5;
                let moved = |by: f64| {
                    let mut moved = at;
                    moved[channel] += by;
                    loss(&settings, code, f64::from(magnitude), &moved)
                };
                let numeric = (moved(step) - moved(-step)) / (2.0 * step);
                prop_assert!((f64::from(gradient[channel]) - numeric).abs() < 1e-3 * (1.0 + numeric.abs()),
                             "{} instead of {numeric}", gradient[channel]);
            }
        }
    }
}
