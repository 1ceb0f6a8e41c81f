//! The patches that a frame shows.

use super::NO_PATCH;
use crate::MemorySettings;
use crate::recall::Recall;
use crate::settings::COVERED;
use crate::tile_surface::{RUN, SurfaceDepths, cut, run, run_mut};
use rayon::prelude::*;
use splatseg_geometry::{Affinities, SegmentId, SegmentMap};
use splatseg_kernels::{Instructions, Vectorize};
use splatseg_render::TileWeights;
use std::collections::BTreeMap;

/// Side of the cells in which the new Gaussians of a region become one patch, pixels of the grid of affinities.
const CELL: usize = 8;

/// The cells of a frame.
pub(super) struct FrameCells<'a> {
    regions: &'a SegmentMap,
    /// The cell of each column of the frame.
    columns: Vec<u32>,
    /// The cell of each row of the frame.
    rows: Vec<u32>,
}

impl<'a> FrameCells<'a> {
    pub fn new(affinities: &Affinities, regions: &'a SegmentMap) -> Self {
        let cells = |places: &[u32], size: usize| {
            let grid_place = |place| places.partition_point(|grid| *grid as usize <= place).saturating_sub(1);
            (0..size).map(|place| (grid_place(place) / CELL) as u32).collect()
        };
        let (columns, rows) = (cells(&affinities.columns, regions.width()), cells(&affinities.rows, regions.height()));
        Self { regions, columns, rows }
    }

    /// Key of the cell and the region at a pixel (column, row): 24 bits for the region, and 20 for each side.
    pub fn key(&self, (column, row): (usize, usize)) -> u64 {
        let cell = u64::from(self.rows[row]) << 20 | u64::from(self.columns[column]);
        u64::from(self.regions[(column, row)]) << 40 | cell
    }
}

/// The patch that a frame shows at each pixel of the grid of affinities.
pub(super) struct FramePatches {
    /// Columns of the grid.
    pub width: usize,
    /// `[rows, columns]`; [`NO_PATCH`] for none.
    pub patches: Vec<u32>,
}

impl FramePatches {
    /// Finds the patch of the Gaussian with the largest blend weight at each pixel, or the new patch that `new` returns
    /// for a pixel (column, row) whose surface the map lacked.
    pub fn new(
        recall: &Recall<'_>,
        of_gaussians: &[u32],
        affinities: &Affinities,
        settings: &MemorySettings,
        new: impl Fn((usize, usize)) -> Option<u32> + Sync,
    ) -> Self {
        let weights = recall.view().weights();
        let (width, side) = (affinities.columns.len(), TileWeights::SIDE);
        let strongest: Vec<[u32; TileWeights::PIXELS]> =
            weights.tiles().par_iter().map(|tile| strongest_gaussians(tile, recall, settings)).collect();
        let mut patches = vec![NO_PATCH; width * affinities.rows.len()];
        patches.par_chunks_mut(width.max(1)).zip(&affinities.rows).for_each(|(patches, row)| {
            let row = *row as usize;
            for (patch, column) in patches.iter_mut().zip(&affinities.columns) {
                let column = *column as usize;
                let at = (column, row);
                let is_missing = recall.frame().depth()[at] > 0.0 && recall.covered[at] < COVERED;
                let found = if is_missing { new(at) } else { None };
                *patch = found.unwrap_or_else(|| {
                    let tile = row / side * weights.tile_columns() + column / side;
                    let gaussian = strongest[tile][row % side * side + column % side];
                    of_gaussians.get(gaussian as usize).copied().unwrap_or(NO_PATCH)
                });
            }
        });
        Self { width, patches }
    }

    /// How many pixels show each patch with each id: patch, id and count. `ids` contains the id of each pixel, 0 for none.
    pub fn ids(&self, ids: &[SegmentId]) -> impl Iterator<Item = (u32, SegmentId, u32)> {
        let mut counts: BTreeMap<(u32, SegmentId), u32> = BTreeMap::new();
        let shown: Vec<(u32, SegmentId)> = self.patches.iter().copied().zip(ids.iter().copied()).collect();
        for run in shown.chunk_by(|one, next| one == next).filter(|run| run[0].0 != NO_PATCH && run[0].1 != 0) {
            *counts.entry(run[0]).or_default() += run.len() as u32;
        }
        counts.into_iter().map(|((patch, id), count)| (patch, id, count))
    }
}

/// The Gaussian with the largest blend weight at each pixel of a tile, `[16, 16]`, among those at the observed depth;
/// `u32::MAX` for none.
fn strongest_gaussians(
    tile: &TileWeights,
    recall: &Recall<'_>,
    settings: &MemorySettings,
) -> [u32; TileWeights::PIXELS] {
    let depths = SurfaceDepths::new(&cut(tile, recall.frame().depth()), settings);
    Instructions::best().run(FindStrongest { tile, depths: &depths })
}

/// The search of [`strongest_gaussians`].
struct FindStrongest<'a> {
    tile: &'a TileWeights,
    depths: &'a SurfaceDepths,
}

impl Vectorize for FindStrongest<'_> {
    type Output = [u32; TileWeights::PIXELS];

    #[inline(always)]
    fn run(self) -> [u32; TileWeights::PIXELS] {
        let mut strongest = [u32::MAX; TileWeights::PIXELS];
        let mut most = [0f32; TileWeights::PIXELS];
        for column in 0..self.tile.gaussians().len() {
            let (gaussian, depth) = (self.tile.gaussians()[column], self.tile.depths()[column]);
            let (firsts, weights) = self.tile.runs(column);
            for index in 0..firsts.len().min(weights.len()) {
                let first = firsts[index];
                let seen = self.depths.seen(first, depth, &weights[index]);
                let (mut largest, mut winners) = (*run(&most, first), *run(&strongest, first));
                for lane in 0..RUN {
                    let is_strongest = seen[lane] > largest[lane];
                    winners[lane] = if is_strongest { gaussian } else { winners[lane] };
                    largest[lane] = if is_strongest { seen[lane] } else { largest[lane] };
                }
                *run_mut(&mut most, first) = largest;
                *run_mut(&mut strongest, first) = winners;
            }
        }
        strongest
    }
}
