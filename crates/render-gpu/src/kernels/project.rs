//! From balls to 2D Gaussians on the image: the rule of `splatseg_render`'s `projection.rs`.

use super::camera::{Point, View, to_camera};
use super::sight::{PAIR_COUNT, SEEN_COUNT, THROUGH, THROUGH_COUNT, VISIBLE_COUNT, is_through_believed};
use cubecl::prelude::*;

/// Numbers of a projected Gaussian: centre (2), inverse covariance (3), depth, half width and half height of its box.
pub(crate) const NUMBERS: usize = 8;

/// Pixels a side of a tile.
pub(crate) const TILE: u32 = 16;

/// A Gaussian as the image sees it.
#[derive(CubeType, Clone, Copy)]
pub(crate) struct Splat {
    pub x: f32,
    pub y: f32,
    pub a: f32,
    pub b: f32,
    pub c: f32,
    pub depth: f32,
    pub half_width: f32,
    pub half_height: f32,
    pub is_visible: bool,
}

/// Inclusive ranges of tiles.
#[derive(CubeType, Clone, Copy)]
pub(crate) struct TileBox {
    pub left: u32,
    pub right: u32,
    pub top: u32,
    pub bottom: u32,
}

#[cube]
fn clamped(value: f32, low: f32, high: f32) -> f32 {
    let above = select(value < low, low, value);
    select(above > high, high, above)
}

/// Projects an opaque ball at `center`, camera frame.
#[cube]
pub(crate) fn project(center: Point, radius: f32, view: &View) -> Splat {
    let z = center.z;
    let width = f32::cast_from(view.width);
    let height = f32::cast_from(view.height);
    let x = view.fx * center.x / z + view.cx;
    let y = view.fy * center.y / z + view.cy;
    let corner_x = view.cx + 0.5;
    let corner_y = view.cy + 0.5;
    let margin_x = 0.15 * width / view.fx;
    let margin_y = 0.15 * height / view.fy;
    let tx = z * clamped(center.x / z, -(corner_x / view.fx + margin_x), (width - corner_x) / view.fx + margin_x);
    let ty = z * clamped(center.y / z, -(corner_y / view.fy + margin_y), (height - corner_y) / view.fy + margin_y);
    let xx = view.fx / z;
    let xz = -view.fx * tx / (z * z);
    let yy = view.fy / z;
    let yz = -view.fy * ty / (z * z);
    let variance = radius * radius;
    let covariance_xx = variance * (xx * xx + xz * xz) + view.low_pass;
    let covariance_xy = variance * (xz * yz);
    let covariance_yy = variance * (yy * yy + yz * yz) + view.low_pass;
    let half_width = view.deviations * f32::sqrt(covariance_xx);
    let half_height = view.deviations * f32::sqrt(covariance_yy);
    let determinant = covariance_xx * covariance_yy - covariance_xy * covariance_xy;
    let is_in_range = z > view.near_plane && z < view.far_plane;
    let is_inside = x + half_width > -0.5f32
        && x - half_width < width - 0.5
        && y + half_height > -0.5f32
        && y - half_height < height - 0.5;
    Splat {
        x,
        y,
        a: covariance_yy / determinant,
        b: -covariance_xy / determinant,
        c: covariance_xx / determinant,
        depth: z,
        half_width,
        half_height,
        is_visible: is_in_range && is_inside && determinant > 0.0,
    }
}

#[cube]
fn tile_of(pixel: f32, tiles: u32) -> u32 {
    let last = tiles - 1;
    // Far outside on either side is the first or the last tile.
    let inside = clamped(pixel, 0.0, f32::cast_from(tiles * TILE));
    let tile = u32::cast_from(inside) / TILE;
    select(tile < last, tile, last)
}

/// The tiles that the box of a projected Gaussian touches.
#[cube]
pub(crate) fn touched(x: f32, y: f32, half_width: f32, half_height: f32, view: &View) -> TileBox {
    TileBox {
        left: tile_of(x - half_width, view.columns),
        right: tile_of(x + half_width, view.columns),
        top: tile_of(y - half_height, view.rows),
        bottom: tile_of(y + half_height, view.rows),
    }
}

/// Marks the Gaussians that can touch the image, and counts them and the tiles that they touch. `hides_through` is 1 if
/// what the frame sees through is left out.
#[cube(launch)]
pub(crate) fn mark_visible(
    balls: &[f32],
    sights: &[u32],
    visible: &mut [u32],
    counters: &[Atomic<u32>],
    view: View,
    hides_through: u32,
    is_confirmed: u32,
    count: u32,
) {
    let gaussian = ABSOLUTE_POS;
    if gaussian >= count as usize {
        terminate!();
    }
    let mut is_visible = 0u32;
    let is_believed = is_through_believed(counters[SEEN_COUNT].load(), counters[THROUGH_COUNT].load(), is_confirmed);
    let is_gone = hides_through == 1 && is_believed && sights[gaussian] == THROUGH;
    if !is_gone {
        let splat = project(to_camera(balls, gaussian, &view), balls[gaussian * 4 + 3], &view);
        if splat.is_visible {
            is_visible = 1u32;
            let tiles = touched(splat.x, splat.y, splat.half_width, splat.half_height, &view);
            let count = (tiles.right + 1 - tiles.left) * (tiles.bottom + 1 - tiles.top);
            counters[VISIBLE_COUNT].fetch_add(1u32);
            counters[PAIR_COUNT].fetch_add(count);
        }
    }
    visible[gaussian] = is_visible;
}

/// Projects the visible Gaussians to their `places` among themselves: `splats` `[visible, 8]`, which Gaussian each is, and
/// its depth as a sort key with its place as the value. (The bits of positive floats increase with their value.)
#[cube(launch)]
pub(crate) fn project_visible(
    balls: &[f32],
    visible: &[u32],
    places: &[u32],
    splats: &mut [f32],
    gaussians: &mut [u32],
    keys: &mut [u32],
    values: &mut [u32],
    view: View,
    count: u32,
) {
    let gaussian = ABSOLUTE_POS;
    if gaussian >= count as usize {
        terminate!();
    }
    if visible[gaussian] == 1 {
        let place = places[gaussian] as usize;
        let splat = project(to_camera(balls, gaussian, &view), balls[gaussian * 4 + 3], &view);
        splats[place * NUMBERS] = splat.x;
        splats[place * NUMBERS + 1] = splat.y;
        splats[place * NUMBERS + 2] = splat.a;
        splats[place * NUMBERS + 3] = splat.b;
        splats[place * NUMBERS + 4] = splat.c;
        splats[place * NUMBERS + 5] = splat.depth;
        splats[place * NUMBERS + 6] = splat.half_width;
        splats[place * NUMBERS + 7] = splat.half_height;
        gaussians[place] = gaussian as u32;
        keys[place] = u32::reinterpret(splat.depth);
        values[place] = place as u32;
    }
}
