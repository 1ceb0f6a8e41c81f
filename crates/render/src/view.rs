//! A view of Gaussians from a camera, which can take in new Gaussians.

use crate::rasterise::TileRasteriser;
use crate::tiles::{DepthKey, TileGrid, merge_sorted};
use crate::{BlendWeights, Camera, Gaussians, ProjectedGaussian, TileWeights, project};
use rayon::prelude::*;
use std::time::{Duration, Instant};

/// A rasterised view: projected and binned once, blended once, and brought up to date when Gaussians are added.
#[derive(Clone, Debug)]
pub struct View {
    camera: Camera,
    grid: TileGrid,
    /// Number of Gaussians taken in so far.
    gaussian_count: usize,
    splats: Vec<ProjectedGaussian>,
    /// Per tile, front to back.
    keys: Vec<Vec<DepthKey>>,
    weights: BlendWeights,
    timing: ViewTiming,
}

/// Wall-clock time spent on a [`View`] so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ViewTiming {
    /// Projecting Gaussians and binning them into tiles.
    pub project: Duration,
    /// Blending: making the [`BlendWeights`].
    pub rasterise: Duration,
}

impl View {
    /// Rasterises `gaussians` as `camera` sees them.
    ///
    /// The semantics are those of `gsplat.rasterization` 1.5 in its classic mode, without background.
    pub fn new(gaussians: &Gaussians, camera: &Camera) -> Self {
        let grid = TileGrid::new(camera.intrinsics.width, camera.intrinsics.height);
        let mut view = Self {
            camera: *camera,
            grid,
            gaussian_count: 0,
            splats: Vec::new(),
            keys: vec![Vec::new(); grid.len()],
            weights: BlendWeights {
                width: grid.width,
                height: grid.height,
                tiles: Vec::new(),
                tile_columns: grid.columns.max(1),
            },
            timing: ViewTiming::default(),
        };
        let every_tile: Vec<usize> = (0..grid.len()).collect();
        view.add(gaussians);
        let started = Instant::now();
        view.weights.tiles = view.rasterise(&every_tile);
        view.timing.rasterise += started.elapsed();
        view
    }

    /// Takes in the Gaussians that were appended to `gaussians` since the view was made, and blends the tiles that
    /// they touch anew. The result is the same as that of [`View::new`] over all of them.
    ///
    /// Returns the numbers of the tiles (row-major) that changed, increasing.
    pub fn extend(&mut self, gaussians: &Gaussians) -> Vec<usize> {
        let touched = self.add(gaussians);
        let started = Instant::now();
        for (tile, weights) in touched.iter().zip(self.rasterise(&touched)) {
            self.weights.tiles[*tile] = weights;
        }
        self.timing.rasterise += started.elapsed();
        touched
    }

    /// Projects and bins the Gaussians not yet taken in; returns the tiles that they touch.
    fn add(&mut self, gaussians: &Gaussians) -> Vec<usize> {
        let started = Instant::now();
        let first = self.splats.len();
        let projected = project(gaussians, self.gaussian_count, &self.camera);
        if first == 0 {
            self.splats = projected;
        } else {
            self.splats.extend(projected);
        }
        self.gaussian_count = gaussians.len();
        let added = self.grid.bin(&self.splats, first);
        let touched: Vec<usize> = (0..added.len()).filter(|tile| !added[*tile].is_empty()).collect();
        for (tile, keys) in added.into_iter().enumerate() {
            if self.keys[tile].is_empty() {
                self.keys[tile] = keys;
            } else if !keys.is_empty() {
                self.keys[tile] = merge_sorted(&self.keys[tile], &keys);
            }
        }
        self.timing.project += started.elapsed();
        touched
    }

    fn rasterise(&self, tiles: &[usize]) -> Vec<TileWeights> {
        tiles
            .par_iter()
            .map_init(TileRasteriser::new, |rasteriser, tile| {
                rasteriser.rasterise(&self.grid, *tile, &self.keys[*tile], &self.splats, &self.camera.limits)
            })
            .collect()
    }

    /// The camera of the view.
    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    /// The blend weights of all Gaussians taken in so far.
    pub fn weights(&self) -> &BlendWeights {
        &self.weights
    }

    /// The Gaussians that can touch the image, by increasing index.
    pub fn projected(&self) -> &[ProjectedGaussian] {
        &self.splats
    }

    /// Time spent so far.
    pub fn timing(&self) -> ViewTiming {
        self.timing
    }
}
