//! Removal of Gaussians, and which ids are still carried (`splatseg_memory`'s `removal.rs` and `votes.rs`).

use super::camera::{View, round_half_up, to_camera};
use super::sight::{SEEN, SEEN_COUNT, THROUGH, THROUGH_COUNT, is_through_believed};
use super::vote::{LABELS, VoteColumns};
use cubecl::prelude::*;

/// Not in view.
pub(crate) const NOWHERE: u32 = u32::MAX;
/// In view, but its surface is not seen.
pub(crate) const HIDDEN: u32 = u32::MAX - 1;

/// Places in the report of a frame.
pub(crate) const REMOVED: usize = 0;
pub(crate) const LEARNT: usize = 1;
pub(crate) const GROWN: usize = 2;
/// How ids are held stands from here on: the sum of these flags for each.
pub(crate) const HOLDS: usize = 3;
pub(crate) const VOTED: u32 = 1;
pub(crate) const SHOWN: u32 = 2;

/// Notes what frame number `frame` says of the first `count` Gaussians. `keep` becomes 0 for those that are gone.
#[cube(launch)]
pub(crate) fn note_frame(
    sights: &[u32],
    counters: &[u32],
    last_seen: &mut [u32],
    seen_through: &mut [u32],
    keep: &mut [u32],
    report: &[Atomic<u32>],
    frame: u32,
    removal_frames: u32,
    is_confirmed: u32,
    count: u32,
) {
    let gaussian = ABSOLUTE_POS;
    if gaussian < count as usize {
        let sight = sights[gaussian];
        if sight == SEEN {
            last_seen[gaussian] = frame;
            seen_through[gaussian] = 0u32;
        }
        let is_believed = is_through_believed(counters[SEEN_COUNT], counters[THROUGH_COUNT], is_confirmed);
        if sight == THROUGH && is_believed && removal_frames > 0 {
            let frames = seen_through[gaussian] + 1;
            seen_through[gaussian] = select(frames < 255u32, frames, 255u32);
            if frames >= removal_frames {
                keep[gaussian] = 0u32;
                report[REMOVED].fetch_add(1u32);
            }
        }
    }
}

/// Notes that frame number `frame` has the `visible` ones of the first `count` Gaussians in view.
#[cube(launch)]
pub(crate) fn note_visible(visible: &[u32], last_seen: &mut [u32], frame: u32, count: u32) {
    let gaussian = ABSOLUTE_POS;
    if gaussian < count as usize && visible[gaussian] == 1 {
        last_seen[gaussian] = frame;
    }
}

/// The place of an id among the first `count` of `ids`, which increase; `count` if it is not there.
#[cube]
fn place_of(ids: &[u32], id: u32, count: u32) -> u32 {
    let mut from = 0u32;
    let mut to = count;
    while from < to {
        let middle = (from + to) / 2u32;
        if ids[middle as usize] < id {
            from = middle + 1u32;
        } else {
            to = middle;
        }
    }
    let mut place = count;
    if from < count && ids[from as usize] == id {
        place = from;
    }
    place
}

/// Marks in the report how Gaussians hold each of the first `id_count` of `ids`: the first `count` Gaussians and those that
/// have grown.
#[cube(launch)]
pub(crate) fn mark_holds(
    remembered: VoteColumns,
    keep: &[u32],
    ids: &[u32],
    report: &[Atomic<u32>],
    min_evidence: f32,
    count: u32,
    id_count: u32,
) {
    let gaussian = ABSOLUTE_POS;
    if gaussian < (count + report[GROWN].load()) as usize && keep[gaussian] == 1 {
        let mut best = 0.0f32;
        let mut winner = 0u32;
        for slot in 0..LABELS {
            let id = remembered.id(gaussian, slot);
            let own = remembered.votes[gaussian * LABELS + slot];
            if own > 0.0 {
                let place = place_of(ids, id, id_count);
                if place < id_count {
                    report[HOLDS + place as usize].fetch_or(VOTED);
                }
                if own > best || (own == best && id < winner) {
                    best = own;
                    winner = id;
                }
            }
        }
        if best > min_evidence {
            let place = place_of(ids, winner, id_count);
            if place < id_count {
                report[HOLDS + place as usize].fetch_or(SHOWN);
            }
        }
    }
}

/// Moves the numbers of the Gaussians that are kept, `width` each, to their `places`.
#[cube(launch)]
pub(crate) fn compact(keep: &[u32], places: &[u32], from: &[u32], to: &mut [u32], width: u32, values: u32) {
    if ABSOLUTE_POS < values as usize {
        let width = width as usize;
        let gaussian = ABSOLUTE_POS / width;
        if keep[gaussian] == 1 {
            to[places[gaussian] as usize * width + ABSOLUTE_POS % width] = from[ABSOLUTE_POS];
        }
    }
}

/// The pixel in which each Gaussian's centre lies, or [`NOWHERE`] or [`HIDDEN`].
#[cube(launch)]
pub(crate) fn locate_seen(balls: &[f32], sights: &[u32], visible: &[u32], pixels: &mut [u32], view: View, count: u32) {
    let gaussian = ABSOLUTE_POS;
    if gaussian < count as usize {
        let mut pixel = NOWHERE.runtime();
        if visible[gaussian] == 1 {
            pixel = HIDDEN;
        }
        if visible[gaussian] == 1 && sights[gaussian] == SEEN {
            let center = to_camera(balls, gaussian, &view);
            let x = round_half_up(view.fx * center.x / center.z + view.cx);
            let y = round_half_up(view.fy * center.y / center.z + view.cy);
            pixel = u32::cast_from(y) * view.width + u32::cast_from(x);
        }
        pixels[gaussian] = pixel;
    }
}

/// Sets `count` values.
#[cube(launch)]
pub(crate) fn fill(values: &mut [u32], value: u32, count: u32) {
    if ABSOLUTE_POS < count as usize {
        values[ABSOLUTE_POS] = value;
    }
}

/// Copies the first `count` values.
#[cube(launch)]
pub(crate) fn copy(from: &[u32], to: &mut [u32], count: u32) {
    if ABSOLUTE_POS < count as usize {
        to[ABSOLUTE_POS] = from[ABSOLUTE_POS];
    }
}

/// Sets one value.
#[cube(launch)]
pub(crate) fn set(values: &mut [u32], place: u32, value: u32) {
    if ABSOLUTE_POS == 0 {
        values[place as usize] = value;
    }
}

/// Packs the first `count` flags into bits, 32 in a word.
#[cube(launch)]
pub(crate) fn pack_flags(flags: &[u32], words: &mut [u32], count: u32) {
    let first = ABSOLUTE_POS * 32;
    if first < count as usize {
        let mut word = 0u32;
        for bit in 0..32u32 {
            let at = first + bit as usize;
            if at < count as usize && flags[at] == 1 {
                word |= 1u32 << bit;
            }
        }
        words[ABSOLUTE_POS] = word;
    }
}
