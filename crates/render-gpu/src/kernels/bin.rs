//! Which Gaussians touch which tile: pairs of a tile and a Gaussian, emitted front to back and then sorted by tile.

use super::camera::View;
use super::project::{NUMBERS, touched};
use cubecl::prelude::*;

/// Counts the tiles of each Gaussian; `order` has the visible Gaussians front to back.
#[cube(launch)]
pub(crate) fn count_tiles(splats: &[f32], order: &[u32], tile_counts: &mut [u32], view: View, count: u32) {
    let rank = ABSOLUTE_POS;
    if rank < count as usize {
        let at = order[rank] as usize * NUMBERS;
        let tiles = touched(splats[at], splats[at + 1], splats[at + 6], splats[at + 7], &view);
        tile_counts[rank] = (tiles.right + 1 - tiles.left) * (tiles.bottom + 1 - tiles.top);
    }
}

/// Writes each Gaussian's pairs from its entry in `starts` on, row-major: the tile as a sort key, the pair's own number as
/// the value, and whose pair it is.
#[cube(launch)]
pub(crate) fn emit_pairs(
    splats: &[f32],
    order: &[u32],
    starts: &[u32],
    keys: &mut [u32],
    values: &mut [u32],
    splat_of_pair: &mut [u32],
    view: View,
    count: u32,
) {
    let rank = ABSOLUTE_POS;
    if rank < count as usize {
        let splat = order[rank];
        let at = splat as usize * NUMBERS;
        let tiles = touched(splats[at], splats[at + 1], splats[at + 6], splats[at + 7], &view);
        let mut pair = starts[rank] as usize;
        for row in tiles.top..tiles.bottom + 1 {
            for column in tiles.left..tiles.right + 1 {
                keys[pair] = row * view.columns + column;
                values[pair] = pair as u32;
                splat_of_pair[pair] = splat;
                pair += 1;
            }
        }
    }
}

/// Where the pairs of each tile begin and end among `keys`, which are sorted.
#[cube(launch)]
pub(crate) fn find_tiles(keys: &[u32], begins: &mut [u32], ends: &mut [u32], count: u32, tiles: u32) {
    let tile = ABSOLUTE_POS as u32;
    if tile < tiles {
        begins[tile as usize] = lower_bound(keys, count, tile);
        ends[tile as usize] = lower_bound(keys, count, tile + 1);
    }
}

/// The number of keys below `key`.
#[cube]
pub(crate) fn lower_bound(keys: &[u32], count: u32, key: u32) -> u32 {
    let mut low = 0u32;
    let mut high = count;
    while low < high {
        let middle = low + (high - low) / 2;
        if keys[middle as usize] < key {
            low = middle + 1;
        } else {
            high = middle;
        }
    }
    low
}
