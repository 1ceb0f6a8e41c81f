//! The sparse matrix of blend weights, and products with it.

use crate::TileWeights;
use crate::tile_weights::assert_length;
use crate::tiles::TILE;
use rayon::prelude::*;
use splatseg_geometry::Image;

/// The pixel × Gaussian matrix `W` of one view: `W[p, i]` = alpha of Gaussian `i` at pixel `p` times the
/// transmittance in front of it.
///
/// Rendering any per-Gaussian values `v` (`[gaussians, channels]`) is `W v` ([`BlendWeights::render`]), and the
/// gradient of a loss with respect to them is `Wᵀ g` ([`BlendWeights::gradient`]). `W` is stored as compressed sparse
/// columns in tiles of 16 × 16 pixels, so that a product touches only data that fits the L1 cache.
#[derive(Clone, Debug, PartialEq)]
pub struct BlendWeights {
    pub(crate) width: usize,
    pub(crate) height: usize,
    /// Row-major.
    pub(crate) tiles: Vec<TileWeights>,
    pub(crate) tile_columns: usize,
}

impl BlendWeights {
    /// Width of the image, pixels.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Height of the image, pixels.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Number of non-zero weights.
    pub fn non_zeros(&self) -> usize {
        self.tiles.iter().map(TileWeights::non_zeros).sum()
    }

    /// The tiles, row-major.
    pub fn tiles(&self) -> &[TileWeights] {
        &self.tiles
    }

    /// Number of tiles per row of tiles.
    pub fn tile_columns(&self) -> usize {
        self.tile_columns
    }

    /// `W v`: renders per-Gaussian values `[gaussians, channels]` to an image `[height, width, channels]`, row-major.
    ///
    /// # Panics
    /// If `values` is too short for a Gaussian with a weight.
    pub fn render(&self, values: &[f32], channels: usize) -> Vec<f32> {
        let mut image = vec![0.0; self.width * self.height * channels];
        let band = (TILE * self.width * channels).max(1);
        image.par_chunks_mut(band).zip(self.tiles.par_chunks(self.tile_columns)).for_each(|(rows, tiles)| {
            let mut pixels = vec![0.0; TILE * TILE * channels];
            for tile in tiles {
                pixels.fill(0.0);
                tile.accumulate(values, channels, &mut pixels);
                for row in 0..tile.height {
                    let from = row * TILE * channels;
                    let to = (row * self.width + tile.left) * channels;
                    let length = tile.width * channels;
                    rows[to..to + length].copy_from_slice(&pixels[from..from + length]);
                }
            }
        });
        image
    }

    /// `Wᵀ g`: converts a loss's gradient with respect to an image, `[height, width, channels]`, to its gradient with
    /// respect to the rendered values, `[gaussian_count, channels]`.
    ///
    /// # Panics
    /// If `image_gradient` has another size, or a Gaussian with a weight is not below `gaussian_count`.
    pub fn gradient(&self, image_gradient: &[f32], channels: usize, gaussian_count: usize) -> Vec<f32> {
        assert_length("the image gradient", image_gradient.len(), self.width * self.height * channels);
        let partial: Vec<Vec<f32>> = self
            .tiles
            .par_iter()
            .map(|tile| {
                let mut pixels = vec![0.0; TILE * TILE * channels];
                for row in 0..tile.height {
                    let to = row * TILE * channels;
                    let from = ((tile.top + row) * self.width + tile.left) * channels;
                    let length = tile.width * channels;
                    pixels[to..to + length].copy_from_slice(&image_gradient[from..from + length]);
                }
                let mut partial = vec![0.0; tile.gaussians.len() * channels];
                tile.project_back(&pixels, channels, &mut partial);
                partial
            })
            .collect();
        // Tiles are added in their order, so the sum does not depend on the threads.
        let mut gradient = vec![0.0; gaussian_count * channels];
        for (tile, partial) in self.tiles.iter().zip(&partial) {
            for (gaussian, addition) in tile.gaussians.iter().zip(partial.chunks_exact(channels)) {
                let from = *gaussian as usize * channels;
                for (sum, more) in gradient[from..from + channels].iter_mut().zip(addition) {
                    *sum += more;
                }
            }
        }
        gradient
    }

    /// Accumulated alpha ("silhouette"), `[height, width]`: 1 minus the remaining transmittance.
    pub fn silhouette(&self) -> Image<f32> {
        self.image_of(|_, _| 1.0)
    }

    /// Accumulated z-depth of the Gaussians' centres in metres, `[height, width]`; not divided by the silhouette.
    pub fn accumulated_depth(&self) -> Image<f32> {
        self.image_of(|tile, column| tile.depths[column])
    }

    /// The sum over Gaussians of weight times `value(tile, column)`.
    fn image_of(&self, value: impl Fn(&TileWeights, usize) -> f32 + Sync) -> Image<f32> {
        let mut image = Image::filled(self.width, self.height, 0.0f32);
        let width = self.width;
        let band = (TILE * width).max(1);
        image.pixels_mut().par_chunks_mut(band).zip(self.tiles.par_chunks(self.tile_columns)).for_each(
            |(rows, tiles)| {
                for tile in tiles {
                    let mut sums = [0f32; TILE * TILE];
                    for column in 0..tile.gaussians.len() {
                        let value = value(tile, column);
                        for (pixel, weight) in tile.column(column) {
                            sums[pixel as usize] += weight * value;
                        }
                    }
                    for row in 0..tile.height {
                        let to = row * width + tile.left;
                        rows[to..to + tile.width].copy_from_slice(&sums[row * TILE..row * TILE + tile.width]);
                    }
                }
            },
        );
        image
    }
}
