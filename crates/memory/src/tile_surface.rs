//! Surfaces of a frame and of the map in one tile, without segments.

use crate::MemorySettings;
use splatseg_geometry::CowImage;
use splatseg_kernels::{Instructions, Vectorize};
use splatseg_render::TileWeights;

/// Pixels of a tile.
const PIXELS: usize = TileWeights::PIXELS;

/// Pixels of a run.
pub(crate) const RUN: usize = TileWeights::RUN;

/// Surfaces of the frame and of the map in one tile, without segments. Buffers are `[16, 16]`.
#[derive(Clone, Debug)]
pub struct TileSurface {
    /// Accumulated alpha.
    pub silhouette: [f32; PIXELS],
    /// Rendered z-depth, metres, divided by the silhouette.
    pub depth: [f32; PIXELS],
    /// The frame's z-depth, metres, 0 where missing.
    pub observed: [f32; PIXELS],
    /// Accumulated alpha of the Gaussians up to the frame's own surface; of all where depth is missing.
    pub covered: [f32; PIXELS],
}

/// Depths that are those of the frame's own surface at each pixel of a tile: between `nearest` and `farthest`, metres, `[16, 16]`.
/// Where the frame has no depth, all are.
pub(crate) struct SurfaceDepths {
    nearest: [f32; PIXELS],
    farthest: [f32; PIXELS],
}

impl SurfaceDepths {
    /// From the frame's z-depths in a tile, metres, 0 where missing.
    pub fn new(observed: &[f32; PIXELS], settings: &MemorySettings) -> Self {
        let (mut nearest, mut farthest) = ([f32::NEG_INFINITY; PIXELS], [f32::INFINITY; PIXELS]);
        for ((nearest, farthest), depth) in nearest.iter_mut().zip(&mut farthest).zip(observed) {
            let tolerance = settings.tolerance_at(*depth);
            *nearest = if *depth > 0.0 { depth - tolerance } else { *nearest };
            *farthest = if *depth > 0.0 { depth + tolerance } else { *farthest };
        }
        Self { nearest, farthest }
    }

    /// Of the weights of a run of a Gaussian at this depth, those at pixels where it belongs to the frame's surface; 0 at
    /// the others.
    #[inline(always)]
    pub fn seen(&self, first: u8, depth: f32, weights: &[f32; RUN]) -> [f32; RUN] {
        let (nearest, farthest, mut seen) = (*run(&self.nearest, first), *run(&self.farthest, first), *weights);
        for lane in 0..RUN {
            let is_seen = (depth >= nearest[lane]) & (depth <= farthest[lane]);
            seen[lane] = if is_seen { seen[lane] } else { 0.0 };
        }
        seen
    }

    /// Of the same weights, those at pixels where it lies in front of the frame's surface.
    #[inline(always)]
    pub fn in_front(&self, first: u8, depth: f32, weights: &[f32; RUN]) -> [f32; RUN] {
        let (nearest, mut in_front) = (*run(&self.nearest, first), *weights);
        for lane in 0..RUN {
            in_front[lane] = if depth < nearest[lane] { in_front[lane] } else { 0.0 };
        }
        in_front
    }
}

/// True if a weight of a run is not 0.
#[inline(always)]
pub(crate) fn any(weights: &[f32; RUN]) -> bool {
    let mut bits = 0;
    for weight in weights {
        bits |= weight.to_bits();
    }
    bits != 0
}

/// The values at the pixels of the run of a [`TileWeights`] that starts at `first`.
#[inline(always)]
pub(crate) fn run<T>(pixels: &[T; PIXELS], first: u8) -> &[T; RUN] {
    pixels[usize::from(first)..].first_chunk().expect("a run ends inside its tile")
}

/// As [`run`].
#[inline(always)]
pub(crate) fn run_mut<T>(pixels: &mut [T; PIXELS], first: u8) -> &mut [T; RUN] {
    pixels[usize::from(first)..].first_chunk_mut().expect("a run ends inside its tile")
}

/// Copies a tile's part of an image, `[16, 16]`; the default value beyond the image.
pub(crate) fn cut<T: Copy + Default>(tile: &TileWeights, image: &CowImage<'_, T>) -> [T; PIXELS] {
    let ((left, top), (width, height)) = (tile.origin(), tile.size());
    let mut part = [T::default(); PIXELS];
    for row in 0..height {
        let from = row * TileWeights::SIDE;
        part[from..from + width].copy_from_slice(&image.row(top + row)[left..left + width]);
    }
    part
}

impl TileSurface {
    pub(crate) fn read(tile: &TileWeights, observed: &CowImage<'_, f32>, settings: &MemorySettings) -> Self {
        let observed = cut(tile, observed);
        let depths = SurfaceDepths::new(&observed, settings);
        let mut surface = Self { silhouette: [0.0; PIXELS], depth: [0.0; PIXELS], covered: [0.0; PIXELS], observed };
        Instructions::best().run(AddAll { surface: &mut surface, tile, depths: &depths });
        surface
    }
}

/// Sums of the weights of all Gaussians of a tile.
struct AddAll<'a> {
    surface: &'a mut TileSurface,
    tile: &'a TileWeights,
    depths: &'a SurfaceDepths,
}

impl Vectorize for AddAll<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { surface, tile, depths } = self;
        for column in 0..tile.depths().len() {
            let own = tile.depths()[column];
            let (firsts, weights) = tile.runs(column);
            for index in 0..firsts.len().min(weights.len()) {
                let (first, weights) = (firsts[index], weights[index]);
                let farthest = *run(&depths.farthest, first);
                let mut silhouette = *run(&surface.silhouette, first);
                let mut depth = *run(&surface.depth, first);
                let mut covered = *run(&surface.covered, first);
                for lane in 0..RUN {
                    silhouette[lane] += weights[lane];
                    depth[lane] += weights[lane] * own;
                    covered[lane] += if own <= farthest[lane] { weights[lane] } else { 0.0 };
                }
                *run_mut(&mut surface.silhouette, first) = silhouette;
                *run_mut(&mut surface.depth, first) = depth;
                *run_mut(&mut surface.covered, first) = covered;
            }
        }
        for (depth, silhouette) in surface.depth.iter_mut().zip(&surface.silhouette) {
            *depth = if *silhouette > 0.0 { *depth / silhouette } else { 0.0 };
        }
    }
}
