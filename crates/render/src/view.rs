//! A view of Gaussians from a camera, which can take in new Gaussians.

use crate::rasterise::{Scene, TileRasteriser, Wanted};
use crate::tiles::{DepthKey, TileGrid, merge_sorted};
use crate::{
    ActiveTile, ActiveWeights, BlendWeights, Camera, Gaussians, PixelSet, ProjectedGaussian, TileWeights, project,
};
use rayon::prelude::*;
use std::time::{Duration, Instant};

/// A rasterised view: projected and binned once, blended once.
#[derive(Clone, Debug)]
pub struct View {
    projection: Projection,
    weights: BlendWeights,
}

/// A view to which Gaussians were added after it was rasterised. Pixels are blended anew only as they are asked for.
#[derive(Clone, Debug)]
pub struct ExtendedView {
    projection: Projection,
    /// Weights of the Gaussians that were there before; out of date in `touched` tiles.
    before: BlendWeights,
    /// Whether an added Gaussian touches the tile.
    touched: Vec<bool>,
}

/// Wall-clock time spent on a view so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ViewTiming {
    /// Projecting Gaussians and binning them into tiles.
    pub project: Duration,
    /// Blending: making weights.
    pub rasterise: Duration,
}

/// Projected Gaussians in tiles.
#[derive(Clone, Debug)]
struct Projection {
    camera: Camera,
    grid: TileGrid,
    /// Number of Gaussians taken in so far.
    gaussian_count: usize,
    splats: Vec<ProjectedGaussian>,
    /// Per tile, front to back.
    keys: Vec<Vec<DepthKey>>,
    timing: ViewTiming,
}

impl View {
    /// Rasterises `gaussians` as `camera` sees them.
    ///
    /// The semantics are those of `gsplat.rasterization` 1.5 in its classic mode, without background.
    pub fn new(gaussians: &Gaussians, camera: &Camera) -> Self {
        let mut projection = Projection::new(camera);
        projection.add(gaussians);
        let weights = projection.blend_all();
        Self { projection, weights }
    }

    /// Takes in the Gaussians that were appended to `gaussians` since the view was made.
    pub fn extend(mut self, gaussians: &Gaussians) -> ExtendedView {
        let touched = self.projection.add(gaussians);
        ExtendedView { projection: self.projection, before: self.weights, touched }
    }

    /// The camera of the view.
    pub fn camera(&self) -> &Camera {
        &self.projection.camera
    }

    /// The blend weights of all Gaussians.
    pub fn weights(&self) -> &BlendWeights {
        &self.weights
    }

    /// The Gaussians that can touch the image, by increasing index.
    pub fn projected(&self) -> &[ProjectedGaussian] {
        &self.projection.splats
    }

    /// Time spent so far.
    pub fn timing(&self) -> ViewTiming {
        self.projection.timing
    }
}

impl ExtendedView {
    /// The weights above `min_weight` at the pixels `chosen` (one set per tile, row-major), as if all Gaussians had
    /// been there from the start.
    ///
    /// # Panics
    /// If there is not one set per tile.
    pub fn active_weights(&mut self, chosen: &[PixelSet], min_weight: f32) -> ActiveWeights {
        assert_eq!(chosen.len(), self.touched.len(), "one pixel set per tile");
        let started = Instant::now();
        let tiles: Vec<ActiveTile> = chosen
            .par_iter()
            .enumerate()
            .filter(|(_, pixels)| !pixels.is_empty())
            .map_init(TileRasteriser::new, |rasteriser, (tile, pixels)| {
                let weights = if self.touched[tile] {
                    let wanted = Wanted { pixels: *pixels, min_weight };
                    rasteriser.rasterise(&self.projection.scene(), tile, &self.projection.keys[tile], &wanted)
                } else {
                    self.before.tiles[tile].restricted(pixels, min_weight)
                };
                ActiveTile { tile, pixels: *pixels, weights }
            })
            .collect();
        let active = ActiveWeights::new(tiles, &self.before.tiles, self.projection.gaussian_count);
        self.projection.timing.rasterise += started.elapsed();
        active
    }

    /// The view of all Gaussians, as if they had been there from the start.
    pub fn into_view(mut self) -> View {
        let weights = self.projection.blend_all();
        View { projection: self.projection, weights }
    }

    /// Time spent so far.
    pub fn timing(&self) -> ViewTiming {
        self.projection.timing
    }
}

impl Projection {
    fn new(camera: &Camera) -> Self {
        let grid = TileGrid::new(camera.intrinsics.width, camera.intrinsics.height);
        Self {
            camera: *camera,
            grid,
            gaussian_count: 0,
            splats: Vec::new(),
            keys: vec![Vec::new(); grid.len()],
            timing: ViewTiming::default(),
        }
    }

    /// Projects and bins the Gaussians not yet taken in; tells for each tile whether they touch it.
    fn add(&mut self, gaussians: &Gaussians) -> Vec<bool> {
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
        let touched = added.iter().map(|keys| !keys.is_empty()).collect();
        self.keys.par_iter_mut().zip(added).for_each(|(keys, added)| {
            if keys.is_empty() {
                *keys = added;
            } else if !added.is_empty() {
                *keys = merge_sorted(keys, &added);
            }
        });
        self.timing.project += started.elapsed();
        touched
    }

    fn blend_all(&mut self) -> BlendWeights {
        let started = Instant::now();
        let wanted = Wanted { pixels: PixelSet::ALL, min_weight: 0.0 };
        let tiles: Vec<TileWeights> = (0..self.grid.len())
            .into_par_iter()
            .map_init(TileRasteriser::new, |rasteriser, tile| {
                rasteriser.rasterise(&self.scene(), tile, &self.keys[tile], &wanted)
            })
            .collect();
        self.timing.rasterise += started.elapsed();
        BlendWeights { width: self.grid.width, height: self.grid.height, tiles, tile_columns: self.grid.columns.max(1) }
    }

    fn scene(&self) -> Scene<'_> {
        Scene { grid: &self.grid, splats: &self.splats, limits: &self.camera.limits }
    }
}
