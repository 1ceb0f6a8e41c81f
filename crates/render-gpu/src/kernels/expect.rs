//! What a view expects: surfaces, evidence and segments per pixel (`splatseg_memory`'s `recall.rs` and `evidence/`).

use super::blend::{Pixel, pixel_of};
use super::camera::View;
use super::tile::{PixelReader, PixelReaderExpand, TilePairs, read_tile};
use super::vote::{LABELS, VoteColumns};
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

/// What one pixel has summed up of the surfaces that it shows.
#[derive(CubeType)]
pub(crate) struct PixelSums {
    /// What the frame measured, metres.
    pub observed: f32,
    pub silhouette: f32,
    /// Sum of weight times depth.
    pub depth: f32,
    pub covered: f32,
}

#[cube]
impl PixelSums {
    /// Nothing yet.
    pub fn new(pixel: &Pixel, depth: &[f32]) -> PixelSums {
        let mut observed = 0.0f32;
        if pixel.is_inside {
            observed = depth[pixel.index];
        }
        PixelSums { observed, silhouette: 0.0f32, depth: 0.0f32, covered: 0.0f32 }
    }

    /// Adds a Gaussian at a depth. Up to `disparity` behind the observed one it counts as that.
    pub fn add(&mut self, weight: f32, depth: f32, disparity: f32) {
        self.silhouette += weight;
        self.depth += weight * depth;
        if depth <= self.observed + disparity {
            self.covered += weight;
        }
    }

    /// Writes the surfaces of the pixel number `at`.
    pub fn write(&self, at: usize, pixels: usize, images: &mut [u32], surfaces: &mut [u32]) {
        let mut mean_depth = 0.0f32;
        if self.silhouette > 0.0 {
            mean_depth = self.depth / self.silhouette;
        }
        images[2 * pixels + at] = u32::reinterpret(self.silhouette);
        images[3 * pixels + at] = u32::reinterpret(mean_depth);
        surfaces[at] = u32::reinterpret(self.covered);
    }
}

/// The evidence of a pixel while it is summed up.
#[derive(CubeType)]
struct PixelEvidence {
    sums: PixelSums,
    /// What is not taken by things that are gone.
    light: f32,
    /// Segments and their evidence.
    ids: Array<u32>,
    evidence: Array<f32>,
    known: u32,
    rule: EvidenceRule,
}

#[cube]
impl PixelReader for PixelEvidence {
    type Remembered = VoteColumns;

    /// Votes count near the observed depth only. What lies in front of it is gone, or never was there, and the light that it
    /// takes is given back to what is behind.
    fn add(&mut self, remembered: &VoteColumns, gaussian: usize, weight: f32, depth: f32) {
        self.sums.add(weight, depth, self.rule.depth_disparity);
        let tolerance = self.rule.depth_tolerance;
        let mut behind = 0.0f32;
        if self.sums.observed > 0.0 {
            behind = depth - self.sums.observed;
        }
        if behind < -tolerance {
            self.light -= weight;
        }
        if behind >= -tolerance && behind <= tolerance && weight >= self.rule.min_weight * self.light {
            self.add_votes(remembered, gaussian, weight);
        }
    }
}

#[cube]
impl PixelEvidence {
    fn add_votes(&mut self, remembered: &VoteColumns, gaussian: usize, weight: f32) {
        for vote in 0..LABELS {
            let count = remembered.votes[gaussian * LABELS + vote];
            if count > 0.0 {
                let id = remembered.id(gaussian, vote);
                let mut place = self.known;
                for slot in 0..self.known {
                    if self.ids[slot as usize] == id {
                        place = slot;
                    }
                }
                if place == self.known && self.known < 16 {
                    self.ids[place as usize] = id;
                    self.evidence[place as usize] = 0.0f32;
                    self.known += 1u32;
                }
                if place < self.known {
                    self.evidence[place as usize] += weight * count;
                }
            }
        }
    }

    /// Writes the evidence of the pixel number `at`, and what it expects.
    fn write(
        &self,
        at: usize,
        pixels: usize,
        images: &mut [u32],
        surfaces: &mut [u32],
        table_ids: &mut [u32],
        table_evidence: &mut [f32],
    ) {
        let mut best = 0.0f32;
        let mut segment = 0u32;
        let light = select(self.light > MIN_LIGHT, self.light, MIN_LIGHT);
        for place in 0..self.known {
            let id = self.ids[place as usize];
            let found = self.evidence[place as usize] / light;
            table_ids[place as usize * pixels + at] = id;
            table_evidence[place as usize * pixels + at] = found;
            // Of equal ones the smaller id wins.
            if found > best || (found == best && id < segment) {
                best = found;
                segment = id;
            }
        }
        if best <= self.rule.min_evidence || self.sums.silhouette <= MIN_SILHOUETTE {
            segment = 0u32;
        }
        let mut confidence = 0.0f32;
        if segment != 0 {
            confidence = select(best < 1.0, best, 1.0);
        }
        images[at] = segment;
        images[pixels + at] = u32::reinterpret(confidence);
        self.sums.write(at, pixels, images, surfaces);
        surfaces[pixels + at] = self.known;
    }
}

/// Blends each tile and reads its evidence. Pairs that no pixel shows are dropped from `tiles`. `table_ids` and `table_evidence` are
/// `[16, height, width]`.
#[cube(launch)]
pub(crate) fn expect(
    tiles: TilePairs,
    remembered: VoteColumns,
    depth: &[f32],
    images: &mut [u32],
    surfaces: &mut [u32],
    table_ids: &mut [u32],
    table_evidence: &mut [f32],
    view: View,
    rule: EvidenceRule,
) {
    let pixel = pixel_of(CUBE_POS as u32, &view);
    let mut read = PixelEvidence {
        sums: PixelSums::new(&pixel, depth),
        light: 1.0f32,
        ids: Array::<u32>::new(SLOTS),
        evidence: Array::<f32>::new(SLOTS),
        known: 0u32,
        rule,
    };
    read_tile::<PixelEvidence>(tiles, &view, &remembered, &mut read);
    if pixel.is_inside {
        let pixels = (view.width * view.height) as usize;
        read.write(pixel.index, pixels, images, surfaces, table_ids, table_evidence);
    }
}
