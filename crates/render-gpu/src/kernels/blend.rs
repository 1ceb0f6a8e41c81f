//! Alpha blending inside one tile: the rule of `splatseg_render`'s `rasterise.rs`, with one thread per pixel.

use super::camera::View;
use super::exp::exp_negative;
use super::project::{NUMBERS, TILE};
use cubecl::prelude::*;

/// Pixels, and threads, of a tile.
pub(crate) const PIXELS: usize = 256;

/// Numbers of a Gaussian in a tile's shared memory: centre in the tile (2), inverse covariance (3), depth.
pub(crate) const STAGED: usize = 6;

/// A thread's pixel.
#[derive(CubeType, Clone, Copy)]
pub(crate) struct Pixel {
    /// Position in the tile.
    pub column: u32,
    pub row: u32,
    /// Row-major position in the image.
    pub index: usize,
    pub is_inside: bool,
}

/// The pixel of this thread in tile number `tile`.
#[cube]
pub(crate) fn pixel_of(tile: u32, view: &View) -> Pixel {
    let column = UNIT_POS % TILE;
    let row = UNIT_POS / TILE;
    let x = tile % view.columns * TILE + column;
    let y = tile / view.columns * TILE + row;
    Pixel { column, row, index: (y * view.width + x) as usize, is_inside: x < view.width && y < view.height }
}

/// Puts a projected Gaussian into `slot` of the shared memory of tile number `tile`.
///
/// `boxes` gets the pixels that it can touch, in bits: first and last column, first and last row (5 each), the first of the
/// eight columns that the CPU blends together (5), whether these are all, and whether it touches the tile at all.
#[cube]
pub(crate) fn stage(
    splats: &[f32],
    splat: usize,
    tile: u32,
    view: &View,
    staged: &mut Shared<[f32]>,
    boxes: &mut Shared<[u32]>,
    slot: usize,
) {
    let at = splat * NUMBERS;
    let x = splats[at] - f32::cast_from(tile % view.columns * TILE);
    let y = splats[at + 1] - f32::cast_from(tile / view.columns * TILE);
    let reach_x = splats[at + 6] + 0.01;
    let reach_y = splats[at + 7] + 0.01;
    let last = 15.0f32;
    let mut bits = 0u32;
    if x + reach_x >= 0.0 && x - reach_x <= last && y + reach_y >= 0.0 && y - reach_y <= last {
        let first_column = u32::cast_from(at_least_zero(x - reach_x + 1.0));
        let last_column = u32::cast_from(at_most(x + reach_x, last));
        let first_row = u32::cast_from(at_least_zero(y - reach_y + 1.0));
        let last_row = u32::cast_from(at_most(y + reach_y, last));
        let window = select(first_column < 8u32, first_column, 8u32);
        let is_single = select(last_column < window + 8u32, 1u32, 0u32);
        bits = first_column
            | (last_column << 5u32)
            | (first_row << 10u32)
            | (last_row << 15u32)
            | (window << 20u32)
            | (is_single << 25u32)
            | (1u32 << 26u32);
    }
    staged[slot * STAGED] = x;
    staged[slot * STAGED + 1] = y;
    staged[slot * STAGED + 2] = splats[at + 2];
    staged[slot * STAGED + 3] = splats[at + 3];
    staged[slot * STAGED + 4] = splats[at + 4];
    staged[slot * STAGED + 5] = splats[at + 5];
    boxes[slot] = bits;
}

#[cube]
fn at_least_zero(value: f32) -> f32 {
    select(value > 0.0, value, 0.0)
}

#[cube]
fn at_most(value: f32, max: f32) -> f32 {
    select(value < max, value, max)
}

/// The alpha of the Gaussian in `slot` at a pixel, 0 where it is skipped.
#[cube]
pub(crate) fn alpha_at(staged: &Shared<[f32]>, boxes: &Shared<[u32]>, slot: usize, pixel: &Pixel, view: &View) -> f32 {
    let bits = boxes[slot];
    let mut alpha = 0.0f32;
    let is_touched = (bits >> 26u32) == 1
        && pixel.column >= (bits & 31)
        && pixel.column <= ((bits >> 5u32) & 31)
        && pixel.row >= ((bits >> 10u32) & 31)
        && pixel.row <= ((bits >> 15u32) & 31);
    if is_touched {
        // The CPU subtracts the start of its eight columns first; the roundings are to be the same.
        let is_single = ((bits >> 25u32) & 1) == 1;
        let half = select(pixel.column >= 8u32, 8u32, 0u32);
        let start = select(is_single, (bits >> 20u32) & 31, half);
        let dx = (staged[slot * STAGED] - f32::cast_from(start)) - f32::cast_from(pixel.column - start);
        let dy = staged[slot * STAGED + 1] - f32::cast_from(pixel.row);
        let a = staged[slot * STAGED + 2];
        let b = staged[slot * STAGED + 3];
        let c = staged[slot * STAGED + 4];
        let sigma = 0.5 * (a * dx * dx + c * dy * dy) + b * dx * dy;
        if sigma >= 0.0 {
            let bounded = at_most(exp_negative(sigma), view.max_alpha);
            if bounded >= view.min_alpha {
                alpha = bounded;
            }
        }
    }
    alpha
}

/// The first place of a tile, row by row, at which a Gaussian with this box can have a weight.
#[cube]
pub(crate) fn first_place(bits: u32) -> u32 {
    ((bits >> 10u32) & 31) * TILE
}

/// The place behind the last one.
#[cube]
pub(crate) fn end_place(bits: u32) -> u32 {
    (((bits >> 15u32) & 31) + 1) * TILE
}

/// What is left of the light behind the Gaussians that a pixel has blended.
#[derive(CubeType)]
pub(crate) struct Transmittance {
    pub value: f32,
    /// Whether the pixel takes more Gaussians.
    pub is_live: bool,
}

/// Blends a Gaussian of this alpha behind the others; returns its weight, 0 if it is not blended.
#[cube]
pub(crate) fn blend(alpha: f32, behind: &mut Transmittance, view: &View) -> f32 {
    let mut weight = 0.0f32;
    if alpha > 0.0 {
        let next = behind.value * (1.0 - alpha);
        if next <= view.min_transmittance {
            behind.is_live = false;
        } else {
            weight = alpha * behind.value;
            behind.value = next;
        }
    }
    weight
}
