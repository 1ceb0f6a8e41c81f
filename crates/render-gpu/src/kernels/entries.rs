//! The blend weights that learning works with (`splatseg_render`'s `active.rs`): entries of a sparse matrix, pixel by pixel and
//! front to back. A pixel's place is its number in its tile, behind those of the tiles before.

use super::blend::{PIXELS, STAGED, Transmittance, alpha_at, blend, pixel_of, stage};
use super::camera::View;
use super::vote::BATCH;
use cubecl::prelude::*;

/// Counts the entries of each place, those above `min_weight` at `active` pixels, and sums up the weights of each pair, whether
/// its pixels are active or not.
#[cube(launch)]
pub(crate) fn count_entries(
    splats: &[f32],
    splat_of_pair: &[u32],
    pairs: &[u32],
    begins: &[u32],
    ends: &[u32],
    active: &[u32],
    counts: &mut [u32],
    weight_sums: &mut [f32],
    view: View,
    min_weight: f32,
) {
    let mut staged = Shared::<[f32]>::new_slice(BATCH * STAGED);
    let mut boxes = Shared::<[u32]>::new_slice(BATCH);
    let mut weights = Shared::<[f32]>::new_slice(BATCH * PIXELS);
    let tile = CUBE_POS as u32;
    let unit = UNIT_POS as usize;
    let pixel = pixel_of(tile, &view);
    let begin = begins[CUBE_POS];
    let count = ends[CUBE_POS] - begin;
    let mut is_active = false;
    if pixel.is_inside {
        is_active = active[pixel.index] == 1;
    }
    let mut behind = Transmittance { value: 1.0f32, is_live: pixel.is_inside };
    let mut entries = 0u32;
    for batch in 0..count.div_ceil(16) {
        let first = batch * 16;
        let mut here = count - first;
        if here > 16 {
            here = 16u32;
        }
        sync_cube();
        let mut pair = 0usize;
        if UNIT_POS < here {
            pair = pairs[(begin + first + UNIT_POS) as usize] as usize;
            stage(splats, splat_of_pair[pair] as usize, tile, &view, &mut staged, &mut boxes, unit);
        }
        sync_cube();
        for slot in 0..here {
            let slot = slot as usize;
            let mut alpha = 0.0f32;
            if behind.is_live {
                alpha = alpha_at(&staged, &boxes, slot, &pixel, &view);
            }
            let weight = blend(alpha, &mut behind, &view);
            weights[slot * PIXELS + unit] = weight;
            if is_active && weight > min_weight {
                entries += 1u32;
            }
        }
        sync_cube();
        if UNIT_POS < here {
            let rows = boxes[unit];
            let mut sum = 0.0f32;
            // There is no weight outside its rows.
            for place in ((rows >> 10u32) & 31) * 16..(((rows >> 15u32) & 31) + 1) * 16 {
                sum += weights[unit * PIXELS + place as usize];
            }
            weight_sums[pair] = sum;
        }
    }
    counts[CUBE_POS * PIXELS + unit] = entries;
}

/// Writes the entries that [`count_entries`] counted, each place from its entry in `starts` on: weight, place, projected
/// Gaussian, and as sort keys and values the pair and the entry's own number.
#[cube(launch)]
pub(crate) fn write_entries(
    splats: &[f32],
    splat_of_pair: &[u32],
    pairs: &[u32],
    begins: &[u32],
    ends: &[u32],
    active: &[u32],
    starts: &[u32],
    weights: &mut [f32],
    places: &mut [u32],
    entry_splats: &mut [u32],
    keys: &mut [u32],
    values: &mut [u32],
    view: View,
    min_weight: f32,
) {
    let mut staged = Shared::<[f32]>::new_slice(PIXELS * STAGED);
    let mut boxes = Shared::<[u32]>::new_slice(PIXELS);
    let mut staged_pairs = Shared::<[u32]>::new_slice(PIXELS);
    let tile = CUBE_POS as u32;
    let unit = UNIT_POS as usize;
    let pixel = pixel_of(tile, &view);
    let begin = begins[CUBE_POS];
    let count = ends[CUBE_POS] - begin;
    let mut is_active = false;
    if pixel.is_inside {
        is_active = active[pixel.index] == 1;
    }
    let place = CUBE_POS * PIXELS + unit;
    let mut entry = starts[place] as usize;
    // A pixel that is not active takes no part.
    let mut behind = Transmittance { value: 1.0f32, is_live: is_active };
    for batch in 0..count.div_ceil(256) {
        let first = batch * 256;
        let mut here = count - first;
        if here > 256 {
            here = 256u32;
        }
        sync_cube();
        if UNIT_POS < here {
            let pair = pairs[(begin + first + UNIT_POS) as usize];
            stage(splats, splat_of_pair[pair as usize] as usize, tile, &view, &mut staged, &mut boxes, unit);
            staged_pairs[unit] = pair;
        }
        sync_cube();
        for slot in 0..here {
            let slot = slot as usize;
            let mut alpha = 0.0f32;
            if behind.is_live {
                alpha = alpha_at(&staged, &boxes, slot, &pixel, &view);
            }
            let weight = blend(alpha, &mut behind, &view);
            if weight > min_weight {
                let pair = staged_pairs[slot];
                weights[entry] = weight;
                places[entry] = place as u32;
                entry_splats[entry] = splat_of_pair[pair as usize];
                keys[entry] = pair;
                values[entry] = entry as u32;
                entry += 1usize;
            }
        }
    }
}
