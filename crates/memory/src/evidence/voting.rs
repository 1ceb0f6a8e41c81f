//! The votes from one frame.

use super::Votes;
use super::census::CensusChanges;
use crate::MemorySettings;
use crate::tile_surface::{RUN, SurfaceDepths, any, cut, run};
use rayon::prelude::*;
use splatseg_geometry::{CowImage, SegmentId, SegmentMap};
use splatseg_kernels::{Instructions, Vectorize};
use splatseg_render::{BlendWeights, TileWeights};
use std::collections::BTreeSet;

/// Maximum number of labels for which a Gaussian gets votes in a frame.
const LABELS: usize = Votes::SLOTS;

/// Gaussians updated by one task.
const CHUNK: usize = 4096;

/// Blend weights of one Gaussian by the label of the pixel, in one tile or in the image.
#[derive(Clone, Copy, Debug, Default)]
struct LabelWeights {
    gaussian: u32,
    /// Sum over the pixels of all labels.
    total: f32,
    ids: [SegmentId; LABELS],
    weights: [f32; LABELS],
}

/// Labels with which every Gaussian in view was seen in a frame.
pub(super) struct FrameVotes {
    /// Entries by tile. A Gaussian has an entry in each tile that it touches.
    by_tile: Vec<Vec<LabelWeights>>,
    gaussian_count: usize,
}

impl FrameVotes {
    /// Sums the blend weights of each Gaussian by label: Σ of `W[p, i]` over the pixels of label ℓ.
    ///
    /// A Gaussian is seen at a pixel only if it lies within the tolerance of the depth observed there, or no depth is
    /// observed there. Some light reaches Gaussians behind the surface, but the label is not theirs; and the edge of a
    /// Gaussian in front extends over pixels that show the surface behind it.
    pub fn count(
        weights: &BlendWeights,
        labels: &SegmentMap,
        depth: &CowImage<'_, f32>,
        settings: &MemorySettings,
        gaussian_count: usize,
    ) -> Self {
        let by_tile = weights.tiles().par_iter().map(|tile| count_tile(tile, labels, depth, settings)).collect();
        Self { by_tile, gaussian_count }
    }

    /// Adds the frame's votes to every Gaussian: each label's share of the Gaussian's total weight, or the weight
    /// itself if the total is less than one pixel. Returns the number of Gaussians that got votes, and the changes in
    /// how Gaussians hold ids.
    pub fn apply(
        &self,
        votes: &mut [Votes],
        contradicted: &BTreeSet<SegmentId>,
        settings: &MemorySettings,
    ) -> (usize, CensusChanges) {
        let chunks = self.gaussian_count.div_ceil(CHUNK);
        let mut by_chunk: Vec<Vec<&LabelWeights>> = vec![Vec::new(); chunks];
        for label_weights in self.by_tile.iter().flatten() {
            by_chunk[label_weights.gaussian as usize / CHUNK].push(label_weights);
        }
        let applied: Vec<(usize, CensusChanges)> = votes
            .par_chunks_mut(CHUNK)
            .zip(by_chunk)
            .enumerate()
            .map(|(chunk, (votes, entries))| apply_chunk(votes, &entries, chunk * CHUNK, contradicted, settings))
            .collect();
        let (mut count, mut changes) = (0, CensusChanges::default());
        for (chunk_count, chunk_changes) in applied {
            count += chunk_count;
            changes.merge(chunk_changes);
        }
        (count, changes)
    }
}

impl LabelWeights {
    #[inline(always)]
    fn add(&mut self, id: SegmentId, weight: f32) {
        self.total += weight;
        if weight == 0.0 {
            return;
        }
        for slot in 0..LABELS {
            if self.weights[slot] == 0.0 || self.ids[slot] == id {
                self.ids[slot] = id;
                self.weights[slot] += weight;
                return;
            }
        }
        // A fifth label is rare and has little weight: it counts only in the total.
    }
}

fn count_tile(
    tile: &TileWeights,
    labels: &SegmentMap,
    depth: &CowImage<'_, f32>,
    settings: &MemorySettings,
) -> Vec<LabelWeights> {
    let depths = SurfaceDepths::new(&cut(tile, depth), settings);
    Instructions::best().run(CountTile { tile, labels: &cut(tile, labels), depths: &depths })
}

/// The sums of the blend weights of each Gaussian of a tile by label.
struct CountTile<'a> {
    tile: &'a TileWeights,
    labels: &'a [SegmentId; TileWeights::PIXELS],
    depths: &'a SurfaceDepths,
}

impl Vectorize for CountTile<'_> {
    type Output = Vec<LabelWeights>;

    #[inline(always)]
    fn run(self) -> Vec<LabelWeights> {
        let tile = self.tile;
        let mut counted = Vec::with_capacity(tile.gaussians().len());
        let mut uncounted = [[0f32; RUN]; TileWeights::PIXELS / RUN];
        for column in 0..tile.gaussians().len() {
            let (gaussian, depth) = (tile.gaussians()[column], tile.depths()[column]);
            let (firsts, weights) = tile.runs(column);
            let runs = firsts.len().min(weights.len()).min(uncounted.len());
            for index in 0..runs {
                uncounted[index] = self.depths.seen(firsts[index], depth, &weights[index]);
            }
            let mut label_weights = LabelWeights { gaussian, ..LabelWeights::default() };
            self.count_labels(&firsts[..runs], &mut uncounted[..runs], &mut label_weights);
            counted.push(label_weights);
        }
        counted
    }
}

impl CountTile<'_> {
    /// Counts the weights of one label after the other, in the order in which they appear. Most Gaussians show one.
    #[inline(always)]
    fn count_labels(&self, firsts: &[u8], uncounted: &mut [[f32; RUN]], label_weights: &mut LabelWeights) {
        let runs = firsts.len().min(uncounted.len());
        let mut start = 0;
        while start < runs {
            if !any(&uncounted[start]) {
                start += 1;
                continue;
            }
            let mut lane = 0;
            while lane + 1 < RUN && uncounted[start][lane] == 0.0 {
                lane += 1;
            }
            let label = run(self.labels, firsts[start])[lane];
            let mut sums = [0f32; RUN];
            for index in start..runs {
                let (labels, mut rest) = (*run(self.labels, firsts[index]), uncounted[index]);
                for lane in 0..RUN {
                    sums[lane] += if labels[lane] == label { rest[lane] } else { 0.0 };
                    rest[lane] = if labels[lane] == label { 0.0 } else { rest[lane] };
                }
                uncounted[index] = rest;
            }
            let mut sum = 0.0;
            for part in sums {
                sum += part;
            }
            label_weights.add(label, sum);
        }
    }
}

/// Sums the tiles' entries for the Gaussians from `first` on, in tile order, and adds their votes.
fn apply_chunk(
    votes: &mut [Votes],
    entries: &[&LabelWeights],
    first: usize,
    contradicted: &BTreeSet<SegmentId>,
    settings: &MemorySettings,
) -> (usize, CensusChanges) {
    let mut changes = CensusChanges::default();
    if entries.is_empty() {
        return (0, changes);
    }
    let mut summed = vec![LabelWeights::default(); votes.len()];
    for entry in entries {
        let sums = &mut summed[entry.gaussian as usize - first];
        let mut unlabelled = entry.total;
        for slot in 0..LABELS {
            sums.add(entry.ids[slot], entry.weights[slot]);
            unlabelled -= entry.weights[slot];
        }
        sums.total += unlabelled;
    }
    let mut count = 0;
    for (votes, summed) in votes.iter_mut().zip(&summed).filter(|(_, summed)| summed.total > 0.0) {
        let before = *votes;
        for slot in 0..LABELS {
            let share = summed.weights[slot] / summed.total.max(1.0);
            if share > 0.0 {
                votes.add(summed.ids[slot], share * settings.vote_weight(summed.ids[slot], contradicted));
            }
        }
        votes.cap(settings.max_votes);
        changes.replace(&before, votes);
        count += 1;
    }
    (count, changes)
}
