//! What a view expects: surfaces, evidence and segments per pixel (`splatseg_memory`'s `recall.rs` and `evidence/`).

use super::blend::{PIXELS, STAGED, Transmittance, alpha_at, blend, pixel_of, stage};
use super::camera::View;
use cubecl::prelude::*;

/// Segments that one pixel can have evidence for. What comes behind that many others has next to no light.
pub(crate) const SLOTS: usize = 16;

/// Images of a view that the host reads, one after the other: expected segment, its confidence, silhouette and depth.
pub(crate) const IMAGES: usize = 4;

/// Images of a view that stay on the device: what is covered, and the number of segments with evidence.
pub(crate) const SURFACES: usize = 2;

/// Where less light than this comes through what is gone, nothing can be told of what lies behind.
const MIN_LIGHT: f32 = 0.05;

/// A segment is expected only where the map covers at least this much of the pixel.
const MIN_SILHOUETTE: f32 = 0.5;

/// The settings of the memory that evidence depends on; see `splatseg_memory::MemorySettings`.
#[derive(CubeLaunch, CubeType, Clone, Copy)]
pub(crate) struct EvidenceRule {
    /// What lies up to this behind the frame's surface counts as that surface, metres.
    pub depth_disparity: f32,
    /// A Gaussian counts only within this distance of the observed depth, metres.
    pub depth_tolerance: f32,
    /// Blend weights below this are not counted.
    pub min_weight: f32,
    /// Votes must exceed this for a segment to be expected.
    pub min_evidence: f32,
}

/// What one pixel has summed up.
#[derive(CubeType)]
pub(crate) struct PixelSums {
    pub silhouette: f32,
    /// Sum of weight times depth.
    pub depth: f32,
    pub covered: f32,
    /// What is not taken by things that are gone.
    pub light: f32,
}

/// Adds a Gaussian at depth `at` to the surfaces of a pixel. Up to `disparity` behind the observed one it counts as that.
#[cube]
pub(crate) fn add_weight(sums: &mut PixelSums, weight: f32, at: f32, observed: f32, disparity: f32) {
    sums.silhouette += weight;
    sums.depth += weight * at;
    if at <= observed + disparity {
        sums.covered += weight;
    }
}

/// Writes the surfaces of a pixel.
#[cube]
pub(crate) fn write_surface(sums: &PixelSums, at: usize, pixels: usize, images: &mut [u32], surfaces: &mut [u32]) {
    let mut mean_depth = 0.0f32;
    if sums.silhouette > 0.0 {
        mean_depth = sums.depth / sums.silhouette;
    }
    images[2 * pixels + at] = u32::reinterpret(sums.silhouette);
    images[3 * pixels + at] = u32::reinterpret(mean_depth);
    surfaces[at] = u32::reinterpret(sums.covered);
}

/// Adds a Gaussian at depth `at` to the sums of a pixel; returns whether its votes count there: only near the observed depth.
/// What lies in front of it is gone, or never was there, and the light that it takes is given back to what is behind.
#[cube]
fn add_surface(sums: &mut PixelSums, weight: f32, at: f32, observed: f32, rule: &EvidenceRule) -> bool {
    add_weight(sums, weight, at, observed, rule.depth_disparity);
    let mut behind = 0.0f32;
    if observed > 0.0 {
        behind = at - observed;
    }
    if behind < -rule.depth_tolerance {
        sums.light -= weight;
    }
    behind >= -rule.depth_tolerance && behind <= rule.depth_tolerance && weight >= rule.min_weight * sums.light
}

/// Adds the weighted votes of a Gaussian to the table of a pixel; returns the number of segments in it.
#[cube]
fn add_evidence(
    vote_ids: &[u32],
    votes: &[f32],
    gaussian: usize,
    weight: f32,
    ids: &mut Array<u32>,
    evidence: &mut Array<f32>,
    known: u32,
) -> u32 {
    let mut known = known;
    for vote in 0..4usize {
        let count = votes[gaussian * 4 + vote];
        if count > 0.0 {
            let packed = vote_ids[gaussian * 2 + vote / 2];
            let id = (packed >> (16u32 * (vote as u32 & 1u32))) & 0xffffu32;
            let mut place = known;
            for slot in 0..known {
                if ids[slot as usize] == id {
                    place = slot;
                }
            }
            if place == known && known < 16 {
                ids[place as usize] = id;
                evidence[place as usize] = 0.0f32;
                known += 1u32;
            }
            if place < known {
                evidence[place as usize] += weight * count;
            }
        }
    }
    known
}

/// Moves the pairs of a batch that are used to `to`, in their order; returns how many there are. All threads take part.
#[cube]
pub(crate) fn keep_used(pairs: &mut [u32], pair: u32, to: u32, used: &Shared<[u32]>, flags: &mut Shared<[u32]>) -> u32 {
    let unit = UNIT_POS as usize;
    sync_cube();
    let mut rank = 0u32;
    for slot in 0..unit {
        rank += used[slot];
    }
    if used[unit] == 1 {
        pairs[(to + rank) as usize] = pair;
    }
    if UNIT_POS == 255 {
        flags[1] = rank + used[unit];
    }
    sync_cube();
    flags[1]
}

/// Writes what is known of a pixel.
#[cube]
fn write_pixel(
    ids: &Array<u32>,
    evidence: &Array<f32>,
    known: u32,
    sums: &PixelSums,
    at: usize,
    pixels: usize,
    rule: &EvidenceRule,
    images: &mut [u32],
    surfaces: &mut [u32],
    table_ids: &mut [u32],
    table_evidence: &mut [f32],
) {
    let mut best = 0.0f32;
    let mut segment = 0u32;
    let light = select(sums.light > MIN_LIGHT, sums.light, MIN_LIGHT);
    for place in 0..known {
        let id = ids[place as usize];
        let found = evidence[place as usize] / light;
        table_ids[place as usize * pixels + at] = id;
        table_evidence[place as usize * pixels + at] = found;
        // Of equal ones the smaller id wins.
        if found > best || (found == best && id < segment) {
            best = found;
            segment = id;
        }
    }
    if best <= rule.min_evidence || sums.silhouette <= MIN_SILHOUETTE {
        segment = 0u32;
    }
    let mut confidence = 0.0f32;
    if segment != 0 {
        confidence = select(best < 1.0, best, 1.0);
    }
    images[at] = segment;
    images[pixels + at] = u32::reinterpret(confidence);
    write_surface(sums, at, pixels, images, surfaces);
    surfaces[pixels + at] = known;
}

/// Blends each tile and reads it. `pairs` of each tile, from `begins` to `ends`, are front to back; those that no pixel
/// shows are dropped from both.
///
/// `vote_ids` are `[gaussians, 2]` of two ids each, `votes` `[gaussians, 4]`; `table_ids` and `table_evidence` are `[16, height,
/// width]`.
#[cube(launch)]
pub(crate) fn expect(
    splats: &[f32],
    gaussians: &[u32],
    splat_of_pair: &[u32],
    pairs: &mut [u32],
    begins: &[u32],
    ends: &mut [u32],
    vote_ids: &[u32],
    votes: &[f32],
    depth: &[f32],
    images: &mut [u32],
    surfaces: &mut [u32],
    table_ids: &mut [u32],
    table_evidence: &mut [f32],
    view: View,
    rule: EvidenceRule,
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
    let mut ids = Array::<u32>::new(SLOTS);
    let mut evidence = Array::<f32>::new(SLOTS);
    let mut known = 0u32;
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
            if weight > 0.0 && add_surface(&mut sums, weight, staged[slot * STAGED + 5], observed, &rule) {
                let gaussian = staged_gaussians[slot] as usize;
                known = add_evidence(vote_ids, votes, gaussian, weight, &mut ids, &mut evidence, known);
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
        write_pixel(&ids, &evidence, known, &sums, at, pixels, &rule, images, surfaces, table_ids, table_evidence);
    }
}
