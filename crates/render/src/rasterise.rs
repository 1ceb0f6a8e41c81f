//! Alpha blending inside one tile: computes the weight of each Gaussian at each pixel.

use crate::camera::RasterLimits;
use crate::tile_weights::LANES;
use crate::tiles::{DepthKey, TILE, TileGrid};
use crate::{ProjectedGaussian, TileWeights};
use splatseg_kernels::exp::exp_negative;
use splatseg_kernels::{Instructions, Vectorize};

const PIXELS: usize = TILE * TILE;
/// Number of Gaussians fetched ahead of their blending.
const AHEAD: usize = 32;

const LANE_OFFSETS: [f32; LANES] = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0];

/// The projected Gaussians and settings of a view.
pub(crate) struct Scene<'a> {
    pub grid: &'a TileGrid,
    pub splats: &'a [ProjectedGaussian],
    pub limits: &'a RasterLimits,
}

/// Working memory for rasterising tiles, reused from tile to tile.
pub(crate) struct TileRasteriser {
    /// Transmittance while more Gaussians can be blended at the pixel, 0 when it is finished or outside the image.
    light: [f32; PIXELS],
    /// One bit per column of each row is set where `light` is not 0.
    live_columns: [u32; TILE],
    /// Bit `r` is set while row `r` has a live pixel.
    live_rows: u32,
    weights: TileWeights,
}

impl TileRasteriser {
    pub fn new() -> Self {
        Self { light: [0.0; PIXELS], live_columns: [0; TILE], live_rows: 0, weights: TileWeights::empty(0, 0, 0, 0) }
    }

    /// Blends the Gaussians `keys`, front to back, into tile number `tile`.
    pub fn rasterise(&mut self, scene: &Scene<'_>, tile: usize, keys: &[DepthKey]) -> &TileWeights {
        let grid = scene.grid;
        let left = tile % grid.columns * TILE;
        let top = tile / grid.columns * TILE;
        let (width, height) = ((grid.width - left).min(TILE), (grid.height - top).min(TILE));
        self.clear(width, height);
        self.weights.restart(left, top, width, height);
        Instructions::best().run(BlendAll { rasteriser: self, scene, keys });
        &self.weights
    }

    fn clear(&mut self, width: usize, height: usize) {
        self.light = [0.0; PIXELS];
        self.live_columns = [0; TILE];
        self.live_rows = (1 << height) - 1;
        for row in 0..height {
            self.light[row * TILE..row * TILE + width].fill(1.0);
            self.live_columns[row] = (1 << width) - 1;
        }
    }

    /// Blends one Gaussian over the pixels of its box and appends its non-zero weights.
    #[inline(always)]
    fn blend(&mut self, splat: &ProjectedGaussian, limits: &RasterLimits) {
        // In tile coordinates, with a small margin because the box was rounded.
        let x = splat.mean.x - self.weights.left as f32;
        let y = splat.mean.y - self.weights.top as f32;
        let reach_x = splat.half_extent.x + 0.01;
        let reach_y = splat.half_extent.y + 0.01;
        let last = (TILE - 1) as f32;
        if x + reach_x < 0.0 || x - reach_x > last || y + reach_y < 0.0 || y - reach_y > last {
            return;
        }
        // Casts to integers round towards zero and saturate: lower bounds are rounded up, upper ones down.
        let first_column = (x - reach_x + 1.0).max(0.0) as usize;
        let last_column = (x + reach_x).min(last) as usize;
        let first_row = (y - reach_y + 1.0).max(0.0) as usize;
        let last_row = (y + reach_y).min(last) as usize;
        // A window of eight pixels, placed inside the tile, covers most boxes; wider boxes use the whole row.
        let window = first_column.min(TILE - LANES);
        let starts: &[usize] = if last_column < window + LANES { &[window] } else { &[0, LANES] };
        let columns = ((2u32 << last_column) - 1) & !((1 << first_column) - 1);
        for row in first_row..=last_row {
            // Skips finished rows: behind the nearest surfaces, most pixels are finished.
            if self.live_columns[row] & columns != 0 {
                for start in starts {
                    let weights = self.blend_lanes(splat, [x, y], [*start, row], limits);
                    self.weights.push_run(row * TILE + start, &weights);
                }
            }
        }
        self.weights.finish_column(splat.gaussian, splat.depth);
    }

    /// Blends one Gaussian over [`LANES`] pixels of a row and returns its weights there. Branch-free, so that the
    /// compiler vectorises it.
    #[inline(always)]
    fn blend_lanes(
        &mut self,
        splat: &ProjectedGaussian,
        mean: [f32; 2],
        [start, row]: [usize; 2],
        limits: &RasterLimits,
    ) -> [f32; LANES] {
        let [a, b, c] = splat.conic;
        let dy = mean[1] - row as f32;
        let from_start = mean[0] - start as f32;
        let mut alpha = [0f32; LANES];
        for (lane, alpha) in alpha.iter_mut().enumerate() {
            let dx = from_start - LANE_OFFSETS[lane];
            let sigma = 0.5 * (a * dx * dx + c * dy * dy) + b * dx * dy;
            let unbounded = splat.opacity * exp_negative(sigma);
            let bounded = if unbounded < limits.max_alpha { unbounded } else { limits.max_alpha };
            // Zero means "skipped"; a NaN sigma is skipped too.
            *alpha = if (sigma >= 0.0) & (bounded >= limits.min_alpha) { bounded } else { 0.0 };
        }
        let light = lanes(&mut self.light, row * TILE + start);
        let (before, mut after, mut weights) = (*light, [0f32; LANES], [0f32; LANES]);
        for lane in 0..LANES {
            let next = before[lane] * (1.0 - alpha[lane]);
            // Live pixels have more light than the minimum, finished ones have none.
            after[lane] = if next > limits.min_transmittance { next } else { 0.0 };
            weights[lane] = if next > limits.min_transmittance { alpha[lane] * before[lane] } else { 0.0 };
        }
        *light = after;
        let mut finished = 0;
        for lane in 0..LANES {
            finished |= if after[lane] == 0.0 { before[lane].to_bits() } else { 0 };
        }
        if finished != 0 {
            self.update_live_bits(start, row);
        }
        weights
    }

    /// Updates the bits of live pixels after some pixels of a window have finished.
    fn update_live_bits(&mut self, start: usize, row: usize) {
        for column in start..start + LANES {
            if self.light[row * TILE + column] == 0.0 {
                self.live_columns[row] &= !(1 << column);
            }
        }
        if self.live_columns[row] == 0 {
            self.live_rows &= !(1 << row);
        }
    }
}

/// The blending of one tile.
struct BlendAll<'a> {
    rasteriser: &'a mut TileRasteriser,
    scene: &'a Scene<'a>,
    keys: &'a [DepthKey],
}

impl Vectorize for BlendAll<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        // The Gaussians of a tile are scattered in memory: copying some ahead lets the processor fetch them in
        // parallel.
        let mut ahead = [ProjectedGaussian::default(); AHEAD];
        for keys in self.keys.chunks(AHEAD) {
            if self.rasteriser.live_rows == 0 {
                break;
            }
            for (splat, key) in ahead.iter_mut().zip(keys) {
                *splat = self.scene.splats[(key & 0xffff_ffff) as usize];
            }
            for splat in &ahead[..keys.len()] {
                self.rasteriser.blend(splat, self.scene.limits);
            }
        }
    }
}

/// The [`LANES`] pixels starting at `from`, with a length known at compile time.
#[inline(always)]
fn lanes(pixels: &mut [f32; PIXELS], from: usize) -> &mut [f32; LANES] {
    // A window of lanes ends inside its row, so the range always exists.
    pixels[from..].first_chunk_mut().expect("a window of lanes ends inside the tile")
}
