//! A rasterised view of Gaussians from a camera.

use crate::rasterise::{Scene, TileRasteriser};
use crate::tiles::{Reach, TileGrid, touched_pixels};
use crate::{
    ActiveTile, ActiveWeights, BlendWeights, Camera, PixelSet, ProjectedGaussian, Splats, TileWeights, project,
};
use rayon::prelude::*;
use splatseg_geometry::{Image, STAGE_TARGET};

/// A rasterised view: the Gaussians are projected, binned and blended once.
#[derive(Clone, Debug)]
pub struct View {
    camera: Camera,
    grid: TileGrid,
    gaussian_count: usize,
    splats: Vec<ProjectedGaussian>,
    weights: BlendWeights,
}

impl View {
    /// Rasterises `gaussians` for `camera`.
    ///
    /// The semantics are those of `gsplat.rasterization` 1.5 in its classic mode, without background.
    pub fn new(gaussians: &(impl Splats + ?Sized), camera: &Camera) -> Self {
        Self::read(gaussians, camera, |_| ()).0
    }

    /// Rasterises as [`View::new`], and calls `read_tile` on every tile while its weights are still in the cache.
    /// Returns its results row-major, one per tile.
    pub fn read<T: Send>(
        gaussians: &(impl Splats + ?Sized),
        camera: &Camera,
        read_tile: impl Fn(&TileWeights) -> T + Sync,
    ) -> (Self, Vec<T>) {
        // A copy has the right size; the rasteriser's memory keeps its capacity.
        Self::read_keeping(gaussians, camera, read_tile, TileWeights::clone)
    }

    /// As [`View::read`], for views of which nothing else is needed: [`View::weights`] has tiles without weights.
    pub fn read_once<T: Send>(
        gaussians: &(impl Splats + ?Sized),
        camera: &Camera,
        read_tile: impl Fn(&TileWeights) -> T + Sync,
    ) -> (Self, Vec<T>) {
        Self::read_keeping(gaussians, camera, read_tile, |tile| {
            TileWeights::empty(tile.left, tile.top, tile.width, tile.height)
        })
    }

    fn read_keeping<T: Send>(
        gaussians: &(impl Splats + ?Sized),
        camera: &Camera,
        read_tile: impl Fn(&TileWeights) -> T + Sync,
        keep: fn(&TileWeights) -> TileWeights,
    ) -> (Self, Vec<T>) {
        let stage = tracing::debug_span!(target: STAGE_TARGET, "project_and_bin").entered();
        let grid = TileGrid::new(camera.intrinsics.width, camera.intrinsics.height);
        let splats = project(gaussians, 0, camera);
        let keys = grid.bin(&splats);
        drop(stage);

        let _stage = tracing::debug_span!(target: STAGE_TARGET, "rasterise").entered();
        let scene = Scene { grid: &grid, splats: &splats, limits: &camera.limits };
        let (tiles, found) = keys
            .par_iter()
            .enumerate()
            .map_init(TileRasteriser::new, |rasteriser, (tile, keys)| {
                let weights = rasteriser.rasterise(&scene, tile, keys);
                (keep(weights), read_tile(weights))
            })
            .unzip();
        let weights = BlendWeights { width: grid.width, height: grid.height, tiles, tile_columns: grid.columns.max(1) };
        (Self { camera: *camera, grid, gaussian_count: gaussians.count(), splats, weights }, found)
    }

    /// Per tile (row-major), the pixels at which a Gaussian appended to `gaussians` since the view was made could have
    /// an alpha of at least `alpha` and is nearer than `surface` (z-depth in metres, `[height, width]`).
    ///
    /// With the minimum blended alpha and an infinite surface, the view's weights stay valid for all Gaussians at all
    /// other pixels.
    ///
    /// # Panics
    /// If `surface` has another size than the view.
    pub fn pixels_touched_since(
        &self,
        gaussians: &(impl Splats + ?Sized),
        surface: &Image<f32>,
        alpha: f32,
    ) -> Vec<PixelSet> {
        assert_eq!(surface.size(), (self.grid.width, self.grid.height), "the surface's size");
        let added = project(gaussians, self.gaussian_count, &self.camera);
        let reach = Reach { surface, alpha, min_alpha: self.camera.limits.min_alpha };
        touched_pixels(&self.grid, &added, &reach)
    }

    /// The weights above `min_weight` at the pixels `chosen` (one set per tile, row-major).
    ///
    /// # Panics
    /// If there is not one set per tile.
    pub fn active_weights(&self, chosen: &[PixelSet], min_weight: f32) -> ActiveWeights {
        assert_eq!(chosen.len(), self.weights.tiles.len(), "one pixel set per tile");
        let tiles: Vec<ActiveTile> = chosen
            .par_iter()
            .zip(&self.weights.tiles)
            .enumerate()
            .filter(|(_, (pixels, _))| !pixels.is_empty())
            .map(|(tile, (pixels, weights))| ActiveTile::new(tile, *pixels, weights.restricted(pixels, min_weight)))
            .collect();
        ActiveWeights::new(tiles, &self.weights.tiles, self.gaussian_count)
    }

    /// Replaces the camera by the same camera in new coordinates, after the Gaussians were moved to them.
    pub fn set_camera(&mut self, camera: Camera) {
        self.camera = camera;
    }

    /// The camera of the view.
    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    /// The blend weights of all Gaussians.
    pub fn weights(&self) -> &BlendWeights {
        &self.weights
    }

    /// The Gaussians that can touch the image, by increasing index.
    pub fn projected(&self) -> &[ProjectedGaussian] {
        &self.splats
    }
}
