//! The sparse matrix of blend weights, and products with it.

use crate::tiles::TILE;
use rayon::prelude::*;
use splatseg_geometry::Image;
use splatseg_kernels::{Instructions, Vectorize};

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

/// The weights of one tile: the unit of parallel work.
#[derive(Clone, Debug, PartialEq)]
pub struct TileWeights {
    pub(crate) left: usize,
    pub(crate) top: usize,
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) gaussians: Vec<u32>,
    pub(crate) depths: Vec<f32>,
    /// Sum of each Gaussian's weights in the tile.
    pub(crate) weight_sums: Vec<f32>,
    pub(crate) offsets: Vec<u32>,
    pub(crate) pixels: Vec<u8>,
    pub(crate) weights: Vec<f32>,
}

/// Panics if a slice does not have the expected length.
#[track_caller]
fn assert_length(what: &str, found: usize, expected: usize) {
    assert!(found == expected, "{what} hold {found} values, expected {expected}");
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
        self.tiles.iter().map(|tile| tile.weights.len()).sum()
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

impl TileWeights {
    /// A tile without weights.
    pub(crate) fn empty(left: usize, top: usize, width: usize, height: usize) -> Self {
        Self {
            left,
            top,
            width,
            height,
            gaussians: Vec::new(),
            depths: Vec::new(),
            weight_sums: Vec::new(),
            offsets: vec![0],
            pixels: Vec::new(),
            weights: Vec::new(),
        }
    }

    /// Resets to another tile without weights, keeping the allocations.
    pub(crate) fn restart(&mut self, left: usize, top: usize, width: usize, height: usize) {
        self.left = left;
        self.top = top;
        self.width = width;
        self.height = height;
        self.gaussians.clear();
        self.depths.clear();
        self.weight_sums.clear();
        self.offsets.truncate(1);
        self.pixels.clear();
        self.weights.clear();
    }

    /// Adds a Gaussian behind the others.
    #[inline(always)]
    pub(crate) fn push_weights(&mut self, gaussian: u32, depth: f32, pixels: &[u8], weights: &[f32]) {
        self.gaussians.push(gaussian);
        self.depths.push(depth);
        self.weight_sums.push(weights.iter().sum());
        self.pixels.extend_from_slice(pixels);
        self.weights.extend_from_slice(weights);
        self.offsets.push(self.weights.len() as u32);
    }

    /// Number of pixels in a tile's buffers: tiles are 16 × 16; at the right and lower edge they are partly unused.
    pub const PIXELS: usize = TILE * TILE;

    /// Side of a tile, pixels.
    pub const SIDE: usize = TILE;

    /// Image position (column, row) of the tile's first pixel.
    pub fn origin(&self) -> (usize, usize) {
        (self.left, self.top)
    }

    /// Width and height of the part inside the image, pixels.
    pub fn size(&self) -> (usize, usize) {
        (self.width, self.height)
    }

    /// Indices of the Gaussians with a weight in this tile, front to back.
    pub fn gaussians(&self) -> &[u32] {
        &self.gaussians
    }

    /// Camera z of the tile's Gaussians, metres.
    pub fn depths(&self) -> &[f32] {
        &self.depths
    }

    /// The pixels (`16 * row + column` in the tile) and weights of the tile's `column`-th Gaussian.
    #[inline(always)]
    pub fn column(&self, column: usize) -> impl Iterator<Item = (u8, f32)> + '_ {
        let range = self.offsets[column] as usize..self.offsets[column + 1] as usize;
        self.pixels[range.clone()].iter().copied().zip(self.weights[range].iter().copied())
    }

    /// Adds `W v` to `pixels` (`[16, 16, channels]`) for the tile, with `values` `[gaussians of the scene, channels]`.
    ///
    /// # Panics
    /// If `values` is too short for a Gaussian of the tile, or `pixels` is not `[16, 16, channels]`.
    pub fn accumulate(&self, values: &[f32], channels: usize, pixels: &mut [f32]) {
        assert_length("the tile's pixels", pixels.len(), Self::PIXELS * channels);
        let product = Accumulate { tile: self, values, pixels };
        // With a channel count known at compile time, a pixel stays in registers.
        match channels {
            1 => Instructions::best().run(Fixed::<_, 1>(product)),
            3 => Instructions::best().run(Fixed::<_, 3>(product)),
            4 => Instructions::best().run(Fixed::<_, 4>(product)),
            7 => Instructions::best().run(Fixed::<_, 7>(product)),
            14 => Instructions::best().run(Fixed::<_, 14>(product)),
            28 => Instructions::best().run(Fixed::<_, 28>(product)),
            _ => Instructions::best().run(Any(product, channels)),
        }
    }

    #[inline(always)]
    fn accumulate_fixed<const C: usize>(&self, values: &[f32], pixels: &mut [f32]) {
        let (values, _) = values.as_chunks::<C>();
        // With exactly 256 pixels, a one-byte index needs no bounds check.
        let Some(pixels) = pixels.as_chunks_mut::<C>().0.first_chunk_mut::<{ TILE * TILE }>() else { return };
        for (column, gaussian) in self.gaussians.iter().enumerate() {
            // A copy, because the compiler cannot rule out that values and pixels alias.
            let value = values[*gaussian as usize];
            for (pixel, weight) in self.column(column) {
                let mut sums = pixels[pixel as usize];
                for channel in 0..C {
                    sums[channel] += weight * value[channel];
                }
                pixels[pixel as usize] = sums;
            }
        }
    }

    #[inline(always)]
    fn accumulate_any(&self, values: &[f32], channels: usize, pixels: &mut [f32]) {
        for (column, gaussian) in self.gaussians.iter().enumerate() {
            let value = &values[*gaussian as usize * channels..][..channels];
            for (pixel, weight) in self.column(column) {
                let sums = &mut pixels[usize::from(pixel) * channels..][..channels];
                for (sum, value) in sums.iter_mut().zip(value) {
                    *sum += weight * value;
                }
            }
        }
    }

    /// Writes `Wᵀ g` of the tile to `columns` (`[gaussians of the tile, channels]`), with `pixels`
    /// `[16, 16, channels]`.
    ///
    /// # Panics
    /// If a slice has another length.
    pub fn project_back(&self, pixels: &[f32], channels: usize, columns: &mut [f32]) {
        assert_length("the tile's pixels", pixels.len(), Self::PIXELS * channels);
        assert_length("the tile's columns", columns.len(), self.gaussians.len() * channels);
        let product = ProjectBack { tile: self, pixels, columns };
        match channels {
            8 => Instructions::best().run(Fixed::<_, 8>(product)),
            16 => Instructions::best().run(Fixed::<_, 16>(product)),
            32 => Instructions::best().run(Fixed::<_, 32>(product)),
            _ => Instructions::best().run(Any(product, channels)),
        }
    }

    #[inline(always)]
    fn project_back_fixed<const C: usize>(&self, pixels: &[f32], columns: &mut [f32]) {
        let Some(pixels) = pixels.as_chunks::<C>().0.first_chunk::<{ TILE * TILE }>() else { return };
        let (columns, _) = columns.as_chunks_mut::<C>();
        for (column, sums) in columns.iter_mut().enumerate() {
            let mut registers = [0f32; C];
            for (pixel, weight) in self.column(column) {
                let gradient = &pixels[pixel as usize];
                for channel in 0..C {
                    registers[channel] += weight * gradient[channel];
                }
            }
            *sums = registers;
        }
    }

    #[inline(always)]
    fn project_back_any(&self, pixels: &[f32], channels: usize, columns: &mut [f32]) {
        for (column, sums) in columns.chunks_exact_mut(channels.max(1)).enumerate() {
            sums.fill(0.0);
            for (pixel, weight) in self.column(column) {
                let gradient = &pixels[usize::from(pixel) * channels..][..channels];
                for (sum, gradient) in sums.iter_mut().zip(gradient) {
                    *sum += weight * gradient;
                }
            }
        }
    }
}

/// `W v` of one tile.
struct Accumulate<'a> {
    tile: &'a TileWeights,
    values: &'a [f32],
    pixels: &'a mut [f32],
}

/// `Wᵀ g` of one tile.
struct ProjectBack<'a> {
    tile: &'a TileWeights,
    pixels: &'a [f32],
    columns: &'a mut [f32],
}

/// A product with a number of channels known at compile time.
struct Fixed<P, const C: usize>(P);

/// A product with any number of channels.
struct Any<P>(P, usize);

impl<const C: usize> Vectorize for Fixed<Accumulate<'_>, C> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        self.0.tile.accumulate_fixed::<C>(self.0.values, self.0.pixels);
    }
}

impl Vectorize for Any<Accumulate<'_>> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        self.0.tile.accumulate_any(self.0.values, self.1, self.0.pixels);
    }
}

impl<const C: usize> Vectorize for Fixed<ProjectBack<'_>, C> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        self.0.tile.project_back_fixed::<C>(self.0.pixels, self.0.columns);
    }
}

impl Vectorize for Any<ProjectBack<'_>> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        self.0.tile.project_back_any(self.0.pixels, self.1, self.0.columns);
    }
}
