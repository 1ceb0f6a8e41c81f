//! Growth and removal of Gaussians, and which ids are still carried (`splatseg_memory`'s `removal.rs` and `votes.rs`).

use super::camera::{View, round_half_up, to_camera};
use super::sight::{SEEN, SEEN_COUNT, THROUGH, THROUGH_COUNT, is_through_believed};
use cubecl::prelude::*;

/// Not in view.
pub(crate) const NOWHERE: u32 = u32::MAX;
/// In view, but its surface is not seen.
pub(crate) const HIDDEN: u32 = u32::MAX - 1;

/// Numbers of a new Gaussian: centre and radius (4), packed ids (2), votes (4).
pub(crate) const NEW_NUMBERS: usize = 10;

/// Places in the report of a frame.
pub(crate) const REMOVED: usize = 0;
pub(crate) const VOTED: usize = 1;
/// The flags of ids begin here.
pub(crate) const CARRIED: usize = 2;

/// Appends `added` `[new, 10]` (bits of floats, but for the ids) behind the first `count` Gaussians.
#[cube(launch)]
pub(crate) fn append(
    added: &[u32],
    balls: &mut [f32],
    vote_ids: &mut [u32],
    votes: &mut [f32],
    last_seen: &mut [u32],
    seen_through: &mut [u32],
    frame: u32,
    count: u32,
    added_count: u32,
) {
    if ABSOLUTE_POS < added_count as usize {
        let from = ABSOLUTE_POS * NEW_NUMBERS;
        let to = count as usize + ABSOLUTE_POS;
        for number in 0..4usize {
            balls[to * 4 + number] = f32::reinterpret(added[from + number]);
            votes[to * 4 + number] = f32::reinterpret(added[from + 6 + number]);
        }
        vote_ids[to * 2] = added[from + 4];
        vote_ids[to * 2 + 1] = added[from + 5];
        last_seen[to] = frame;
        seen_through[to] = 0u32;
    }
}

/// Notes what frame number `frame` says of the first `sight_count` of all Gaussians. `keep` is 0 for those that are gone.
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
    sight_count: u32,
    count: u32,
) {
    let gaussian = ABSOLUTE_POS;
    if gaussian >= count as usize {
        terminate!();
    }
    let mut is_kept = 1u32;
    if gaussian < sight_count as usize {
        let sight = sights[gaussian];
        if sight == SEEN {
            last_seen[gaussian] = frame;
            seen_through[gaussian] = 0u32;
        }
        let is_believed = is_through_believed(counters[SEEN_COUNT], counters[THROUGH_COUNT]);
        if sight == THROUGH && is_believed && removal_frames > 0 {
            let frames = seen_through[gaussian] + 1;
            seen_through[gaussian] = select(frames < 255u32, frames, 255u32);
            if frames >= removal_frames {
                is_kept = 0u32;
                report[REMOVED].fetch_add(1u32);
            }
        }
    }
    keep[gaussian] = is_kept;
}

/// Marks in the report the segments that Gaussians show by themselves.
#[cube(launch)]
pub(crate) fn mark_carried(
    vote_ids: &[u32],
    votes: &[f32],
    keep: &[u32],
    report: &[Atomic<u32>],
    min_evidence: f32,
    count: u32,
) {
    let gaussian = ABSOLUTE_POS;
    if gaussian < count as usize && keep[gaussian] == 1 {
        let mut best = 0.0f32;
        let mut winner = 0u32;
        for slot in 0..4usize {
            let id = (vote_ids[gaussian * 2 + slot / 2] >> (16u32 * (slot as u32 & 1u32))) & 0xffffu32;
            let own = votes[gaussian * 4 + slot];
            if own > 0.0 && (own > best || (own == best && id < winner)) {
                best = own;
                winner = id;
            }
        }
        if best > min_evidence {
            report[CARRIED + winner as usize].store(1u32);
        }
    }
}

/// Moves the Gaussians that are kept to their `places`.
#[cube(launch)]
pub(crate) fn compact(
    keep: &[u32],
    places: &[u32],
    balls: &[f32],
    vote_ids: &[u32],
    votes: &[f32],
    last_seen: &[u32],
    seen_through: &[u32],
    kept_balls: &mut [f32],
    kept_vote_ids: &mut [u32],
    kept_votes: &mut [f32],
    kept_last_seen: &mut [u32],
    kept_seen_through: &mut [u32],
    count: u32,
) {
    let from = ABSOLUTE_POS;
    if from < count as usize && keep[from] == 1 {
        let to = places[from] as usize;
        for number in 0..4usize {
            kept_balls[to * 4 + number] = balls[from * 4 + number];
            kept_votes[to * 4 + number] = votes[from * 4 + number];
        }
        for number in 0..2usize {
            kept_vote_ids[to * 2 + number] = vote_ids[from * 2 + number];
        }
        kept_last_seen[to] = last_seen[from];
        kept_seen_through[to] = seen_through[from];
    }
}

/// The pixel in which each Gaussian's centre lies, or [`NOWHERE`] or [`HIDDEN`].
#[cube(launch)]
pub(crate) fn locate_seen(
    balls: &[f32],
    sights: &[u32],
    visible: &[u32],
    pixels: &mut [u32],
    view: View,
    count: u32,
) {
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
