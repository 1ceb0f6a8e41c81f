//! The part of the blend-weight matrix that an optimisation works on: some pixels (rows), and the Gaussians
//! (columns) that they see, numbered anew without gaps.

use crate::TileWeights;

/// A set of a tile's 256 pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PixelSet([u64; 4]);

impl PixelSet {
    /// Every pixel.
    pub const ALL: Self = Self([u64::MAX; 4]);

    /// Adds a pixel (`16 * row + column` in the tile).
    pub fn insert(&mut self, pixel: u8) {
        self.0[usize::from(pixel) / 64] |= 1 << (pixel % 64);
    }

    /// Whether the pixel is in the set.
    pub fn contains(&self, pixel: u8) -> bool {
        self.0[usize::from(pixel) / 64] >> (pixel % 64) & 1 == 1
    }

    /// Number of pixels in the set.
    pub fn len(&self) -> usize {
        self.0.iter().map(|word| word.count_ones() as usize).sum()
    }

    /// Whether no pixel is in the set.
    pub fn is_empty(&self) -> bool {
        self.0 == [0; 4]
    }
}

/// Rows of [`BlendWeights`](crate::BlendWeights) chosen by pixel, with every Gaussian that has a weight in them.
#[derive(Clone, Debug)]
pub struct ActiveWeights {
    tiles: Vec<ActiveTile>,
    /// Index in the scene of each active Gaussian.
    gaussians: Vec<u32>,
    /// The columns of active Gaussian `g` are `columns[offsets[g]..offsets[g + 1]]`.
    offsets: Vec<u32>,
    /// Positions among the columns of all active tiles, one after the other.
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
}

const UNNUMBERED: u32 = u32::MAX;

impl ActiveWeights {
    /// Numbers the Gaussians of `tiles` anew. The scene has `gaussian_count` Gaussians; `seen` are the tiles of the
    /// whole view, chosen or not.
    pub(crate) fn new(mut tiles: Vec<ActiveTile>, seen: &[TileWeights], gaussian_count: usize) -> Self {
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
        let (offsets, columns) = columns_by_gaussian(&tiles, gaussians.len());
        let weight_sums = weight_sums(&tiles, seen, &number, gaussians.len());
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

    /// Column sums of `W`, the active Gaussians' Jacobi preconditioners: over the whole image before the view was
    /// extended, or over the chosen pixels after it, whichever is larger.
    pub fn weight_sums(&self) -> &[f32] {
        &self.weight_sums
    }

    /// Number of columns of all active tiles together: a Gaussian has one in each tile that it touches.
    pub fn column_count(&self) -> usize {
        self.columns.len()
    }

    /// Where the columns of an active Gaussian stand among the columns of all active tiles, one after the other.
    pub fn columns_of(&self, gaussian: usize) -> &[u32] {
        &self.columns[self.offsets[gaussian] as usize..self.offsets[gaussian + 1] as usize]
    }
}

fn weight_sums(tiles: &[ActiveTile], seen: &[TileWeights], number: &[u32], count: usize) -> Vec<f32> {
    let mut sums = vec![0f32; count];
    for tile in seen {
        for (gaussian, sum) in tile.gaussians.iter().zip(&tile.weight_sums) {
            let number = number[*gaussian as usize];
            if number != UNNUMBERED {
                sums[number as usize] += sum;
            }
        }
    }
    let mut chosen = vec![0f32; count];
    for tile in tiles {
        for (number, sum) in tile.weights.gaussians.iter().zip(&tile.weights.weight_sums) {
            chosen[*number as usize] += sum;
        }
    }
    sums.iter().zip(chosen).map(|(sum, chosen)| sum.max(chosen)).collect()
}

/// A counting sort of all columns by Gaussian; columns of one Gaussian stay in tile order.
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
    /// The weights above `min_weight` at the given pixels; Gaussians without any of them are left out.
    pub(crate) fn restricted(&self, pixels: &PixelSet, min_weight: f32) -> Self {
        let mut kept = Self::empty(self.left, self.top, self.width, self.height);
        let (mut column_pixels, mut column_weights) = (Vec::with_capacity(256), Vec::with_capacity(256));
        for (column, gaussian) in self.gaussians.iter().enumerate() {
            column_pixels.clear();
            column_weights.clear();
            for (pixel, weight) in self.column(column) {
                if pixels.contains(pixel) && weight > min_weight {
                    column_pixels.push(pixel);
                    column_weights.push(weight);
                }
            }
            if !column_pixels.is_empty() {
                kept.push_weights(*gaussian, self.depths[column], &column_pixels, &column_weights);
            }
        }
        kept
    }
}
