//! The part of the blend-weight matrix that an optimisation works on: some pixels (rows), and the Gaussians
//! (columns) that they see, numbered anew without gaps.

use crate::{BlendWeights, TileWeights};
use rayon::prelude::*;

/// A set of a tile's 256 pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PixelSet([u64; 4]);

impl PixelSet {
    /// Adds a pixel (`16 * row + column` in the tile).
    pub fn insert(&mut self, pixel: u8) {
        self.0[usize::from(pixel) / 64] |= 1 << (pixel % 64);
    }

    /// Whether the pixel is in the set.
    pub fn contains(&self, pixel: u8) -> bool {
        self.0[usize::from(pixel) / 64] >> (pixel % 64) & 1 == 1
    }

    /// Whether no pixel is in the set.
    pub fn is_empty(&self) -> bool {
        self.0 == [0; 4]
    }
}

/// Rows of [`BlendWeights`] chosen by pixel, with every Gaussian that has a weight in them.
#[derive(Clone, Debug)]
pub struct ActiveWeights {
    tiles: Vec<ActiveTile>,
    /// Index in the scene of each active Gaussian.
    gaussians: Vec<u32>,
    /// Sum of each active Gaussian's weights over the whole image, chosen pixels or not.
    weight_sums: Vec<f32>,
    /// The columns of active Gaussian `g` are `columns[offsets[g]..offsets[g + 1]]`.
    offsets: Vec<u32>,
    /// Positions among the columns of all active tiles, one after the other.
    columns: Vec<u32>,
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
    /// Restricts `weights` to the pixels `chosen` (one set per tile). The scene has `gaussian_count` Gaussians.
    ///
    /// # Panics
    /// If there is not one set per tile, or a Gaussian that is seen is not below `gaussian_count`.
    pub fn new(weights: &BlendWeights, chosen: &[PixelSet], gaussian_count: usize) -> Self {
        assert_eq!(chosen.len(), weights.tiles().len(), "one pixel set per tile");
        let mut tiles: Vec<ActiveTile> = weights
            .tiles()
            .par_iter()
            .zip(chosen)
            .enumerate()
            .filter(|(_, (_, pixels))| !pixels.is_empty())
            .map(|(tile, (weights, pixels))| ActiveTile { tile, pixels: *pixels, weights: weights.restricted(pixels) })
            .collect();
        let mut number = vec![UNNUMBERED; gaussian_count];
        let mut gaussians = Vec::new();
        for tile in &mut tiles {
            for gaussian in &mut tile.weights.gaussians {
                let number = &mut number[*gaussian as usize];
                if *number == UNNUMBERED {
                    *number = gaussians.len() as u32;
                    gaussians.push(*gaussian);
                }
                *gaussian = *number;
            }
        }
        let weight_sums = weight_sums(weights, &number, gaussians.len());
        let (offsets, columns) = columns_by_gaussian(&tiles, gaussians.len());
        Self { tiles, gaussians, weight_sums, offsets, columns }
    }

    /// Tiles with chosen pixels.
    pub fn tiles(&self) -> &[ActiveTile] {
        &self.tiles
    }

    /// Index in the scene of each active Gaussian.
    pub fn gaussians(&self) -> &[u32] {
        &self.gaussians
    }

    /// Column sums of `W` over the whole image for each active Gaussian: its Jacobi preconditioner.
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

fn weight_sums(weights: &BlendWeights, number: &[u32], count: usize) -> Vec<f32> {
    let mut sums = vec![0.0; count];
    for tile in weights.tiles() {
        for (gaussian, sum) in tile.gaussians.iter().zip(&tile.weight_sums) {
            let number = number[*gaussian as usize];
            if number != UNNUMBERED {
                sums[number as usize] += sum;
            }
        }
    }
    sums
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
    /// The weights at the given pixels only; Gaussians without any of them are left out.
    fn restricted(&self, pixels: &PixelSet) -> Self {
        let mut kept = Self {
            left: self.left,
            top: self.top,
            width: self.width,
            height: self.height,
            gaussians: Vec::with_capacity(self.gaussians.len()),
            depths: Vec::with_capacity(self.gaussians.len()),
            weight_sums: Vec::with_capacity(self.gaussians.len()),
            offsets: Vec::with_capacity(self.gaussians.len() + 1),
            pixels: Vec::with_capacity(self.pixels.len()),
            weights: Vec::with_capacity(self.weights.len()),
        };
        kept.offsets.push(0);
        for (column, gaussian) in self.gaussians.iter().enumerate() {
            let before = kept.weights.len();
            for (pixel, weight) in self.column(column) {
                if pixels.contains(pixel) {
                    kept.pixels.push(pixel);
                    kept.weights.push(weight);
                }
            }
            if kept.weights.len() > before {
                kept.gaussians.push(*gaussian);
                kept.depths.push(self.depths[column]);
                kept.weight_sums.push(self.weight_sums[column]);
                kept.offsets.push(kept.weights.len() as u32);
            }
        }
        kept
    }
}
