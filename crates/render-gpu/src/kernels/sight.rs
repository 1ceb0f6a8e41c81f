//! What a frame says of every Gaussian: the rule of `splatseg_memory`'s `removal.rs`.

use super::camera::{View, round_half_up, to_camera};
use cubecl::prelude::*;

/// Nothing: out of view, hidden, at a depth edge, or without depth.
pub(crate) const UNKNOWN: u32 = 0;
/// The observed surface is where the Gaussian lies.
pub(crate) const SEEN: u32 = 1;
/// The observed surface lies clearly behind it.
pub(crate) const THROUGH: u32 = 2;

/// Places in the counters of a view.
pub(crate) const SEEN_COUNT: usize = 0;
pub(crate) const THROUGH_COUNT: usize = 1;
pub(crate) const VISIBLE_COUNT: usize = 2;
pub(crate) const PAIR_COUNT: usize = 3;
/// Counters of a view.
pub(crate) const COUNTERS: usize = 4;

/// Compares each Gaussian with the depths (metres, `[height, width]`) around its centre, and counts what it finds.
#[cube(launch)]
pub(crate) fn note_sights(
    balls: &[f32],
    depth: &[f32],
    sights: &mut [u32],
    counters: &[Atomic<u32>],
    view: View,
    margin_metres: f32,
    margin_relative: f32,
    count: u32,
) {
    let gaussian = ABSOLUTE_POS;
    if gaussian >= count as usize {
        terminate!();
    }
    let center = to_camera(balls, gaussian, &view);
    let mut sight = UNKNOWN.runtime();
    if center.z > 0.0 {
        let x = view.fx * center.x / center.z + view.cx;
        let y = view.fy * center.y / center.z + view.cy;
        // Half a pixel below 1 rounds up to 1; above, the last but one pixel must be reached.
        let is_inside = x >= 0.5 && y >= 0.5 && x < f32::cast_from(view.width) && y < f32::cast_from(view.height);
        if is_inside {
            let column = u32::cast_from(round_half_up(x));
            let row = u32::cast_from(round_half_up(y));
            if column + 2 <= view.width && row + 2 <= view.height {
                sight = sight_at(
                    depth,
                    center.z,
                    column,
                    row,
                    view.width,
                    max_of(margin_metres, margin_relative * center.z),
                );
            }
        }
    }
    sights[gaussian] = sight;
    if sight == SEEN {
        counters[SEEN_COUNT].fetch_add(1u32);
    }
    if sight == THROUGH {
        counters[THROUGH_COUNT].fetch_add(1u32);
    }
}

#[cube]
fn max_of(one: f32, other: f32) -> f32 {
    select(one > other, one, other)
}

/// The sight of a Gaussian at depth `z` whose centre is seen at a pixel with neighbours on all sides.
#[cube]
fn sight_at(depth: &[f32], z: f32, column: u32, row: u32, width: u32, margin: f32) -> u32 {
    let mut all_through = true;
    let mut any_seen = false;
    for by_row in 0..3u32 {
        for by_column in 0..3u32 {
            let observed = depth[((row + by_row - 1) * width + column + by_column - 1) as usize];
            if observed <= z + margin {
                all_through = false;
            }
            let apart = f32::abs(observed - z);
            if observed > 0.0 && apart <= margin {
                any_seen = true;
            }
        }
    }
    let mut sight = UNKNOWN.runtime();
    if any_seen {
        sight = SEEN;
    }
    if all_through {
        sight = THROUGH;
    }
    sight
}

/// Whether a frame is believed where it sees through Gaussians. If it sees through more than half of those whose depth it
/// can judge, earlier frames must confirm it: `is_confirmed` is 1.
#[cube]
pub(crate) fn is_through_believed(seen: u32, through: u32, is_confirmed: u32) -> bool {
    is_confirmed == 1 || f32::cast_from(through) <= 0.5 * f32::cast_from(seen + through)
}

/// The same, on the host, for a frame that no other confirms.
pub(crate) fn contradicts_map(counters: &[u32]) -> bool {
    let (seen, through) = (counters[SEEN_COUNT], counters[THROUGH_COUNT]);
    through as f32 > 0.5 * (seen + through) as f32
}
