//! The blend weights that learning works with (`splatseg_render`'s `active.rs`): entries of a sparse matrix, pixel by pixel and
//! front to back. A pixel's place is its number in its tile, behind those of the tiles before.

use super::blend::{PIXELS, end_place, first_place};
use super::camera::View;
use super::tile::{Tile, TilePairs};
use super::vote::BATCH;
use cubecl::prelude::*;

/// Counts the entries of each place, those above `min_weight` at `active` pixels, and sums up the weights of each pair, whether
/// its pixels are active or not.
#[cube(launch)]
pub(crate) fn count_entries(
    tiles: TilePairs,
    active: &[u32],
    counts: &mut [u32],
    weight_sums: &mut [f32],
    view: View,
    min_weight: f32,
) {
    let mut tile = Tile::new(&tiles, &view, BATCH);
    let mut weights = Shared::<[f32]>::new_slice(comptime!(BATCH as usize * PIXELS));
    let unit = UNIT_POS as usize;
    let is_active = is_active(&tile, active);
    let mut entries = 0u32;
    for batch in 0..tile.count.div_ceil(BATCH) {
        let here = tile.stage(&tiles, &view, batch * BATCH);
        tile.blend_batch(here, &mut weights, &view);
        for slot in 0..here {
            if is_active && weights[slot as usize * PIXELS + unit] > min_weight {
                entries += 1u32;
            }
        }
        if UNIT_POS < here {
            let bits = tile.bits(unit);
            let mut sum = 0.0f32;
            for place in first_place(bits)..end_place(bits) {
                sum += weights[unit * PIXELS + place as usize];
            }
            weight_sums[tile.pair(unit) as usize] = sum;
        }
    }
    counts[CUBE_POS * PIXELS + unit] = entries;
}

/// Whether this thread's pixel is active.
#[cube]
fn is_active(tile: &Tile, active: &[u32]) -> bool {
    let mut found = false;
    if tile.pixel.is_inside {
        found = active[tile.pixel.index] == 1;
    }
    found
}

/// The entries of all places.
#[derive(CubeLaunch, CubeType)]
pub(crate) struct Entries {
    pub weights: Box<[f32]>,
    pub places: Box<[u32]>,
    /// Projected Gaussians.
    pub splats: Box<[u32]>,
    /// Sort keys and values: the pair and the entry's own number.
    pub keys: Box<[u32]>,
    pub values: Box<[u32]>,
}

/// Writes the entries that [`count_entries`] counted, each place from its entry in `starts` on.
#[cube(launch)]
pub(crate) fn write_entries(
    tiles: TilePairs,
    active: &[u32],
    starts: &[u32],
    mut entries: Entries,
    view: View,
    min_weight: f32,
) {
    let mut tile = Tile::new(&tiles, &view, 256u32);
    let place = CUBE_POS * PIXELS + UNIT_POS as usize;
    let mut entry = starts[place] as usize;
    // A pixel that is not active takes no part.
    tile.behind.is_live = is_active(&tile, active);
    for batch in 0..tile.count.div_ceil(256) {
        let here = tile.stage(&tiles, &view, batch * 256);
        for slot in 0..here {
            let slot = slot as usize;
            let weight = tile.blend(slot, &view);
            if weight > min_weight {
                let pair = tile.pair(slot);
                entries.weights[entry] = weight;
                entries.places[entry] = place as u32;
                entries.splats[entry] = tiles.splat_of_pair[pair as usize];
                entries.keys[entry] = pair;
                entries.values[entry] = entry as u32;
                entry += 1usize;
            }
        }
    }
}
