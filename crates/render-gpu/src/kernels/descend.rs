//! Gradient descent on features (`splatseg_memory`'s `features/loss.rs` and `features/learning.rs`).
//!
//! A row of working memory has the feature and, behind it, its square; in gradients that is the curvature. An integer id has
//! nothing behind it.

use super::bin::lower_bound;
use super::entries::Entries;
use super::forget::LEARNT;
use super::tile::VisibleGaussians;
use cubecl::prelude::*;

/// Magnitudes below this have no direction.
const TINY: f32 = 1e-6;

/// Squares of features below this have no direction.
const TINY_SQUARE: f32 = 1e-12;

/// The least curvature across a feature, as a fraction of that along it.
const MIN_CURVATURE_ACROSS: f32 = 1e-3;

/// Length of a row.
pub(crate) fn row_length(dim: usize) -> usize {
    if dim == 1 { 1 } else { dim + 1 }
}

/// Channels whose products the CPU sums up in eight lanes: all where rows are padded, otherwise whole chunks of eight.
pub(crate) fn whole_chunks(dim: usize) -> usize {
    dim / 8 * 8
}

/// The inner product of two vectors, in the order of the CPU (`splatseg_kernels`' `inner_products::dot`): the first `in_lanes`
/// channels in eight lanes, these by halves, and then the rest.
#[cube]
pub(crate) fn dot(one: &Array<f32>, other: &Array<f32>, #[comptime] dim: usize, #[comptime] in_lanes: usize) -> f32 {
    let mut lanes = Array::<f32>::new(8usize);
    for lane in 0..8usize {
        lanes[lane] = 0.0f32;
    }
    for channel in 0..in_lanes {
        lanes[channel % 8] += one[channel] * other[channel];
    }
    let mut rest = 0.0f32;
    for channel in in_lanes..dim {
        rest += one[channel] * other[channel];
    }
    let even = (lanes[0] + lanes[4]) + (lanes[2] + lanes[6]);
    let odd = (lanes[1] + lanes[5]) + (lanes[3] + lanes[7]);
    even + odd + rest
}

/// A vector that begins at `from`.
#[cube]
pub(crate) fn vector_at(values: &[f32], from: usize, #[comptime] dim: usize) -> Array<f32> {
    let mut vector = Array::<f32>::new(dim);
    for channel in 0..dim {
        vector[channel] = values[from + channel];
    }
    vector
}

/// The settings of the memory that steps depend on; see `splatseg_memory::MemorySettings`.
#[derive(CubeLaunch, CubeType, Clone, Copy)]
pub(crate) struct StepRule {
    pub magnitude_weight: f32,
    pub direction_weight: f32,
    pub learning_rate: f32,
    pub direction_learning_rate: f32,
    /// How much of the way since the last step is gone further.
    pub momentum: f32,
}

/// What steps work on.
#[derive(CubeLaunch, CubeType)]
pub(crate) struct DescentState {
    /// Entries of each visible Gaussian among those that are sorted, and the sum of its weights.
    pub begins: Box<[u32]>,
    pub ends: Box<[u32]>,
    pub weight_sums: Box<[f32]>,
    /// `[visible, row]`: where the next gradient is taken.
    pub ahead: Box<[f32]>,
    /// `[places, row]`: the gradient of each place; the last of a row is the curvature across the feature, less
    /// `direction_weight`.
    pub gradients: Box<[f32]>,
}

/// Finds the entries of each visible Gaussian among the sorted `keys`, which are pairs, and the sum of its weights over its
/// pairs. The first gradient is taken at the features themselves. `report` counts the Gaussians that have entries at the place
/// [`LEARNT`].
#[cube(launch)]
pub(crate) fn start_descent(
    visible: VisibleGaussians,
    keys: &[u32],
    pair_sums: &[f32],
    features: &[f32],
    mut state: DescentState,
    report: &[Atomic<u32>],
    entry_count: u32,
    count: u32,
    #[comptime] dim: usize,
) {
    let rank = ABSOLUTE_POS;
    if rank >= count as usize {
        terminate!();
    }
    let row = comptime!(row_length(dim));
    let first = visible.starts[rank];
    let behind_last = first + visible.tile_counts[rank];
    let begin = lower_bound(keys, entry_count, first);
    let end = lower_bound(keys, entry_count, behind_last);
    state.begins[rank] = begin;
    state.ends[rank] = end;
    let mut sum = 0.0f32;
    for pair in first..behind_last {
        sum += pair_sums[pair as usize];
    }
    state.weight_sums[rank] = sum;
    if begin < end {
        report[LEARNT].fetch_add(1u32);
        let splat = visible.order[rank] as usize;
        let from = visible.gaussians[splat] as usize * dim;
        let feature = vector_at(features, from, dim);
        for channel in 0..dim {
            state.ahead[splat * row + channel] = feature[channel];
        }
        if !comptime!(dim == 1) {
            state.ahead[splat * row + dim] = dot(&feature, &feature, dim, comptime!(whole_chunks(dim)));
        }
    }
}

/// Renders each place that has entries, and takes the gradient of the loss there.
#[cube(launch)]
pub(crate) fn differentiate(
    starts: &[u32],
    counts: &[u32],
    entries: Entries,
    mut state: DescentState,
    target: &[u32],
    codes: &[f32],
    rule: StepRule,
    width: u32,
    height: u32,
    #[comptime] dim: usize,
) {
    let place = ABSOLUTE_POS;
    let columns = width.div_ceil(16);
    if place >= (columns * height.div_ceil(16) * 256) as usize {
        terminate!();
    }
    let row = comptime!(row_length(dim));
    let count = counts[place];
    if count > 0 {
        let mut feature = Array::<f32>::new(row);
        for channel in 0..row {
            feature[channel] = 0.0f32;
        }
        let mut sum = 0.0f32;
        for entry in starts[place]..starts[place] + count {
            let weight = entries.weights[entry as usize];
            let from = entries.splats[entry as usize] as usize * row;
            sum += weight;
            for channel in 0..row {
                feature[channel] += weight * state.ahead[from + channel];
            }
        }
        let tile = place as u32 / 256;
        let unit = place as u32 % 256;
        let pixel = (tile / columns * 16 + unit / 16) * width + tile % columns * 16 + unit % 16;
        let segment = target[pixel as usize];
        let magnitude = f32::reinterpret(target[(width * height + pixel) as usize]);
        if comptime!(dim == 1) {
            let mut id = 0.0f32;
            if segment > 0 {
                id = codes[segment as usize - 1];
            }
            state.gradients[place] = -2.0f32 * rule.magnitude_weight * (id - feature[0]);
        } else {
            write_gradient(&feature, sum, segment, magnitude, codes, &mut state.gradients, place * row, &rule, dim);
        }
    }
}

/// Writes the gradient and the curvature for a rendered feature, which its squares follow; `sum` is the sum of its weights.
#[cube]
fn write_gradient(
    feature: &Array<f32>,
    sum: f32,
    segment: u32,
    magnitude: f32,
    codes: &[f32],
    gradients: &mut [f32],
    to: usize,
    rule: &StepRule,
    #[comptime] dim: usize,
) {
    let norm = f32::sqrt(dot(feature, feature, dim, dim));
    let most = feature[dim] * sum;
    let agreed = norm * norm / select(most > TINY * TINY, most, TINY * TINY);
    let apart = select(agreed < 1.0, 1.0 - agreed, 0.0);
    let mut curvature = 2.0 * rule.magnitude_weight * select(apart < 1.0, apart, 1.0);
    let radial = -2.0f32 * rule.magnitude_weight * (magnitude - norm);
    if segment == 0 {
        let mut scale = 0.0f32;
        if norm > TINY {
            scale = radial / norm;
        }
        for channel in 0..dim {
            gradients[to + channel] = feature[channel] * scale;
        }
    } else {
        let code = vector_at(codes, (segment as usize - 1) * dim, dim);
        if norm <= TINY {
            // Without a direction of its own the feature takes the target's.
            for channel in 0..dim {
                gradients[to + channel] = radial * code[channel];
            }
        } else {
            let along_code = -rule.direction_weight / norm;
            let along_feature = (radial - along_code * (dot(feature, &code, dim, dim) / norm)) / norm;
            for channel in 0..dim {
                gradients[to + channel] = along_feature * feature[channel] + along_code * code[channel];
            }
            curvature += rule.direction_weight / (norm * norm);
        }
    }
    gradients[to + dim] = curvature - rule.direction_weight;
}

/// Sums up the gradient of each visible Gaussian, pair by pair in the order of tiles and each pair in that of its pixels, and
/// takes a step: `features` against the gradient, and the place where the next one is taken further (Nesterov). The keys and
/// values of `entries` are sorted.
#[cube(launch)]
pub(crate) fn step(
    visible: VisibleGaussians,
    entries: Entries,
    mut state: DescentState,
    features: &mut [f32],
    rule: StepRule,
    count: u32,
    #[comptime] dim: usize,
) {
    let rank = ABSOLUTE_POS;
    if rank >= count as usize {
        terminate!();
    }
    let begin = state.begins[rank];
    let end = state.ends[rank];
    if begin < end {
        let row = comptime!(row_length(dim));
        let mut gradient = Array::<f32>::new(row);
        let mut part = Array::<f32>::new(row);
        for channel in 0..row {
            gradient[channel] = 0.0f32;
            part[channel] = 0.0f32;
        }
        let mut pair = entries.keys[begin as usize];
        for at in begin..end {
            if entries.keys[at as usize] != pair {
                pair = entries.keys[at as usize];
                for channel in 0..row {
                    gradient[channel] += part[channel];
                    part[channel] = 0.0f32;
                }
            }
            let entry = entries.values[at as usize] as usize;
            let weight = entries.weights[entry];
            let from = entries.places[entry] as usize * row;
            for channel in 0..row {
                part[channel] += weight * state.gradients[from + channel];
            }
        }
        for channel in 0..row {
            gradient[channel] += part[channel];
        }
        let splat = visible.order[rank] as usize;
        let to = visible.gaussians[splat] as usize * dim;
        let weight_sum = state.weight_sums[rank];
        move_feature(&gradient, weight_sum, &mut state.ahead, splat * row, features, to, &rule, dim);
    }
}

/// The step size for a curvature.
#[cube]
fn step_over(curvature: f32, rate: f32) -> f32 {
    let mut size = 0.0f32;
    if curvature > 0.0 {
        size = rate / curvature;
    }
    size
}

/// Moves one feature, which is at `to` in `features` and at `at` in `ahead`.
#[cube]
fn move_feature(
    gradient: &Array<f32>,
    weight_sum: f32,
    ahead: &mut [f32],
    at: usize,
    features: &mut [f32],
    to: usize,
    rule: &StepRule,
    #[comptime] dim: usize,
) {
    let curvature_along = 2.0 * rule.magnitude_weight * weight_sum;
    let along = step_over(curvature_along, rule.learning_rate);
    let mut across = along;
    let mut projection = 0.0f32;
    let mut before = Array::<f32>::new(dim);
    for channel in 0..dim {
        before[channel] = ahead[at + channel];
    }
    if !comptime!(dim == 1) {
        let square = ahead[at + dim];
        if square > TINY_SQUARE {
            let least = MIN_CURVATURE_ACROSS * curvature_along;
            // Where no pixel has a direction to learn, the gradient across is rounding error, and so is its curvature.
            let found = gradient[dim] + rule.direction_weight * weight_sum;
            across = step_over(select(found > least, found, least), rule.direction_learning_rate);
            projection = dot(gradient, &before, dim, comptime!(whole_chunks(dim))) / square;
        }
    }
    let mut after = Array::<f32>::new(dim);
    for channel in 0..dim {
        let radial = projection * before[channel];
        let new = before[channel] - (along * radial + across * (gradient[channel] - radial));
        after[channel] = new + rule.momentum * (new - features[to + channel]);
        features[to + channel] = new;
        ahead[at + channel] = after[channel];
    }
    if !comptime!(dim == 1) {
        ahead[at + dim] = dot(&after, &after, dim, comptime!(whole_chunks(dim)));
    }
}
