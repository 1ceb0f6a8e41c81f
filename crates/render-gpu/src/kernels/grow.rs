//! Where a frame shows a surface that the map lacks: new Gaussians (`splatseg_memory`'s `growth.rs`).

use super::borders::{MAX_DISTANCE, REFUSED, WANTED};
use super::camera::{View, round_half_up};
use super::forget::GROWN;
use cubecl::prelude::*;

/// Farther than any depth.
const FAR: f32 = 3e38;

/// The settings of the memory that growth depends on; see `splatseg_memory::MemorySettings`.
#[derive(CubeLaunch, CubeType, Clone, Copy)]
pub(crate) struct GrowthRuleValues {
    /// 1 for the paper's rule.
    pub is_paper: u32,
    pub growth_silhouette: f32,
    pub growth_coverage: f32,
    pub depth_disparity: f32,
    pub edge_disparity: f32,
    /// Largest spacing of Gaussians, pixels.
    pub spacing: u32,
    pub spacing_per_distance: f32,
    pub radius_per_spacing: f32,
}

/// From the camera to the world: rows of the rotation, and the translation.
#[derive(CubeLaunch, CubeType, Clone, Copy)]
pub(crate) struct WorldFromCamera {
    pub xx: f32,
    pub xy: f32,
    pub xz: f32,
    pub yx: f32,
    pub yy: f32,
    pub yz: f32,
    pub zx: f32,
    pub zy: f32,
    pub zz: f32,
    pub x: f32,
    pub y: f32,
    pub z: f32,
}

/// A square of pixels and what it asks for.
#[derive(CubeType, Clone, Copy)]
struct Block {
    left: u32,
    top: u32,
    right: u32,
    bottom: u32,
    wanting: u32,
    /// Whether one Gaussian may stand for it.
    is_uniform: bool,
}

/// Looks at the pixels of a square.
#[cube]
fn block_at(
    wanted: &[u32],
    distances: &[u32],
    depth: &[f32],
    left: u32,
    top: u32,
    side: u32,
    view: &View,
    rule: &GrowthRuleValues,
) -> Block {
    let right = select(left + side < view.width, left + side, view.width);
    let bottom = select(top + side < view.height, top + side, view.height);
    let mut wanting = 0u32;
    let mut refuses = false;
    let mut distance = MAX_DISTANCE.runtime();
    let mut nearest = FAR.runtime();
    let mut farthest = 0.0f32;
    for row in top..bottom {
        for column in left..right {
            let at = (row * view.width + column) as usize;
            let here = distances[at];
            distance = select(here < distance, here, distance);
            let want = wanted[at] & 3;
            if want == REFUSED {
                refuses = true;
            }
            if want == WANTED {
                let here = depth[at];
                nearest = select(here < nearest, here, nearest);
                farthest = select(here > farthest, here, farthest);
                wanting += 1u32;
            }
        }
    }
    let is_far_from_borders = f32::cast_from(side) <= rule.spacing_per_distance * f32::cast_from(distance);
    let is_one_surface = farthest - nearest <= rule.depth_disparity;
    let is_dense = !refuses && 2 * wanting >= side * side;
    Block {
        left,
        top,
        right,
        bottom,
        wanting,
        is_uniform: side == 1 || (is_dense && is_far_from_borders && is_one_surface),
    }
}

/// Puts the quarters of a square on the pile, the last one first: what is put down last is taken up next. Returns the size
/// of the pile.
#[cube]
fn put_down_quarters(
    lefts: &mut Array<u32>,
    tops: &mut Array<u32>,
    sides: &mut Array<u32>,
    waiting: u32,
    left: u32,
    top: u32,
    half: u32,
    view: &View,
) -> u32 {
    let mut waiting = waiting;
    for quarter in 0..4u32 {
        let quarter_left = left + half * ((3 - quarter) & 1);
        let quarter_top = top + half * ((3 - quarter) >> 1u32);
        if quarter_left < view.width && quarter_top < view.height {
            lefts[waiting as usize] = quarter_left;
            tops[waiting as usize] = quarter_top;
            sides[waiting as usize] = half;
            waiting += 1u32;
        }
    }
    waiting
}

/// Goes through the squares of each largest square as a quadtree. Without `writes` it counts the new Gaussians of each in
/// `counts`; with it, it writes them behind the first `first` of the map, from the prefix sums `counts` on,
/// and the pixel of each to `pixels`.
#[cube(launch)]
pub(crate) fn grow_blocks(
    wanted: &[u32],
    distances: &[u32],
    depth: &[f32],
    color: &[u32],
    counts: &mut [u32],
    pixels: &mut [u32],
    balls: &mut [f32],
    last_seen: &mut [u32],
    seen_through: &mut [u32],
    colors: &mut [u32],
    report: &[Atomic<u32>],
    view: View,
    pose: WorldFromCamera,
    rule: GrowthRuleValues,
    frame: u32,
    first: u32,
    #[comptime] writes: bool,
) {
    let across = view.width.div_ceil(rule.spacing);
    let block = ABSOLUTE_POS as u32;
    if block >= across * view.height.div_ceil(rule.spacing) {
        terminate!();
    }
    let mut lefts = Array::<u32>::new(16usize);
    let mut tops = Array::<u32>::new(16usize);
    let mut sides = Array::<u32>::new(16usize);
    lefts[0] = block % across * rule.spacing;
    tops[0] = block / across * rule.spacing;
    sides[0] = rule.spacing;
    let mut waiting = 1u32;
    let mut count = 0u32;
    let mut to = 0usize;
    if comptime!(writes) {
        to = (first + counts[block as usize]) as usize;
    }
    while waiting > 0 {
        waiting -= 1u32;
        let left = lefts[waiting as usize];
        let top = tops[waiting as usize];
        let side = sides[waiting as usize];
        let square = block_at(wanted, distances, depth, left, top, side, &view, &rule);
        if square.wanting > 0 && square.is_uniform {
            if comptime!(writes) {
                let scale = rule.radius_per_spacing * f32::cast_from(side);
                let pixel = write_ball(wanted, depth, color, &square, balls, colors, to, &view, &pose, scale);
                pixels[to - first as usize] = pixel as u32;
                last_seen[to] = frame;
                seen_through[to] = 0u32;
                to += 1usize;
            }
            count += 1u32;
        } else if square.wanting > 0 {
            waiting = put_down_quarters(&mut lefts, &mut tops, &mut sides, waiting, left, top, side / 2, &view);
        }
    }
    if !comptime!(writes) {
        counts[block as usize] = count;
        report[GROWN].fetch_add(count);
    }
}

/// Writes the ball and the colour that stand for the wanting pixels of a square; returns the first of them.
#[cube]
fn write_ball(
    wanted: &[u32],
    depth: &[f32],
    color: &[u32],
    square: &Block,
    balls: &mut [f32],
    colors: &mut [u32],
    to: usize,
    view: &View,
    pose: &WorldFromCamera,
    scale: f32,
) -> usize {
    let mut count = 0.0f32;
    let mut x = 0.0f32;
    let mut y = 0.0f32;
    let mut z = 0.0f32;
    let mut red = 0.0f32;
    let mut green = 0.0f32;
    let mut blue = 0.0f32;
    let mut pixel = 0usize;
    for row in square.top..square.bottom {
        for column in square.left..square.right {
            let at = (row * view.width + column) as usize;
            if (wanted[at] & 3) == WANTED {
                if count == 0.0 {
                    pixel = at;
                }
                let here = depth[at];
                x += (f32::cast_from(column) - view.cx) / view.fx * here;
                y += (f32::cast_from(row) - view.cy) / view.fy * here;
                z += here;
                let bytes = color[at];
                red += f32::cast_from(bytes & 255u32);
                green += f32::cast_from((bytes >> 8u32) & 255u32);
                blue += f32::cast_from((bytes >> 16u32) & 255u32);
                count += 1.0f32;
            }
        }
    }
    let (x, y, z) = (x / count, y / count, z / count);
    balls[to * 4] = pose.xx * x + pose.xy * y + pose.xz * z + pose.x;
    balls[to * 4 + 1] = pose.yx * x + pose.yy * y + pose.yz * z + pose.y;
    balls[to * 4 + 2] = pose.zx * x + pose.zy * y + pose.zz * z + pose.z;
    balls[to * 4 + 3] = scale * z / (0.5 * (view.fx + view.fy));
    colors[to] = rounded(red / count) | (rounded(green / count) << 8u32) | (rounded(blue / count) << 16u32);
    pixel
}

#[cube]
fn rounded(value: f32) -> u32 {
    u32::cast_from(round_half_up(value))
}
