//! Gradient descent on the features of the Gaussians in view (METHOD, "FastSAM-Splat", step 6).
//!
//! The loss over pixels p with rendered feature F and target F̂ (codebook vector ĉ times confidence m) is
//! `L = Σ_p λ_mag (m − ‖F‖)² + λ_dir (1 − cos(F̂, F))`: sums over pixels where the paper has means, which differ by
//! the constant 1 / (H·W) only, and that is part of the step size here. Its gradient with respect to F is
//!
//! `−2 λ_mag (m − ‖F‖) F/‖F‖ − λ_dir (ĉ − (ĉ·F/‖F‖) F/‖F‖) / ‖F‖`
//!
//! and `F = W f` carries it to the features: `∂L/∂f = Wᵀ ∂L/∂F`. Each Gaussian's step is divided by its column sum of
//! `W` (a Jacobi preconditioner): a fixed step diverges when the camera comes close and one Gaussian covers many
//! pixels.

use crate::{Codebook, Expectation, MemorySettings, SegmentBelief};
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;
use splatseg_geometry::{Image, SegmentId};
use splatseg_render::{ActiveTile, ActiveWeights, AlignedVec, PixelSet, TileWeights};

/// Magnitudes below this have no direction.
const TINY: f32 = 1e-6;

/// One optimisation of a frame's features.
pub(crate) struct Learning<'a> {
    pub settings: &'a MemorySettings,
    pub codebook: &'a Codebook,
    /// What the memory showed before it grew.
    pub expectation: &'a Expectation,
    /// What the features should come to show.
    pub target: &'a SegmentBelief,
}

/// How much work a frame's learning was.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LearningExtent {
    /// Pixels whose loss was lowered.
    pub active_pixels: usize,
    /// Gaussians whose features could change.
    pub active_gaussians: usize,
}

impl Learning<'_> {
    /// Takes the settings' number of steps on `features` `[gaussians, D]` over the weights `active`, made for
    /// [`Self::active_pixels`].
    pub fn descend(&self, active: &ActiveWeights, features: &mut [f32]) -> LearningExtent {
        let (feature_dim, row) = (self.codebook.feature_dim(), self.row());
        let mut local = AlignedVec::zeros(active.gaussians().len() * row);
        for (gaussian, copy) in active.gaussians().iter().zip(local.chunks_exact_mut(row)) {
            copy[..feature_dim].copy_from_slice(&features[*gaussian as usize * feature_dim..][..feature_dim]);
        }
        let mut partial = AlignedVec::zeros(active.column_count() * row);
        for _ in 0..self.settings.num_steps {
            self.feature_gradient(active, &local, &mut partial);
            self.step(active, &partial, &mut local);
        }
        for (gaussian, copy) in active.gaussians().iter().zip(local.chunks_exact(row)) {
            features[*gaussian as usize * feature_dim..][..feature_dim].copy_from_slice(&copy[..feature_dim]);
        }
        LearningExtent {
            active_pixels: active.tiles().iter().map(|tile| tile.pixels.len()).sum(),
            active_gaussians: active.gaussians().len(),
        }
    }

    /// Numbers per feature in working memory: rows that fill vector registers and cache lines; the rest stays 0.
    fn row(&self) -> usize {
        match self.codebook.feature_dim() {
            1 => 1,
            feature_dim => feature_dim.next_multiple_of(8),
        }
    }

    /// Writes `Wᵀ ∂L/∂F` of every active tile to its part of `partial`.
    fn feature_gradient(&self, active: &ActiveWeights, features: &[f32], partial: &mut [f32]) {
        let row = self.row();
        let mut parts = Vec::with_capacity(active.tiles().len());
        let mut rest = partial;
        for tile in active.tiles() {
            let (part, more) = rest.split_at_mut(tile.weights.gaussians().len() * row);
            parts.push((tile, part));
            rest = more;
        }
        parts.into_par_iter().for_each_init(
            || AlignedVec::zeros(TileWeights::PIXELS * row),
            |pixels, (tile, part)| {
                tile.render(features, row, pixels);
                Arch::new().dispatch(LossGradient { learning: self, tile, pixels });
                tile.weights.project_back(pixels, row, part);
            },
        );
    }

    /// Replaces a pixel's rendered feature by the loss's gradient with respect to it.
    #[inline(always)]
    fn pixel_gradient(&self, segment: SegmentId, magnitude: f32, feature: &mut [f32]) {
        let norm = dot(feature, feature).sqrt();
        let radial = -2.0 * self.settings.magnitude_weight * (magnitude - norm);
        if segment == 0 {
            let scale = if norm > TINY { radial / norm } else { 0.0 };
            feature.iter_mut().for_each(|value| *value *= scale);
            return;
        }
        let code = self.codebook.vector(segment as usize - 1);
        if let ([value], [id]) = (&mut *feature, code) {
            // The integer-id ablation has no directions: the feature is pulled to the id itself.
            *value = -2.0 * self.settings.magnitude_weight * (id - *value);
            return;
        }
        if norm <= TINY {
            // Without a direction of its own the feature takes the target's.
            feature.iter_mut().zip(code).for_each(|(value, code)| *value = radial * code);
            return;
        }
        let cosine = dot(feature, code) / norm;
        let along_code = -self.settings.direction_weight / norm;
        let along_feature = (radial - along_code * cosine) / norm;
        for (value, code) in feature.iter_mut().zip(code) {
            *value = along_feature * *value + along_code * code;
        }
    }

    /// Adds the parts of every Gaussian's gradient and moves its feature against it.
    fn step(&self, active: &ActiveWeights, partial: &[f32], features: &mut [f32]) {
        let row = self.row();
        features.par_chunks_mut(row * 512).enumerate().for_each(|(chunk, features)| {
            for (offset, feature) in features.chunks_exact_mut(row).enumerate() {
                let gaussian = chunk * 512 + offset;
                let rate = self.settings.learning_rate / active.weight_sums()[gaussian];
                for column in active.columns_of(gaussian) {
                    let part = &partial[*column as usize * row..][..row];
                    for (value, part) in feature.iter_mut().zip(part) {
                        *value -= rate * part;
                    }
                }
            }
        });
    }

    /// Segment and confidence that a pixel of a tile should show.
    fn target_at(&self, tile: &TileWeights, pixel: usize) -> (SegmentId, f32) {
        let (left, top) = tile.origin();
        let at = (left + pixel % TileWeights::SIDE, top + pixel / TileWeights::SIDE);
        (self.target.segments[at], self.target.confidence[at])
    }

    /// Per tile, the pixels to be learnt: those that differ from the target and their surroundings, where the memory
    /// covers them, but not those where this frame's new Gaussians prevail (`touched`): the new ones show the target
    /// already, and what they leave to be learnt is the next frame's.
    pub fn active_pixels(&self, touched: &[PixelSet]) -> Vec<PixelSet> {
        let (width, height) = self.target.segments.size();
        let columns = width.div_ceil(TileWeights::SIDE);
        let tiles = self.expectation.features.len();
        let mut chosen = vec![PixelSet::default(); tiles];
        if self.settings.num_steps == 0 {
            return chosen;
        }
        let differs: Vec<PixelSet> = (0..tiles).into_par_iter().map(|tile| self.differing_pixels(tile)).collect();
        let place = |column: usize, row: usize| {
            let tile = row / TileWeights::SIDE * columns + column / TileWeights::SIDE;
            (tile, (row % TileWeights::SIDE * TileWeights::SIDE + column % TileWeights::SIDE) as u8)
        };
        let seed = Image::from_fn(width, height, |column, row| {
            let (tile, pixel) = place(column, row);
            differs[tile].contains(pixel)
        });
        let near = dilated(&seed, self.settings.active_margin);
        for row in 0..height {
            for column in 0..width {
                if near[(column, row)] && self.covered((column, row)) {
                    let (tile, pixel) = place(column, row);
                    chosen[tile].insert(pixel);
                }
            }
        }
        for (chosen, touched) in chosen.iter_mut().zip(touched) {
            *chosen = chosen.without(touched);
        }
        chosen
    }

    /// Where too little of the memory covers a pixel, pulling it to the target would only inflate its neighbours'
    /// features.
    fn covered(&self, at: (usize, usize)) -> bool {
        self.expectation.silhouette[at] >= self.settings.growth_silhouette
    }

    fn differing_pixels(&self, tile: usize) -> PixelSet {
        let (width, height) = self.target.segments.size();
        let columns = width.div_ceil(TileWeights::SIDE);
        let (left, top) = (tile % columns * TileWeights::SIDE, tile / columns * TileWeights::SIDE);
        let mut differs = PixelSet::default();
        let features = self.expectation.features[tile].chunks_exact(self.codebook.feature_dim());
        for (pixel, feature) in features.enumerate() {
            let at = (left + pixel % TileWeights::SIDE, top + pixel / TileWeights::SIDE);
            if at.0 >= width || at.1 >= height || !self.covered(at) {
                continue;
            }
            let distance = self.distance_to_target(self.target.segments[at], self.target.confidence[at], feature);
            if distance > self.settings.active_tolerance {
                differs.insert(pixel as u8);
            }
        }
        differs
    }

    /// ‖F − F̂‖.
    fn distance_to_target(&self, segment: SegmentId, magnitude: f32, feature: &[f32]) -> f32 {
        let squared = dot(feature, feature);
        if segment == 0 {
            return (squared.sqrt() - magnitude).abs();
        }
        let code = self.codebook.vector(segment as usize - 1);
        let magnitude = if code.len() == 1 { 1.0 } else { magnitude };
        let square = squared - 2.0 * magnitude * dot(feature, code) + magnitude * magnitude * dot(code, code);
        square.max(0.0).sqrt()
    }
}

/// The loss's gradient over a tile, waiting for the processor's widest vector instructions. (A type rather than a
/// closure: a closure is called through a shim that is compiled for the oldest processor.)
struct LossGradient<'a> {
    learning: &'a Learning<'a>,
    tile: &'a ActiveTile,
    pixels: &'a mut [f32],
}

impl WithSimd for LossGradient<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let feature_dim = self.learning.codebook.feature_dim();
        for (pixel, row) in self.pixels.chunks_exact_mut(self.learning.row()).enumerate() {
            if self.tile.pixels.contains(pixel as u8) {
                let (segment, magnitude) = self.learning.target_at(&self.tile.weights, pixel);
                self.learning.pixel_gradient(segment, magnitude, &mut row[..feature_dim]);
            }
        }
    }
}

/// The pixels within `margin` (in rows and columns) of one of the `seed`.
fn dilated(seed: &Image<bool>, margin: usize) -> Image<bool> {
    let (width, height) = seed.size();
    let mut in_row = Image::filled(width, height, false);
    for row in 0..height {
        for column in (0..width).filter(|column| seed[(*column, row)]) {
            let from = row * width + column.saturating_sub(margin);
            let to = row * width + (column + margin).min(width - 1);
            in_row.pixels_mut()[from..=to].fill(true);
        }
    }
    let mut near = Image::filled(width, height, false);
    for row in 0..height {
        for other in row.saturating_sub(margin)..=(row + margin).min(height - 1) {
            for column in 0..width {
                near[(column, row)] |= in_row[(column, other)];
            }
        }
    }
    near
}

/// Inner product, summed in four lanes so that it vectorises and still gives the same bits everywhere.
#[inline(always)]
fn dot(left: &[f32], right: &[f32]) -> f32 {
    let mut lanes = [0f32; 4];
    let (left_chunks, left_rest) = left.as_chunks::<4>();
    let (right_chunks, right_rest) = right.as_chunks::<4>();
    for (left, right) in left_chunks.iter().zip(right_chunks) {
        for lane in 0..4 {
            lanes[lane] += left[lane] * right[lane];
        }
    }
    let rest: f32 = left_rest.iter().zip(right_rest).map(|(left, right)| left * right).sum();
    (lanes[0] + lanes[1]) + (lanes[2] + lanes[3]) + rest
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

    /// The loss of one pixel as METHOD states it, in f64.
    fn loss(settings: &MemorySettings, code: Option<&[f32]>, magnitude: f64, feature: &[f64]) -> f64 {
        let norm = feature.iter().map(|value| value * value).sum::<f64>().sqrt();
        let direction = code.map_or(0.0, |code| {
            1.0 - feature.iter().zip(code).map(|(value, code)| value * f64::from(*code)).sum::<f64>() / norm
        });
        f64::from(settings.magnitude_weight) * (magnitude - norm).powi(2)
            + f64::from(settings.direction_weight) * direction
    }

    proptest! {
        #[test]
        fn the_gradient_equals_finite_differences(feature in prop::array::uniform6(-1.0f32..1.0), segment in 0u32..=5,
                                                  magnitude in 0.0f32..1.2) {
            prop_assume!(dot(&feature, &feature) > 0.01);
            let (settings, codebook) = (MemorySettings::default(), codebook());
            let expectation = Expectation {
                belief: SegmentBelief::empty(1, 1),
                silhouette: Image::filled(1, 1, 1.0),
                depth: Image::filled(1, 1, 1.0),
                features: Vec::new(),
            };
            let target = SegmentBelief::empty(1, 1);
            let learning = Learning { settings: &settings, codebook: &codebook, expectation: &expectation, target: &target };
            let magnitude = if segment == 0 { 0.0 } else { magnitude };
            let mut gradient = feature;
            learning.pixel_gradient(segment, magnitude, &mut gradient);
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
