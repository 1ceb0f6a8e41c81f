//! Gradient descent on the features of the Gaussians in view (docs/PAPER.md, "Features").
//!
//! `F = W f` carries the gradient of the [loss](super::loss) to the features: `∂L/∂f = Wᵀ ∂L/∂F`. Each Gaussian's step
//! is divided by the curvature of the loss, separately along and across its feature: `W` times the curvature of the
//! pixels, summed over its column. Without the sum, steps diverge when the camera comes close and one Gaussian covers
//! many pixels. Without the separation, an id does not turn: magnitudes weigh 50 times as much as directions, and a
//! step that is safe for magnitudes turns a feature by half a degree. Where segments meet, directions and magnitudes
//! depend on each other, and Nesterov momentum helps. None of this changes the minimum of the loss.

use super::loss::{Loss, padded};
use crate::recall::Recall;
use crate::segment_store::LearningStats;
use crate::{Codebook, MemorySettings, SegmentBelief};
use rayon::prelude::*;
use splatseg_geometry::Image;
use splatseg_kernels::AlignedVec;
use splatseg_kernels::inner_products::dot;
use splatseg_render::{ActiveWeights, PixelSet, TileWeights};

/// Minimum curvature across a feature, as a fraction of the curvature along it.
const MIN_CURVATURE_ACROSS: f32 = 1e-3;

/// One optimisation of a frame's features.
pub(crate) struct Learning<'a> {
    pub settings: &'a MemorySettings,
    pub codebook: &'a Codebook,
    /// The view rendered before the map grew.
    pub recall: &'a Recall<'a>,
    /// Target for the rendered features.
    pub target: &'a SegmentBelief,
}

impl Learning<'_> {
    /// Performs `num_steps` descent steps on `features` `[gaussians, D]`. `active` contains the weights of
    /// [`Self::active_pixels`].
    pub fn descend(&self, active: &ActiveWeights, features: &mut [f32]) -> LearningStats {
        let feature_dim = self.codebook.feature_dim();
        let row = padded(feature_dim);
        let loss = Loss::new(self.settings, self.codebook, self.target);
        let mut local = AlignedVec::zeros(active.gaussians().len() * row);
        for (gaussian, copy) in active.gaussians().iter().zip(local.chunks_exact_mut(row)) {
            copy[..feature_dim].copy_from_slice(&features[*gaussian as usize * feature_dim..][..feature_dim]);
            complete(copy, feature_dim);
        }
        let mut partial = AlignedVec::zeros(active.column_count() * row);
        let mut moved = local.clone();
        for step in 0..self.settings.num_steps {
            feature_gradient(&loss, active, &local, &mut partial);
            self.step(active, &partial, step as f32 / (step as f32 + 3.0), &mut local, &mut moved);
        }
        for (gaussian, copy) in active.gaussians().iter().zip(moved.chunks_exact(row)) {
            features[*gaussian as usize * feature_dim..][..feature_dim].copy_from_slice(&copy[..feature_dim]);
        }
        LearningStats {
            active_pixels: active.tiles().iter().map(|tile| tile.pixels.len()).sum(),
            active_gaussians: active.gaussians().len(),
        }
    }

    /// Sums the parts of every Gaussian's gradient and moves its feature against it. `moved` contains the result.
    /// `features`, where the next gradient is taken, go further by `momentum` times the change since the last step
    /// (Nesterov).
    fn step(&self, active: &ActiveWeights, partial: &[f32], momentum: f32, features: &mut [f32], moved: &mut [f32]) {
        let feature_dim = self.codebook.feature_dim();
        let row = padded(feature_dim);
        let zeros = || AlignedVec::zeros(row);
        let chunks = features.par_chunks_mut(row * 512).zip(moved.par_chunks_mut(row * 512)).enumerate();
        chunks.for_each_init(zeros, |gradient, (chunk, (features, moved))| {
            let pairs = features.chunks_exact_mut(row).zip(moved.chunks_exact_mut(row));
            for (offset, (feature, moved)) in pairs.enumerate() {
                let gaussian = chunk * 512 + offset;
                gradient.fill(0.0);
                for column in active.columns_of(gaussian) {
                    let part = &partial[*column as usize * row..][..row];
                    gradient.iter_mut().zip(part).for_each(|(sum, part)| *sum += part);
                }
                self.step_one(active.weight_sums()[gaussian], gradient, feature);
                for (value, last) in feature[..feature_dim].iter_mut().zip(moved) {
                    let new = *value;
                    *value += momentum * (new - *last);
                    *last = new;
                }
                complete(feature, feature_dim);
            }
        });
    }

    /// Moves one feature against its gradient. `gradient` contains the gradient, then the curvature across the feature
    /// minus `direction_weight` for each pixel. `weight_sum` adds `direction_weight` for all pixels: pixels that are
    /// not learnt resist as if they had full confidence.
    fn step_one(&self, weight_sum: f32, gradient: &[f32], feature: &mut [f32]) {
        let feature_dim = self.codebook.feature_dim();
        let step_over = |curvature: f32, rate: f32| if curvature > 0.0 { rate / curvature } else { 0.0 };
        let curvature_along = 2.0 * self.settings.magnitude_weight * weight_sum;
        let along = step_over(curvature_along, self.settings.learning_rate);
        let (gradient, curvature) = gradient.split_at(feature_dim);
        let square = dot(&feature[..feature_dim], &feature[..feature_dim]);
        let (across, projection) = match curvature.first() {
            Some(curvature) if square > 1e-12 => {
                // If no pixel has a direction to learn, the gradient across and its curvature are rounding errors.
                let curvature = curvature + self.settings.direction_weight * weight_sum;
                let curvature = curvature.max(MIN_CURVATURE_ACROSS * curvature_along);
                let across = step_over(curvature, self.settings.direction_learning_rate);
                (across, dot(gradient, &feature[..feature_dim]) / square)
            }
            _ => (along, 0.0),
        };
        for (value, slope) in feature.iter_mut().zip(gradient) {
            let radial = projection * *value;
            *value -= along * radial + across * (slope - radial);
        }
    }

    /// Returns the pixels to be learnt per tile: pixels that differ from the target and their surroundings, where the
    /// memory covers them, except where this frame's new Gaussians prevail (`touched`). The new Gaussians already
    /// render the target; the rest is left to the next frame.
    pub fn active_pixels(&self, touched: &[PixelSet]) -> Vec<PixelSet> {
        let (width, height) = self.target.segments.size();
        let columns = width.div_ceil(TileWeights::SIDE);
        let tiles = self.recall.tiles.len();
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

    /// True if the memory covers a pixel, including by new Gaussians with `learn_new`. Where it covers too little,
    /// pulling the pixel towards the target would only inflate the features around it.
    fn covered(&self, at: (usize, usize)) -> bool {
        self.settings.learn_new || self.recall.silhouette[at] >= self.settings.growth_silhouette
    }

    fn differing_pixels(&self, tile: usize) -> PixelSet {
        let (width, height) = self.target.segments.size();
        let columns = width.div_ceil(TileWeights::SIDE);
        let (left, top) = (tile % columns * TileWeights::SIDE, tile / columns * TileWeights::SIDE);
        let mut differs = PixelSet::default();
        let features = self.recall.tiles[tile].values.chunks_exact(self.codebook.feature_dim());
        for (pixel, feature) in features.enumerate() {
            let at = (left + pixel % TileWeights::SIDE, top + pixel / TileWeights::SIDE);
            if at.0 >= width || at.1 >= height || !self.covered(at) {
                continue;
            }
            if self.differs(at, feature) {
                differs.insert(pixel as u8);
            }
        }
        differs
    }

    /// True if the rendered feature of a pixel decodes to another segment than the target, or differs in confidence or
    /// direction by more than the settings allow.
    fn differs(&self, at: (usize, usize), feature: &[f32]) -> bool {
        let (segment, magnitude) = (self.target.segments[at], self.target.confidence[at]);
        let norm = dot(feature, feature).sqrt();
        if segment == 0 {
            return (norm - magnitude).abs() > self.settings.active_tolerance;
        }
        if self.recall.belief.segments[at] != segment {
            return true;
        }
        let code = self.codebook.vector(segment as usize - 1);
        match (feature, code) {
            ([value], [id]) => (value - id).abs() > self.settings.active_tolerance,
            _ => {
                (norm - magnitude).abs() > self.settings.active_tolerance
                    || dot(feature, code) < self.settings.active_min_cosine * norm
            }
        }
    }
}

/// Writes the two numbers after a feature; see [`padded`].
fn complete(feature: &mut [f32], feature_dim: usize) {
    if feature_dim > 1 {
        feature[feature_dim] = dot(&feature[..feature_dim], &feature[..feature_dim]);
        feature[feature_dim + 1] = 1.0;
    }
}

/// Writes `Wᵀ ∂L/∂F` of every active tile to its part of `partial`.
fn feature_gradient(loss: &Loss<'_>, active: &ActiveWeights, features: &[f32], partial: &mut [f32]) {
    let row = loss.row();
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
            loss.differentiate(tile, pixels);
            tile.weights.project_back(pixels, row, part);
        },
    );
}

/// Returns the pixels within `margin` rows and columns of a pixel in `seed`.
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

#[cfg(test)]
mod tests;
