//! What each pixel of a frame asks for, and how far the next border is (`splatseg_memory`'s `borders.rs`).

use super::camera::View;
use super::grow::GrowthRuleValues;
use cubecl::prelude::*;

/// Distances to borders are not told apart beyond this, pixels.
pub(crate) const MAX_DISTANCE: u32 = 32;

/// What a pixel asks for: nothing, no Gaussian at all, or one.
pub(crate) const REFUSED: u32 = 1;
pub(crate) const WANTED: u32 = 2;
/// Added where the pixel lies on a border.
pub(crate) const BORDER: u32 = 4;

/// What the neighbours of a pixel say of it: bits for a nearer one across a depth edge, a farther one, another segment.
#[cube]
fn compare(depth: &[f32], seen: &[u32], own: usize, other: usize, edge_disparity: f32) -> u32 {
    let mut found = 0u32;
    if seen[other] != seen[own] {
        found = 4u32;
    }
    let (here, there) = (depth[own], depth[other]);
    if here > 0.0 && there > 0.0 {
        let limit = edge_disparity * select(here < there, here, there);
        if here - there > limit {
            found |= 1u32;
        }
        if there - here > limit {
            found |= 2u32;
        }
    }
    found
}

/// Whether the inverse depth at `own` goes on with the two pixels at `step` and twice that beside it. `room` is how many
/// pixels there are on that side.
#[cube]
fn continues(depth: &[f32], own: usize, near: usize, far: usize, room: u32, edge_disparity: f32) -> bool {
    let mut is_straight = false;
    if room >= 2 {
        let (beside, beyond) = (depth[near], depth[far]);
        if beside > 0.0 && beyond > 0.0 {
            let inverse = 1.0 / depth[own];
            let expected = 2.0 * (1.0 / beside) - 1.0 / beyond;
            is_straight = f32::abs(expected - inverse) <= edge_disparity * inverse;
        }
    }
    is_straight
}

/// Whether a pixel lies on a slanted plane: it goes on with its row and with its column.
#[cube]
fn is_on_a_plane(depth: &[f32], at: usize, column: u32, row: u32, view: &View, edge_disparity: f32) -> bool {
    let width = view.width as usize;
    let left = column;
    let right = view.width - 1 - column;
    let above = row;
    let below = view.height - 1 - row;
    // Places that are not there are not looked at.
    let along_row = continues(depth, at, at + 1, at + 2, right, edge_disparity)
        || continues(depth, at, back(at, 1usize), back(at, 2usize), left, edge_disparity);
    let along_column = continues(depth, at, at + width, at + 2 * width, below, edge_disparity)
        || continues(depth, at, back(at, width), back(at, 2 * width), above, edge_disparity);
    along_row && along_column
}

#[cube]
fn back(at: usize, by: usize) -> usize {
    let mut place = 0usize;
    if at >= by {
        place = at - by;
    }
    place
}

/// What each pixel asks for, and whether it is a border. `images` are those of a view, `surfaces` what it keeps.
#[cube(launch)]
pub(crate) fn find_wanted(
    depth: &[f32],
    seen: &[u32],
    images: &[u32],
    surfaces: &[u32],
    wanted: &mut [u32],
    view: View,
    rule: GrowthRuleValues,
) {
    let at = ABSOLUTE_POS;
    let pixels = (view.width * view.height) as usize;
    if at >= pixels {
        terminate!();
    }
    let column = at as u32 % view.width;
    let row = at as u32 / view.width;
    let width = view.width as usize;
    let own = depth[at];
    let mut found = 0u32;
    if rule.is_paper == 1 {
        let silhouette = f32::reinterpret(images[2 * pixels + at]);
        let disparity = f32::abs(own - f32::reinterpret(images[3 * pixels + at]));
        if own > 0.0 && (silhouette < rule.growth_silhouette || disparity > rule.depth_disparity) {
            found = WANTED.runtime();
        }
    } else {
        let mut edges = 0u32;
        if column > 0 {
            edges |= compare(depth, seen, at, at - 1, rule.edge_disparity);
        }
        if column + 1 < view.width {
            edges |= compare(depth, seen, at, at + 1, rule.edge_disparity);
        }
        if row > 0 {
            edges |= compare(depth, seen, at, at - width, rule.edge_disparity);
        }
        if row + 1 < view.height {
            edges |= compare(depth, seen, at, at + width, rule.edge_disparity);
        }
        if own > 0.0 && f32::reinterpret(surfaces[at]) < rule.growth_coverage {
            found = WANTED.runtime();
            if (edges & 3) == 3 && !is_on_a_plane(depth, at, column, row, &view, rule.edge_disparity) {
                found = REFUSED.runtime();
            }
        }
        if edges != 0 {
            found |= BORDER;
        }
    }
    wanted[at] = found;
}

/// Steps along the row to the nearest border.
#[cube(launch)]
pub(crate) fn row_distances(wanted: &[u32], distances: &mut [u32], width: u32, pixels: u32) {
    let at = ABSOLUTE_POS;
    if at >= pixels as usize {
        terminate!();
    }
    let column = at as u32 % width;
    let mut nearest = MAX_DISTANCE.runtime();
    for steps in 0..MAX_DISTANCE {
        let is_left = steps <= column && (wanted[back(at, steps as usize)] & BORDER) != 0;
        let is_right = column + steps < width && (wanted[at + steps as usize] & BORDER) != 0;
        if (is_left || is_right) && steps < nearest {
            nearest = steps;
        }
    }
    distances[at] = nearest;
}

/// Steps along rows and columns to the nearest border, from those along rows.
#[cube(launch)]
pub(crate) fn distances(in_row: &[u32], distances: &mut [u32], width: u32, pixels: u32) {
    let at = ABSOLUTE_POS;
    if at >= pixels as usize {
        terminate!();
    }
    let row = at as u32 / width;
    let height = pixels / width;
    let mut nearest = in_row[at];
    for steps in 1..MAX_DISTANCE {
        let by = (steps * width) as usize;
        if steps <= row {
            let above = in_row[back(at, by)] + steps;
            nearest = select(above < nearest, above, nearest);
        }
        if row + steps < height {
            let below = in_row[at + by] + steps;
            nearest = select(below < nearest, below, nearest);
        }
    }
    distances[at] = nearest;
}
