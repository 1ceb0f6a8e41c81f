//! Binning: the Gaussians that touch each tile of the image, front to back.

use crate::{PixelSet, ProjectedGaussian};
use rayon::prelude::*;
use splatseg_geometry::Image;

/// Side of a tile, pixels: the index of a pixel in its tile fits one byte.
pub(crate) const TILE: usize = 16;

/// Projected Gaussians binned by one task.
const CHUNK: usize = 8192;

/// The tiles of an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct TileGrid {
    pub width: usize,
    pub height: usize,
    pub columns: usize,
    pub rows: usize,
}

/// Depth in the high half, index of the projected Gaussian in the low half: increasing keys go front to back, and
/// equal depths keep the Gaussians' order. (The bits of positive floats increase with their value.)
pub(crate) type DepthKey = u64;

impl TileGrid {
    pub fn new(width: usize, height: usize) -> Self {
        Self { width, height, columns: width.div_ceil(TILE), rows: height.div_ceil(TILE) }
    }

    pub fn len(&self) -> usize {
        self.columns * self.rows
    }

    /// Inclusive ranges (first column, last column, first row, last row) of the tiles that a Gaussian's box touches.
    fn touched(&self, splat: &ProjectedGaussian) -> (usize, usize, usize, usize) {
        // A float cast to usize saturates, so boxes far outside the image are safe.
        let tile_of = |pixel: f32, tiles: usize| ((pixel.max(0.0) as usize) / TILE).min(tiles - 1);
        (
            tile_of(splat.mean.x - splat.half_extent.x, self.columns),
            tile_of(splat.mean.x + splat.half_extent.x, self.columns),
            tile_of(splat.mean.y - splat.half_extent.y, self.rows),
            tile_of(splat.mean.y + splat.half_extent.y, self.rows),
        )
    }

    /// For each tile, the sorted keys of the projected Gaussians that touch it.
    pub fn bin(&self, splats: &[ProjectedGaussian]) -> Vec<Vec<DepthKey>> {
        if self.len() == 0 {
            return Vec::new();
        }
        let chunks: Vec<ChunkBins> = (0..splats.len())
            .into_par_iter()
            .step_by(CHUNK)
            .map(|start| ChunkBins::new(self, splats, start, (start + CHUNK).min(splats.len())))
            .collect();
        (0..self.len())
            .into_par_iter()
            .map(|tile| {
                let mut keys: Vec<DepthKey> = Vec::with_capacity(chunks.iter().map(|chunk| chunk.of(tile).len()).sum());
                for chunk in &chunks {
                    keys.extend_from_slice(chunk.of(tile));
                }
                keys.sort_unstable();
                keys
            })
            .collect()
    }
}

/// Counting sort of one chunk of projected Gaussians by tile.
struct ChunkBins {
    /// Keys of tile `t` are `keys[offsets[t]..offsets[t + 1]]`.
    offsets: Vec<u32>,
    keys: Vec<DepthKey>,
}

impl ChunkBins {
    fn new(grid: &TileGrid, splats: &[ProjectedGaussian], start: usize, end: usize) -> Self {
        let mut offsets = vec![0u32; grid.len() + 1];
        let each_tile = |splat: &ProjectedGaussian, visit: &mut dyn FnMut(usize)| {
            let (left, right, top, bottom) = grid.touched(splat);
            for row in top..=bottom {
                for column in left..=right {
                    visit(row * grid.columns + column);
                }
            }
        };
        for splat in &splats[start..end] {
            each_tile(splat, &mut |tile| offsets[tile + 1] += 1);
        }
        for tile in 0..grid.len() {
            offsets[tile + 1] += offsets[tile];
        }
        let mut next = offsets.clone();
        let mut keys = vec![0; offsets[grid.len()] as usize];
        for (index, splat) in splats[start..end].iter().enumerate() {
            let key = u64::from(splat.depth.to_bits()) << 32 | (start + index) as u64;
            each_tile(splat, &mut |tile| {
                keys[next[tile] as usize] = key;
                next[tile] += 1;
            });
        }
        Self { offsets, keys }
    }

    fn of(&self, tile: usize) -> &[DepthKey] {
        &self.keys[self.offsets[tile] as usize..self.offsets[tile + 1] as usize]
    }
}

/// Conditions for a Gaussian to affect a pixel.
pub(crate) struct Reach<'a> {
    /// It must be nearer than this surface, metres.
    pub surface: &'a Image<f32>,
    /// Its alpha must reach this.
    pub alpha: f32,
    /// Alpha of a projected Gaussian at the edge of its box.
    pub min_alpha: f32,
}

/// The pixels that at least one of the Gaussians affects, per tile.
pub(crate) fn touched_pixels(grid: &TileGrid, splats: &[ProjectedGaussian], reach: &Reach<'_>) -> Vec<PixelSet> {
    // Rounded outwards: a slightly too large set costs little.
    let range = |center: f32, half: f32, size: usize| {
        let first = (center - half - 0.01).ceil().max(0.0) as usize;
        let end = (center + half + 1.01).max(0.0) as usize;
        first..end.min(size)
    };
    let mut touched = vec![PixelSet::default(); grid.len()];
    for splat in splats.iter().filter(|splat| splat.opacity >= reach.alpha) {
        let half =
            splat.half_extent * ((splat.opacity / reach.alpha).ln() / (splat.opacity / reach.min_alpha).ln()).sqrt();
        let columns = range(splat.mean.x, half.x, grid.width);
        for row in range(splat.mean.y, half.y, grid.height) {
            for column in columns.clone().filter(|column| splat.depth < reach.surface[(*column, row)]) {
                let tile = row / TILE * grid.columns + column / TILE;
                touched[tile].insert((row % TILE * TILE + column % TILE) as u8);
            }
        }
    }
    touched
}
