//! The votes from one frame.

use super::Votes;
use super::census::CensusChanges;
use crate::MemorySettings;
use crate::recall::cut;
use rayon::prelude::*;
use splatseg_geometry::{CowImage, SegmentId, SegmentMap};
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
    let labels = cut(tile, labels);
    let observed = cut(tile, depth);
    let measured = observed.iter().copied().filter(|observed| *observed > 0.0);
    let (nearest, farthest) = measured.fold((f32::INFINITY, 0.0f32), |(min, max), at| (min.min(at), max.max(at)));
    tile.gaussians()
        .iter()
        .enumerate()
        .map(|(column, gaussian)| {
            let mut label_weights = LabelWeights { gaussian: *gaussian, ..LabelWeights::default() };
            // Runs of one label are added before they are looked up.
            let (mut current, mut sum) = (0, 0.0);
            let depth = tile.depths()[column];
            // Most tiles show one surface: then pixels need no test of their own.
            let is_near_all =
                depth <= nearest + settings.tolerance_at(nearest) && depth >= farthest - settings.tolerance_at(nearest);
            for (pixel, weight) in tile.column(column) {
                let observed = observed[usize::from(pixel)];
                if !is_near_all && observed > 0.0 && (depth - observed).abs() > settings.tolerance_at(observed) {
                    continue;
                }
                let label = labels[usize::from(pixel)];
                if label != current {
                    label_weights.add(current, sum);
                    (current, sum) = (label, 0.0);
                }
                sum += weight;
            }
            label_weights.add(current, sum);
            label_weights
        })
        .collect()
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
