//! The part of the blend-weight matrix that an optimisation uses: chosen pixels (rows) and the Gaussians (columns) with
//! a weight there, renumbered without gaps.

use crate::{PixelSet, TileWeights};
use rayon::prelude::*;
use splatseg_kernels::{Instructions, Vectorize};

/// Rows of [`BlendWeights`](crate::BlendWeights) chosen by pixel, with every Gaussian that has a weight in them.
#[derive(Clone, Debug)]
pub struct ActiveWeights {
    tiles: Vec<ActiveTile>,
    /// Index in the scene of each active Gaussian.
    gaussians: Vec<u32>,
    /// The columns of active Gaussian `g` are `columns[offsets[g]..offsets[g + 1]]`.
    offsets: Vec<u32>,
    /// Positions in the concatenated columns of all active tiles.
    columns: Vec<u32>,
    weight_sums: Vec<f32>,
}

/// The chosen pixels of one tile.
#[derive(Clone, Debug)]
pub struct ActiveTile {
    /// Number of the tile in the image, row-major.
    pub tile: usize,
    /// The chosen pixels.
    pub pixels: PixelSet,
    /// Weights at the chosen pixels; Gaussians have their active numbers.
    pub weights: TileWeights,
    /// The same weights, pixel by pixel.
    rows: PixelRows,
}

/// Compressed sparse rows of one tile.
#[derive(Clone, Debug, Default)]
struct PixelRows {
    /// Weights of pixel `p` are `offsets[p]..offsets[p + 1]`, front to back.
    offsets: Vec<u32>,
    gaussians: Vec<u32>,
    weights: Vec<f32>,
}

const UNNUMBERED: u32 = u32::MAX;

impl ActiveWeights {
    /// Renumbers the Gaussians of `tiles`. The scene has `gaussian_count` Gaussians; `all_tiles` are all tiles of the
    /// view.
    pub(crate) fn new(mut tiles: Vec<ActiveTile>, all_tiles: &[TileWeights], gaussian_count: usize) -> Self {
        let mut number = vec![UNNUMBERED; gaussian_count];
        let mut gaussians = Vec::new();
        for gaussian in tiles.iter_mut().flat_map(|tile| &mut tile.weights.gaussians) {
            let number = &mut number[*gaussian as usize];
            if *number == UNNUMBERED {
                *number = gaussians.len() as u32;
                gaussians.push(*gaussian);
            }
            *gaussian = *number;
        }
        tiles.par_iter_mut().for_each(|tile| tile.rows = PixelRows::from_tile(&tile.weights));
        let (offsets, columns) = columns_by_gaussian(&tiles, gaussians.len());
        let weight_sums = weight_sums(all_tiles, &number, gaussians.len());
        Self { tiles, gaussians, offsets, columns, weight_sums }
    }

    /// Tiles with chosen pixels.
    pub fn tiles(&self) -> &[ActiveTile] {
        &self.tiles
    }

    /// Index in the scene of each active Gaussian.
    pub fn gaussians(&self) -> &[u32] {
        &self.gaussians
    }

    /// Column sums of `W` over the whole image, not just the chosen pixels: the active Gaussians' Jacobi
    /// preconditioners.
    pub fn weight_sums(&self) -> &[f32] {
        &self.weight_sums
    }

    /// Number of columns of all active tiles: a Gaussian has one in each tile that it touches.
    pub fn column_count(&self) -> usize {
        self.columns.len()
    }

    /// Positions of an active Gaussian's columns in the concatenated columns of all active tiles.
    pub fn columns_of(&self, gaussian: usize) -> &[u32] {
        &self.columns[self.offsets[gaussian] as usize..self.offsets[gaussian + 1] as usize]
    }
}

impl ActiveTile {
    /// A tile without rows; they are made once the Gaussians have their active numbers.
    pub(crate) fn new(tile: usize, pixels: PixelSet, weights: TileWeights) -> Self {
        Self { tile, pixels, weights, rows: PixelRows::default() }
    }

    /// Writes `W v` to `pixels` (`[16, 16, channels]`) for the chosen pixels and 0 for the others, with `values`
    /// `[active Gaussians, channels]`. Equals [`TileWeights::accumulate`], but works pixel by pixel with sums in
    /// registers.
    ///
    /// # Panics
    /// If `values` is too short or `pixels` is not `[16, 16, channels]`.
    pub fn render(&self, values: &[f32], channels: usize, pixels: &mut [f32]) {
        assert_eq!(pixels.len(), TileWeights::PIXELS * channels, "the tile's pixels");
        let product = RenderRows { rows: &self.rows, values, pixels };
        match channels {
            8 => Instructions::best().run(Fixed::<8>(product)),
            16 => Instructions::best().run(Fixed::<16>(product)),
            32 => Instructions::best().run(Fixed::<32>(product)),
            _ => {
                product.pixels.fill(0.0);
                self.weights.accumulate(values, channels, product.pixels);
            }
        }
    }
}

/// The product of [`ActiveTile::render`].
struct RenderRows<'a> {
    rows: &'a PixelRows,
    values: &'a [f32],
    pixels: &'a mut [f32],
}

/// The product with a number of channels known at compile time.
struct Fixed<'a, const C: usize>(RenderRows<'a>);

impl<const C: usize> Vectorize for Fixed<'_, C> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let RenderRows { rows, values, pixels } = self.0;
        let (values, _) = values.as_chunks::<C>();
        let (pixels, _) = pixels.as_chunks_mut::<C>();
        for (range, pixel) in rows.offsets.windows(2).zip(pixels) {
            let range = range[0] as usize..range[1] as usize;
            let mut sums = [0f32; C];
            for (gaussian, weight) in rows.gaussians[range.clone()].iter().zip(&rows.weights[range]) {
                let value = &values[*gaussian as usize];
                for channel in 0..C {
                    sums[channel] += weight * value[channel];
                }
            }
            *pixel = sums;
        }
    }
}

impl PixelRows {
    /// Counting sort by pixel; the weights of one pixel stay front to back.
    fn from_tile(tile: &TileWeights) -> Self {
        let mut offsets = vec![0u32; TileWeights::PIXELS + 1];
        for (pixel, _) in (0..tile.gaussians.len()).flat_map(|column| tile.column(column)) {
            offsets[usize::from(pixel) + 1] += 1;
        }
        for pixel in 0..TileWeights::PIXELS {
            offsets[pixel + 1] += offsets[pixel];
        }
        let mut next = offsets.clone();
        let count = offsets[TileWeights::PIXELS] as usize;
        let (mut gaussians, mut weights) = (vec![0; count], vec![0.0; count]);
        for (column, gaussian) in tile.gaussians.iter().enumerate() {
            for (pixel, weight) in tile.column(column) {
                let place = &mut next[usize::from(pixel)];
                gaussians[*place as usize] = *gaussian;
                weights[*place as usize] = weight;
                *place += 1;
            }
        }
        Self { offsets, gaussians, weights }
    }
}

fn weight_sums(all_tiles: &[TileWeights], number: &[u32], count: usize) -> Vec<f32> {
    let sums_of = |tile: &TileWeights| {
        let numbered = tile.gaussians.iter().map(|gaussian| number[*gaussian as usize]).enumerate();
        let active = numbered.filter(|(_, number)| *number != UNNUMBERED);
        active.map(|(column, number)| (number as usize, tile.weight_sum(column))).collect()
    };
    let by_tile: Vec<Vec<(usize, f32)>> = all_tiles.par_iter().map(sums_of).collect();
    let mut sums = vec![0f32; count];
    for (number, sum) in by_tile.into_iter().flatten() {
        sums[number] += sum;
    }
    sums
}

/// Counting sort of all columns by Gaussian; columns of one Gaussian stay in tile order.
fn columns_by_gaussian(tiles: &[ActiveTile], count: usize) -> (Vec<u32>, Vec<u32>) {
    let mut offsets = vec![0u32; count + 1];
    let all = || tiles.iter().flat_map(|tile| tile.weights.gaussians.iter());
    for gaussian in all() {
        offsets[*gaussian as usize + 1] += 1;
    }
    for gaussian in 0..count {
        offsets[gaussian + 1] += offsets[gaussian];
    }
    let mut next = offsets.clone();
    let mut columns = vec![0; offsets[count] as usize];
    for (position, gaussian) in all().enumerate() {
        columns[next[*gaussian as usize] as usize] = position as u32;
        next[*gaussian as usize] += 1;
    }
    (offsets, columns)
}

impl TileWeights {
    /// The weights above `min_weight` at the given pixels; Gaussians without such a weight are omitted.
    pub(crate) fn restricted(&self, pixels: &PixelSet, min_weight: f32) -> Self {
        let mut kept = Self::empty(self.left, self.top, self.width, self.height);
        for (column, gaussian) in self.gaussians.iter().enumerate() {
            let (firsts, weights) = self.runs(column);
            for (first, weights) in firsts.iter().zip(weights) {
                let mut chosen = *weights;
                for (lane, weight) in chosen.iter_mut().enumerate() {
                    if !(pixels.contains(first + lane as u8) && *weight > min_weight) {
                        *weight = 0.0;
                    }
                }
                kept.push_run(usize::from(*first), &chosen);
            }
            kept.finish_column(*gaussian, self.depths[column]);
        }
        kept
    }
}
