//! The pixels that a frame's features are learnt from (`splatseg_memory`'s `features/learning.rs`).

use super::camera::{View, to_camera};
use super::descend::{dot, vector_at, whole_chunks};
use super::project::project;
use cubecl::prelude::*;

/// The settings of the memory that the choice of pixels depends on; see `splatseg_memory::MemorySettings`.
#[derive(CubeLaunch, CubeType, Clone, Copy)]
pub(crate) struct ActiveRule {
    /// The memory must cover this much of a pixel.
    pub min_silhouette: f32,
    /// Confidences may differ by this.
    pub tolerance: f32,
    /// Directions may have this cosine.
    pub min_cosine: f32,
    /// What lies within so many rows and columns of a pixel that differs is learnt, too.
    pub margin: u32,
    pub width: u32,
    pub height: u32,
}

/// Whether the memory covers a pixel.
#[cube]
fn is_covered(images: &[u32], at: usize, rule: &ActiveRule) -> bool {
    let pixels = (rule.width * rule.height) as usize;
    f32::reinterpret(images[2 * pixels + at]) >= rule.min_silhouette
}

/// Marks the covered pixels whose feature decodes to another segment than that of `target`, or differs too much from it.
#[cube(launch)]
pub(crate) fn find_differing(
    rendered: &[f32],
    images: &[u32],
    target: &[u32],
    codes: &[f32],
    differs: &mut [u32],
    rule: ActiveRule,
    #[comptime] dim: usize,
) {
    let at = ABSOLUTE_POS;
    let pixels = (rule.width * rule.height) as usize;
    if at >= pixels {
        terminate!();
    }
    let segment = target[at];
    let magnitude = f32::reinterpret(target[pixels + at]);
    let feature = vector_at(rendered, at * dim, dim);
    let norm = f32::sqrt(dot(&feature, &feature, dim, comptime!(whole_chunks(dim))));
    let mut found = f32::abs(norm - magnitude) > rule.tolerance;
    if segment != 0 {
        let code = vector_at(codes, (segment as usize - 1) * dim, dim);
        if comptime!(dim == 1) {
            found = f32::abs(feature[0] - code[0]) > rule.tolerance;
        } else {
            let product = dot(&feature, &code, dim, comptime!(whole_chunks(dim)));
            found = found || product < rule.min_cosine * norm;
        }
        found = found || images[at] != segment;
    }
    differs[at] = select(found && is_covered(images, at, &rule), 1u32, 0u32);
}

/// Marks the pixels that are near a marked one in their row.
#[cube(launch)]
pub(crate) fn spread_in_rows(marked: &[u32], near: &mut [u32], rule: ActiveRule) {
    let at = ABSOLUTE_POS;
    if at >= (rule.width * rule.height) as usize {
        terminate!();
    }
    let column = at as u32 % rule.width;
    let first = column - select(column < rule.margin, column, rule.margin);
    let last = select(column + rule.margin < rule.width, column + rule.margin, rule.width - 1);
    let mut found = 0u32;
    for other in first..last + 1 {
        found |= marked[at + other as usize - column as usize];
    }
    near[at] = found;
}

/// Marks the pixels to be learnt: covered, near a marked one in their column, and not touched by new Gaussians.
/// `active_count` counts them.
#[cube(launch)]
pub(crate) fn choose_active(
    near: &[u32],
    touched: &[u32],
    images: &[u32],
    active: &mut [u32],
    active_count: &[Atomic<u32>],
    rule: ActiveRule,
) {
    let at = ABSOLUTE_POS;
    if at >= (rule.width * rule.height) as usize {
        terminate!();
    }
    let column = at as u32 % rule.width;
    let row = at as u32 / rule.width;
    let first = row - select(row < rule.margin, row, rule.margin);
    let last = select(row + rule.margin < rule.height, row + rule.margin, rule.height - 1);
    let mut found = 0u32;
    for other in first..last + 1 {
        found |= near[(other * rule.width + column) as usize];
    }
    if touched[at] == 1 || !is_covered(images, at, &rule) {
        found = 0u32;
    }
    active[at] = found;
    if found == 1 {
        active_count[0].fetch_add(1u32);
    }
}

/// Marks the pixels on which a Gaussian from number `first` to `count` prevails: it is nearer than the rendered surface, and
/// within `reach` times its box.
#[cube(launch)]
pub(crate) fn mark_touched(
    balls: &[f32],
    images: &[u32],
    touched: &mut [u32],
    view: View,
    reach: f32,
    first: u32,
    count: u32,
) {
    let gaussian = first as usize + ABSOLUTE_POS;
    if gaussian >= count as usize {
        terminate!();
    }
    let splat = project(to_camera(balls, gaussian, &view), balls[gaussian * 4 + 3], &view);
    if splat.is_visible {
        let half_width = splat.half_width * reach;
        let half_height = splat.half_height * reach;
        let left = first_pixel(splat.x - half_width);
        let right = end_pixel(splat.x + half_width, view.width);
        let bottom = end_pixel(splat.y + half_height, view.height);
        let pixels = (view.width * view.height) as usize;
        for row in first_pixel(splat.y - half_height)..bottom {
            for column in left..right {
                let at = (row * view.width + column) as usize;
                if splat.depth < f32::reinterpret(images[3 * pixels + at]) {
                    // All threads that write write the same.
                    touched[at] = 1u32;
                }
            }
        }
    }
}

/// The first pixel at or after a place, a little outwards.
#[cube]
fn first_pixel(place: f32) -> u32 {
    let outwards = place - 0.01;
    u32::cast_from(select(outwards > 0.0, outwards.ceil(), 0.0))
}

/// The pixel behind the last one up to a place, a little outwards.
#[cube]
fn end_pixel(place: f32, size: u32) -> u32 {
    let outwards = place + 1.01;
    let end = u32::cast_from(select(outwards > 0.0, outwards, 0.0));
    select(end < size, end, size)
}
