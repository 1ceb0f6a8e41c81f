//! The blend weights of one tile, and products with them.

use crate::tiles::TILE;
use splatseg_kernels::{Instructions, Vectorize};

/// Pixels of a row whose weights are stored together: the lanes of a vector.
pub(crate) const LANES: usize = 8;

/// The weights of one tile: the unit of parallel work.
///
/// A Gaussian's weights are stored in runs of [`TileWeights::RUN`] pixels of a row, so that products with them are vector
/// code. Most Gaussians of an RGB-D map are narrower than a run; pixels that they do not reach have the weight 0.
#[derive(Clone, Debug, PartialEq)]
pub struct TileWeights {
    pub(crate) left: usize,
    pub(crate) top: usize,
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) gaussians: Vec<u32>,
    pub(crate) depths: Vec<f32>,
    /// The runs of the Gaussian of column `c` are `offsets[c]..offsets[c + 1]`.
    pub(crate) offsets: Vec<u32>,
    /// First pixel of each run.
    pub(crate) firsts: Vec<u8>,
    pub(crate) weights: Vec<[f32; LANES]>,
}

/// Panics if a slice does not have the expected length.
#[track_caller]
pub(crate) fn assert_length(what: &str, found: usize, expected: usize) {
    assert!(found == expected, "{what} hold {found} values, expected {expected}");
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
            offsets: vec![0],
            firsts: Vec::new(),
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
        self.offsets.truncate(1);
        self.firsts.clear();
        self.weights.clear();
    }

    /// Adds a run to the Gaussian that [`Self::finish_column`] is called for next, unless all its weights are 0. Its pixels
    /// must be in one row, behind those of the runs before.
    #[inline(always)]
    pub(crate) fn push_run(&mut self, first: usize, weights: &[f32; LANES]) {
        // Weights are not negative, so their bits say which are 0.
        let mut bits = 0;
        for weight in weights {
            bits |= weight.to_bits();
        }
        if bits != 0 {
            self.firsts.push(first as u8);
            self.weights.push(*weights);
        }
    }

    /// Adds the Gaussian of the runs pushed since the last call behind the others, unless there are none.
    #[inline(always)]
    pub(crate) fn finish_column(&mut self, gaussian: u32, depth: f32) {
        let end = self.weights.len() as u32;
        if self.offsets.last() != Some(&end) {
            self.gaussians.push(gaussian);
            self.depths.push(depth);
            self.offsets.push(end);
        }
    }

    /// Number of weights that are not 0.
    pub(crate) fn non_zeros(&self) -> usize {
        self.weights.iter().flatten().filter(|weight| **weight > 0.0).count()
    }

    /// Sum of a Gaussian's weights in the tile.
    pub(crate) fn weight_sum(&self, column: usize) -> f32 {
        self.column(column).map(|(_, weight)| weight).sum()
    }

    /// Number of pixels in a run.
    pub const RUN: usize = LANES;

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

    /// The pixels (`16 * row + column` in the tile) and weights of the tile's `column`-th Gaussian, without those of 0. For
    /// code that must be fast, [`Self::runs`].
    #[inline(always)]
    pub fn column(&self, column: usize) -> impl Iterator<Item = (u8, f32)> + '_ {
        let (firsts, weights) = self.runs(column);
        firsts.iter().zip(weights).flat_map(|(first, weights)| {
            let pixels = weights.iter().enumerate().filter(|(_, weight)| **weight > 0.0);
            pixels.map(move |(lane, weight)| (first + lane as u8, *weight))
        })
    }

    /// The runs of the tile's `column`-th Gaussian: the first pixel of each (`16 * row + column` in the tile), and the
    /// weights of this and the next seven pixels of its row. Pixels at which the Gaussian is not blended have the weight 0.
    ///
    /// Vector code over runs copies the values of a run, computes and stores it; with an index, because iterators may be
    /// called rather than inlined, and conditions on values that were not loaded before become branches.
    #[inline(always)]
    pub fn runs(&self, column: usize) -> (&[u8], &[[f32; LANES]]) {
        let range = self.offsets[column] as usize..self.offsets[column + 1] as usize;
        (&self.firsts[range.clone()], &self.weights[range])
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
            let (firsts, weights) = self.runs(column);
            for index in 0..firsts.len().min(weights.len()) {
                for (lane, weight) in weights[index].iter().enumerate() {
                    if *weight > 0.0 {
                        let pixel = firsts[index].wrapping_add(lane as u8);
                        let mut sums = pixels[pixel as usize];
                        for channel in 0..C {
                            sums[channel] += weight * value[channel];
                        }
                        pixels[pixel as usize] = sums;
                    }
                }
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
            let (firsts, weights) = self.runs(column);
            for index in 0..firsts.len().min(weights.len()) {
                for (lane, weight) in weights[index].iter().enumerate() {
                    if *weight > 0.0 {
                        let pixel = firsts[index].wrapping_add(lane as u8);
                        let gradient = &pixels[pixel as usize];
                        for channel in 0..C {
                            registers[channel] += weight * gradient[channel];
                        }
                    }
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
