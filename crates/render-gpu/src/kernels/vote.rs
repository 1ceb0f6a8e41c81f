//! The votes that one frame gives (`splatseg_memory`'s `evidence/voting.rs` and `votes.rs`).

use super::blend::{PIXELS, end_place, first_place};
use super::camera::View;
use super::forget::{GROWN, LEARNT};
use super::fuse::ABSTAIN;
use super::tile::{Tile, TilePairs, VisibleGaussians};
use cubecl::prelude::*;

/// Gaussians that a tile counts together: the weights of all its pixels must fit the shared memory.
pub(crate) const BATCH: u32 = 16;

/// Labels that one Gaussian can get votes for in a frame, and segments that it keeps votes for.
pub(crate) const LABELS: usize = 4;

/// The votes of Gaussians on the device.
#[derive(CubeLaunch, CubeType)]
pub(crate) struct VoteColumns {
    /// `[gaussians, 4]`.
    pub ids: Box<[u32]>,
    /// `[gaussians, 4]`.
    pub votes: Box<[f32]>,
}

#[cube]
impl VoteColumns {
    /// The id in a slot of a Gaussian.
    pub fn id(&self, gaussian: usize, slot: usize) -> u32 {
        self.ids[gaussian * LABELS + slot]
    }
}

/// Votes below this say nothing any more and make room.
const NEGLIGIBLE: f32 = 0.02;

/// Farther than any depth.
const FAR: f32 = 3e38;

/// Adds the weight of a label to up to four labels and their weights.
#[cube]
fn add_label(ids: &mut Array<u32>, weights: &mut Array<f32>, id: u32, weight: f32) {
    if weight != 0.0 && id != ABSTAIN {
        let mut place = LABELS.runtime();
        for slot in 0..LABELS {
            if place == LABELS && (weights[slot] == 0.0 || ids[slot] == id) {
                place = slot;
            }
        }
        // A fifth label is rare and has little weight.
        if place < LABELS {
            ids[place] = id;
            weights[place] += weight;
        }
    }
}

/// The nearest and the farthest of a tile's depths that are measured.
#[cube]
fn depth_range(tile_depth: &Shared<[f32]>, range: &mut Shared<[f32]>) {
    let mut nearest = FAR.runtime();
    let mut farthest = 0.0f32;
    for at in 0..PIXELS {
        let here = tile_depth[at];
        if here > 0.0 {
            nearest = select(here < nearest, here, nearest);
            farthest = select(here > farthest, here, farthest);
        }
    }
    range[0] = nearest;
    range[1] = farthest;
}

/// What the threads of a tile share of its pixels while they count.
#[derive(CubeType)]
struct TileLabels {
    /// `[16, 256]`.
    weights: Shared<[f32]>,
    labels: Shared<[u32]>,
    depth: Shared<[f32]>,
    /// Nearest and farthest of `depth`.
    range: Shared<[f32]>,
}

/// The labels and depths of this cube's tile, without weights.
#[cube]
fn labels_of(tile: &Tile, labels: &[u32], depth: &[f32]) -> TileLabels {
    let mut shared = TileLabels {
        weights: Shared::<[f32]>::new_slice(comptime!(BATCH as usize * PIXELS)),
        labels: Shared::<[u32]>::new_slice(PIXELS),
        depth: Shared::<[f32]>::new_slice(PIXELS),
        range: Shared::<[f32]>::new_slice(2usize),
    };
    let unit = UNIT_POS as usize;
    shared.labels[unit] = 0u32;
    shared.depth[unit] = 0.0f32;
    if tile.pixel.is_inside {
        shared.labels[unit] = labels[tile.pixel.index];
        shared.depth[unit] = depth[tile.pixel.index];
    }
    sync_cube();
    if unit == 0 {
        depth_range(&shared.depth, &mut shared.range);
    }
    shared
}

/// Sums the weights of the Gaussian in `slot` by label; returns the sum of all.
#[cube]
fn sum_labels(
    tile: &Tile,
    shared: &TileLabels,
    slot: usize,
    tolerance: f32,
    ids: &mut Array<u32>,
    sums: &mut Array<f32>,
) -> f32 {
    let at = tile.depth(slot);
    // Most tiles show one surface: then no pixel needs to be looked at.
    let is_near_all = at <= shared.range[0] + tolerance && at >= shared.range[1] - tolerance;
    for label in 0..LABELS {
        ids[label] = 0u32;
        sums[label] = 0.0f32;
    }
    let mut total = 0.0f32;
    let mut current = 0u32;
    let mut sum = 0.0f32;
    let bits = tile.bits(slot);
    for place in first_place(bits)..end_place(bits) {
        let place = place as usize;
        let weight = shared.weights[slot * PIXELS + place];
        if weight > 0.0 {
            let observed = shared.depth[place];
            let apart = f32::abs(at - observed);
            if is_near_all || observed <= 0.0 || apart <= tolerance {
                let label = shared.labels[place];
                if label != current {
                    total += sum;
                    add_label(ids, sums, current, sum);
                    current = label;
                    sum = 0.0f32;
                }
                sum += weight;
            }
        }
    }
    add_label(ids, sums, current, sum);
    total + sum
}

/// What the tile of each pair says of its Gaussian.
#[derive(CubeLaunch, CubeType)]
pub(crate) struct PairVotes {
    /// The sum of its weights, `[pairs]`.
    pub totals: Box<[f32]>,
    /// Labels and the sums of their weights, `[pairs, 4]`.
    pub labels: Box<[u32]>,
    pub weights: Box<[f32]>,
}

/// Sums the weights of each pair's Gaussian in its tile by the `labels` `[height, width]` of the pixels. Sums go row by row,
/// and runs of one label are added up first.
#[cube(launch)]
pub(crate) fn count_votes(
    tiles: TilePairs,
    labels: &[u32],
    depth: &[f32],
    mut found: PairVotes,
    view: View,
    tolerance: f32,
) {
    let mut tile = Tile::new(&tiles, &view, BATCH);
    let mut shared = labels_of(&tile, labels, depth);
    let unit = UNIT_POS as usize;
    for batch in 0..tile.count.div_ceil(BATCH) {
        let here = tile.stage(&tiles, &view, batch * BATCH);
        tile.blend_batch(here, &mut shared.weights, &view);
        if UNIT_POS < here {
            let pair = tile.pair(unit) as usize;
            let mut ids = Array::<u32>::new(LABELS);
            let mut sums = Array::<f32>::new(LABELS);
            found.totals[pair] = sum_labels(&tile, &shared, unit, tolerance, &mut ids, &mut sums);
            for slot in 0..LABELS {
                found.labels[pair * LABELS + slot] = ids[slot];
                found.weights[pair * LABELS + slot] = sums[slot];
            }
        }
    }
}

/// The settings of the memory that votes depend on; see `splatseg_memory::MemorySettings`.
#[derive(CubeLaunch, CubeType, Clone, Copy)]
pub(crate) struct VoteRule {
    /// What "no segment" weighs relative to a prediction.
    pub no_segment_weight: f32,
    /// Most votes of a Gaussian.
    pub max_votes: f32,
}

/// Adds up the pairs of each visible Gaussian in the order of tiles, and gives its votes. `report` counts the Gaussians that
/// had any at the place [`LEARNT`].
#[cube(launch)]
pub(crate) fn give_votes(
    visible: VisibleGaussians,
    found: PairVotes,
    mut remembered: VoteColumns,
    report: &[Atomic<u32>],
    rule: VoteRule,
    count: u32,
) {
    let rank = ABSOLUTE_POS;
    if rank >= count as usize {
        terminate!();
    }
    let mut ids = Array::<u32>::new(LABELS);
    let mut sums = Array::<f32>::new(LABELS);
    for slot in 0..LABELS {
        ids[slot] = 0u32;
        sums[slot] = 0.0f32;
    }
    let mut total = 0.0f32;
    let first = visible.starts[rank] as usize;
    for tile in 0..visible.tile_counts[rank] as usize {
        let pair = first + tile;
        // The entry of a tile that shows nothing of the Gaussian was never written.
        if found.totals[pair] > 0.0 {
            let mut unlabelled = found.totals[pair];
            for slot in 0..LABELS {
                let weight = found.weights[pair * LABELS + slot];
                total += weight;
                add_label(&mut ids, &mut sums, found.labels[pair * LABELS + slot], weight);
                unlabelled -= weight;
            }
            total += unlabelled;
        }
    }
    if total > 0.0 {
        let gaussian = visible.gaussians[visible.order[rank] as usize] as usize;
        take_votes(&ids, &sums, total, &mut remembered, gaussian, &rule);
        report[LEARNT].fetch_add(1u32);
    }
}

/// Gives one Gaussian its votes and scales them down if they are too many.
#[cube]
fn take_votes(
    ids: &Array<u32>,
    sums: &Array<f32>,
    total: f32,
    remembered: &mut VoteColumns,
    gaussian: usize,
    rule: &VoteRule,
) {
    let mut own_ids = Array::<u32>::new(LABELS);
    let mut own = Array::<f32>::new(LABELS);
    for slot in 0..LABELS {
        own_ids[slot] = remembered.id(gaussian, slot);
        own[slot] = remembered.votes[gaussian * LABELS + slot];
    }
    let divisor = select(total > 1.0, total, 1.0);
    for slot in 0..LABELS {
        let mut share = sums[slot] / divisor;
        if ids[slot] == 0 {
            share *= rule.no_segment_weight;
        }
        if share > 0.0 {
            add_vote(&mut own_ids, &mut own, ids[slot], share);
        }
    }
    let sum = own[0] + own[1] + own[2] + own[3];
    let mut scale = 1.0f32;
    if sum > rule.max_votes {
        scale = rule.max_votes / sum;
    }
    for slot in 0..LABELS {
        let scaled = own[slot] * scale;
        remembered.votes[gaussian * LABELS + slot] = select(scaled < NEGLIGIBLE, 0.0, scaled);
        remembered.ids[gaussian * LABELS + slot] = own_ids[slot];
    }
}

/// Adds votes for a segment. If all slots are taken by others it takes the place of the weakest, if it is stronger.
#[cube]
fn add_vote(ids: &mut Array<u32>, votes: &mut Array<f32>, id: u32, count: f32) {
    let mut known = LABELS.runtime();
    for slot in 0..LABELS {
        if known == LABELS && votes[slot] > 0.0 && ids[slot] == id {
            known = slot;
        }
    }
    if known < LABELS {
        votes[known] += count;
    } else {
        let mut weakest = 0usize;
        for slot in 1..LABELS {
            if votes[slot] < votes[weakest] {
                weakest = slot;
            }
        }
        if count > votes[weakest] {
            ids[weakest] = id;
            votes[weakest] = count;
        }
    }
}

/// Gives `count` votes for `id` to some Gaussians, and scales their votes down to at most `max`.
#[cube(launch)]
pub(crate) fn favour(gaussians: &[u32], mut remembered: VoteColumns, id: u32, max_votes: f32, gaussian_count: u32) {
    if ABSOLUTE_POS < gaussian_count as usize {
        let mut ids = Array::<u32>::new(LABELS);
        let mut sums = Array::<f32>::new(LABELS);
        for slot in 0..LABELS {
            ids[slot] = 0u32;
            sums[slot] = 0.0f32;
        }
        ids[0] = id;
        sums[0] = 2.0 * max_votes;
        let rule = VoteRule { no_segment_weight: 1.0f32, max_votes };
        take_votes(&ids, &sums, 1.0f32, &mut remembered, gaussians[ABSOLUTE_POS] as usize, &rule);
    }
}

/// Writes what the Gaussians that have grown behind the first `first` know of segments: the labels of their `pixels`.
#[cube(launch)]
pub(crate) fn first_votes(
    pixels: &[u32],
    labels: &[u32],
    mut remembered: VoteColumns,
    report: &[u32],
    no_segment_weight: f32,
    first: u32,
) {
    if ABSOLUTE_POS < report[GROWN] as usize {
        let to = first as usize + ABSOLUTE_POS;
        let label = labels[pixels[ABSOLUTE_POS] as usize];
        let mut vote = 1.0f32;
        if label == 0 {
            vote = no_segment_weight;
        }
        if label == ABSTAIN {
            vote = 0.0f32;
        }
        remembered.ids[to * LABELS] = select(label == ABSTAIN, 0u32, label);
        remembered.votes[to * LABELS] = vote;
        for slot in 1..LABELS {
            remembered.ids[to * LABELS + slot] = 0u32;
            remembered.votes[to * LABELS + slot] = 0.0f32;
        }
    }
}
