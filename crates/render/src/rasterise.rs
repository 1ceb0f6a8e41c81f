//! Alpha blending inside one tile: which Gaussian has which weight at which pixel.

use crate::camera::RasterLimits;
use crate::tiles::{DepthKey, TILE, TileGrid};
use crate::{ProjectedGaussian, TileWeights};
use pulp::Arch;

const PIXELS: usize = TILE * TILE;
/// Pixels of a row that are blended together. Most Gaussians of an RGB-D map are narrower.
const LANES: usize = 8;

/// Working memory for rasterising tiles, reused from tile to tile.
pub(crate) struct TileRasteriser {
    transmittance: [f32; PIXELS],
    /// 1 while the pixel takes Gaussians, 0 when it is finished or outside the image.
    live: [f32; PIXELS],
    /// Bit `r` is set while row `r` has a live pixel.
    live_rows: u32,
    gaussians: Vec<u32>,
    depths: Vec<f32>,
    weight_sums: Vec<f32>,
    offsets: Vec<u32>,
    pixels: Vec<u8>,
    weights: Vec<f32>,
}

impl TileRasteriser {
    pub fn new() -> Self {
        Self {
            transmittance: [1.0; PIXELS],
            live: [1.0; PIXELS],
            live_rows: 0,
            gaussians: Vec::new(),
            depths: Vec::new(),
            weight_sums: Vec::new(),
            offsets: Vec::new(),
            pixels: Vec::new(),
            weights: Vec::new(),
        }
    }

    /// Blends the Gaussians `keys`, front to back, into tile number `tile`.
    pub fn rasterise(
        &mut self,
        grid: &TileGrid,
        tile: usize,
        keys: &[DepthKey],
        splats: &[ProjectedGaussian],
        limits: &RasterLimits,
    ) -> TileWeights {
        let left = tile % grid.columns * TILE;
        let top = tile / grid.columns * TILE;
        let (width, height) = ((grid.width - left).min(TILE), (grid.height - top).min(TILE));
        self.clear(width, height);
        Arch::new().dispatch(|| {
            for key in keys {
                if self.live_rows == 0 {
                    break;
                }
                self.blend(&splats[(key & 0xffff_ffff) as usize], left, top, limits);
            }
        });
        TileWeights {
            left,
            top,
            width,
            height,
            gaussians: self.gaussians.clone(),
            depths: self.depths.clone(),
            weight_sums: self.weight_sums.clone(),
            offsets: self.offsets.clone(),
            pixels: self.pixels.clone(),
            weights: self.weights.clone(),
        }
    }

    fn clear(&mut self, width: usize, height: usize) {
        self.transmittance = [1.0; PIXELS];
        for (pixel, live) in self.live.iter_mut().enumerate() {
            *live = if pixel % TILE < width && pixel / TILE < height { 1.0 } else { 0.0 };
        }
        self.live_rows = (1 << height) - 1;
        self.gaussians.clear();
        self.depths.clear();
        self.weight_sums.clear();
        self.pixels.clear();
        self.weights.clear();
        self.offsets.clear();
        self.offsets.push(0);
    }

    /// Blends one Gaussian over the pixels of its box and keeps its weights, if it has any.
    #[inline(always)]
    fn blend(&mut self, splat: &ProjectedGaussian, left: usize, top: usize, limits: &RasterLimits) {
        // In the tile's own pixels; a small margin, because the box was rounded.
        let x = splat.mean.x - left as f32;
        let y = splat.mean.y - top as f32;
        let reach_x = splat.half_extent.x + 0.01;
        let reach_y = splat.half_extent.y + 0.01;
        let last = (TILE - 1) as f32;
        if x + reach_x < 0.0 || x - reach_x > last || y + reach_y < 0.0 || y - reach_y > last {
            return;
        }
        let first_column = (x - reach_x).ceil().max(0.0) as usize;
        let last_column = (x + reach_x).floor().min(last) as usize;
        let first_row = (y - reach_y).ceil().max(0.0) as usize;
        let last_row = (y + reach_y).floor().min(last) as usize;
        let before = self.weights.len();
        // Eight pixels cover most boxes if they start early enough to end inside the tile; others take the whole row.
        let window = first_column.min(TILE - LANES);
        let starts: &[usize] = if last_column < window + LANES { &[window] } else { &[0, LANES] };
        for row in first_row..=last_row {
            if self.live_rows >> row & 1 == 1 {
                for start in starts {
                    self.blend_lanes(splat, [x, y], [*start, row], limits);
                }
            }
        }
        if self.weights.len() > before {
            self.gaussians.push(splat.gaussian);
            self.depths.push(splat.depth);
            self.weight_sums.push(self.weights[before..].iter().sum());
            self.offsets.push(self.weights.len() as u32);
        }
    }

    /// Blends one Gaussian over [`LANES`] pixels of a row, without branches so that the compiler vectorises it.
    #[inline(always)]
    fn blend_lanes(&mut self, splat: &ProjectedGaussian, mean: [f32; 2], at: [usize; 2], limits: &RasterLimits) {
        let [start, row] = at;
        let from = row * TILE + start;
        let [a, b, c] = splat.conic;
        let dy = mean[1] - row as f32;
        let transmittance: &mut [f32] = &mut self.transmittance[from..from + LANES];
        let live: &mut [f32] = &mut self.live[from..from + LANES];
        let mut weights = [0f32; LANES];
        let mut stopped = 0f32;
        for lane in 0..LANES {
            let dx = mean[0] - (start + lane) as f32;
            let sigma = 0.5 * (a * dx * dx + c * dy * dy) + b * dx * dy;
            let alpha = (splat.opacity * exp_negative(sigma)).min(limits.max_alpha);
            let taken = sigma >= 0.0 && alpha >= limits.min_alpha && live[lane] > 0.0;
            let next = transmittance[lane] * (1.0 - alpha);
            let stops = next <= limits.min_transmittance;
            let blended = taken & !stops;
            weights[lane] = if blended { alpha * transmittance[lane] } else { 0.0 };
            transmittance[lane] = if blended { next } else { transmittance[lane] };
            let stop = if taken & stops { 1.0 } else { 0.0 };
            live[lane] -= stop;
            stopped += stop;
        }
        if stopped > 0.0 && self.live[row * TILE..(row + 1) * TILE].iter().all(|live| *live == 0.0) {
            self.live_rows &= !(1 << row);
        }
        self.keep(&weights, from);
    }

    /// Appends the weights that are not zero.
    #[inline(always)]
    fn keep(&mut self, weights: &[f32; LANES], from: usize) {
        let kept = self.weights.len();
        self.weights.resize(kept + LANES, 0.0);
        self.pixels.resize(kept + LANES, 0);
        let mut end = kept;
        for (lane, weight) in weights.iter().enumerate() {
            self.weights[end] = *weight;
            self.pixels[end] = (from + lane) as u8;
            end += usize::from(*weight > 0.0);
        }
        self.weights.truncate(end);
        self.pixels.truncate(end);
    }
}

/// e^-x for x ≥ 0 to 6e-7, relative; from plain products, so that every machine gives the same bits.
#[inline(always)]
fn exp_negative(x: f32) -> f32 {
    // 2^-y with y = n + f, |f| <= 1/2; below 2^-30 nothing can be blended.
    let y = (x * std::f32::consts::LOG2_E).clamp(0.0, 30.0);
    let n = (y + 0.5).floor();
    let t = (n - y) * std::f32::consts::LN_2;
    let series = 1.0 / 720.0;
    let series = series * t + 1.0 / 120.0;
    let series = series * t + 1.0 / 24.0;
    let series = series * t + 1.0 / 6.0;
    let series = series * t + 0.5;
    let series = series * t + 1.0;
    let series = series * t + 1.0;
    series * f32::from_bits(((127 - n as i32) as u32) << 23)
}

#[cfg(test)]
mod tests {
    use super::exp_negative;

    #[test]
    fn the_exponential_is_accurate() {
        for step in 0..60_000 {
            let x = step as f32 * 1e-4;
            let relative = (f64::from(exp_negative(x)) / (-f64::from(x)).exp() - 1.0).abs();
            assert!(relative < 6e-7, "exp(-{x}) is off by {relative}");
        }
        assert!(exp_negative(1e30) < 1e-8 && exp_negative(f32::INFINITY) < 1e-8);
    }
}
