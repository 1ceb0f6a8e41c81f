//! Rendered features and the segments that they stand for (`splatseg_memory`'s `features/decoding.rs`).

use super::blend::{PIXELS, STAGED, Transmittance, alpha_at, blend, pixel_of, stage};
use super::camera::{View, round_half_up};
use super::expect::{PixelSums, add_weight, keep_used, write_surface};
use super::forget::GROWN;
use cubecl::prelude::*;

/// No product of a finite feature is larger.
const LARGEST: f32 = 3e38;

/// The settings of the memory that decoding depends on; see `splatseg_memory::MemorySettings`.
#[derive(CubeLaunch, CubeType, Clone, Copy)]
pub(crate) struct DecodeRule {
    /// What lies up to this behind the frame's surface counts as that surface, metres.
    pub depth_disparity: f32,
    /// The best product must exceed this.
    pub threshold: f32,
    /// A feature whose square is below this has no product that exceeds the threshold, whatever is rounded.
    pub least_square: f32,
    /// Codes that belong to segments.
    pub used: u32,
}

/// The sum of the squares of a feature.
#[cube]
pub(crate) fn square_of(feature: &Array<f32>, #[comptime] dim: usize) -> f32 {
    let mut square = 0.0f32;
    for channel in 0..dim {
        square += feature[channel] * feature[channel];
    }
    square
}

/// The segment whose code has the largest product with a feature, the first of equal ones; 0 for none.
#[cube]
fn decoded(feature: &Array<f32>, codes: &[f32], rule: &DecodeRule, #[comptime] dim: usize) -> u32 {
    let mut segment = 0u32;
    if comptime!(dim == 1) {
        let id = round_half_up(feature[0]);
        if id >= 1.0 && id <= f32::cast_from(rule.used) {
            segment = u32::cast_from(id);
        }
    } else if square_of(feature, dim) >= rule.least_square {
        let mut best = rule.threshold;
        for code in 0..rule.used {
            let from = code as usize * dim;
            let mut product = 0.0f32;
            for channel in 0..dim {
                product += feature[channel] * codes[from + channel];
            }
            if product > best {
                best = product;
                segment = code + 1;
            }
        }
        if best > LARGEST {
            segment = 0u32;
        }
    }
    segment
}

/// Blends each tile and decodes its features. `pairs` of each tile, from `begins` to `ends`, are front to back; those that no
/// pixel shows are dropped from both. `features` are `[gaussians, dim]`, `rendered` becomes `[height, width, dim]`.
#[cube(launch)]
pub(crate) fn expect_features(
    splats: &[f32],
    gaussians: &[u32],
    splat_of_pair: &[u32],
    pairs: &mut [u32],
    begins: &[u32],
    ends: &mut [u32],
    features: &[f32],
    codes: &[f32],
    depth: &[f32],
    images: &mut [u32],
    surfaces: &mut [u32],
    rendered: &mut [f32],
    view: View,
    rule: DecodeRule,
    #[comptime] dim: usize,
) {
    let mut staged = Shared::<[f32]>::new_slice(PIXELS * STAGED);
    let mut boxes = Shared::<[u32]>::new_slice(PIXELS);
    let mut staged_gaussians = Shared::<[u32]>::new_slice(PIXELS);
    let mut used = Shared::<[u32]>::new_slice(PIXELS);
    let mut flags = Shared::<[u32]>::new_slice(2usize);
    let tile = CUBE_POS as u32;
    let unit = UNIT_POS as usize;
    let pixel = pixel_of(tile, &view);
    let begin = begins[CUBE_POS];
    let count = ends[CUBE_POS] - begin;
    let mut observed = 0.0f32;
    if pixel.is_inside {
        observed = depth[pixel.index];
    }
    let mut behind = Transmittance { value: 1.0f32, is_live: pixel.is_inside };
    let mut sums = PixelSums { silhouette: 0.0f32, depth: 0.0f32, covered: 0.0f32, light: 1.0f32 };
    let mut feature = Array::<f32>::new(dim);
    for channel in 0..dim {
        feature[channel] = 0.0f32;
    }
    let mut kept = 0u32;
    for batch in 0..count.div_ceil(256) {
        let first = batch * 256;
        sync_cube();
        if unit < 2 {
            flags[unit] = 0u32;
        }
        sync_cube();
        if behind.is_live {
            // All threads that write write the same.
            flags[0] = 1u32;
        }
        used[unit] = 0u32;
        let mut pair = 0u32;
        if first + UNIT_POS < count {
            pair = pairs[(begin + first + UNIT_POS) as usize];
            let splat = splat_of_pair[pair as usize] as usize;
            stage(splats, splat, tile, &view, &mut staged, &mut boxes, unit);
            staged_gaussians[unit] = gaussians[splat];
        } else {
            boxes[unit] = 0u32;
        }
        sync_cube();
        if flags[0] == 0 {
            break;
        }
        let mut here = count - first;
        if here > 256 {
            here = 256u32;
        }
        for slot in 0..here {
            let slot = slot as usize;
            let mut alpha = 0.0f32;
            if behind.is_live {
                alpha = alpha_at(&staged, &boxes, slot, &pixel, &view);
            }
            if alpha > 0.0 {
                used[slot] = 1u32;
            }
            let weight = blend(alpha, &mut behind, &view);
            if weight > 0.0 {
                add_weight(&mut sums, weight, staged[slot * STAGED + 5], observed, rule.depth_disparity);
                let from = staged_gaussians[slot] as usize * dim;
                for channel in 0..dim {
                    feature[channel] += weight * features[from + channel];
                }
            }
        }
        kept += keep_used(pairs, pair, begin + kept, &used, &mut flags);
    }
    if UNIT_POS == 0 {
        ends[CUBE_POS] = begin + kept;
    }
    if pixel.is_inside {
        let pixels = (view.width * view.height) as usize;
        let at = pixel.index;
        write_surface(&sums, at, pixels, images, surfaces);
        let segment = decoded(&feature, codes, &rule, dim);
        let mut confidence = f32::sqrt(square_of(&feature, dim));
        if comptime!(dim == 1) {
            // An integer id has no length: its confidence is 1 or 0.
            confidence = select(segment != 0, 1.0, 0.0);
        }
        images[at] = segment;
        images[pixels + at] = u32::reinterpret(confidence);
        for channel in 0..dim {
            rendered[at * dim + channel] = feature[channel];
        }
    }
}

/// The segment that each Gaussian shows by itself.
#[cube(launch)]
pub(crate) fn decode_gaussians(
    features: &[f32],
    codes: &[f32],
    segments: &mut [u32],
    rule: DecodeRule,
    count: u32,
    #[comptime] dim: usize,
) {
    if ABSOLUTE_POS < count as usize {
        let mut feature = Array::<f32>::new(dim);
        for channel in 0..dim {
            feature[channel] = features[ABSOLUTE_POS * dim + channel];
        }
        segments[ABSOLUTE_POS] = decoded(&feature, codes, &rule, dim);
    }
}

/// Writes the features of the Gaussians that have grown behind the first `first`: those of their `pixels` in `target`
/// `[2, height, width]`, a segment and its confidence.
#[cube(launch)]
pub(crate) fn first_features(
    pixels: &[u32],
    target: &[u32],
    codes: &[f32],
    features: &mut [f32],
    report: &[u32],
    image: u32,
    first: u32,
    #[comptime] dim: usize,
) {
    if ABSOLUTE_POS < report[GROWN] as usize {
        let to = (first as usize + ABSOLUTE_POS) * dim;
        let pixel = pixels[ABSOLUTE_POS] as usize;
        let segment = target[pixel];
        let mut confidence = 1.0f32;
        if !comptime!(dim == 1) {
            confidence = f32::reinterpret(target[image as usize + pixel]);
        }
        for channel in 0..dim {
            let mut value = 0.0f32;
            if segment > 0 {
                value = confidence * codes[(segment as usize - 1) * dim + channel];
            }
            features[to + channel] = value;
        }
    }
}
