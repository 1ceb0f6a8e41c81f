//! The votes that one frame gives.

use super::Votes;
use super::census::CensusChanges;
use crate::recall::cut;
use crate::{ABSTAIN, MemorySettings};
use rayon::prelude::*;
use splatseg_geometry::{CowImage, SegmentId, SegmentMap};
use splatseg_render::{BlendWeights, TileWeights};

/// Labels that one Gaussian can get votes for in a frame: those with the most weight.
const LABELS: usize = Votes::SLOTS;

/// Gaussians updated by one task.
const CHUNK: usize = 4096;

/// Blend weights of one Gaussian by the label of the pixel, in one tile or in the image.
#[derive(Clone, Copy, Debug, Default)]
struct Labelled {
    gaussian: u32,
    /// Sum over all pixels, whatever their label.
    total: f32,
    ids: [SegmentId; LABELS],
    weights: [f32; LABELS],
}

/// What every Gaussian in view was seen as in a frame.
pub(super) struct FrameVotes {
    /// Tile by tile: a Gaussian has an entry in each tile that it touches.
    by_tile: Vec<Vec<Labelled>>,
    gaussian_count: usize,
}

impl FrameVotes {
    /// Counts for each Gaussian the labels of the pixels that see it: Σ over the pixels of label ℓ of `W[p, i]`.
    ///
    /// A Gaussian is seen at a pixel only if it lies within `tolerance` of the depth observed there, or nothing is
    /// observed there. Behind a surface, some light comes through, but the label is not that of what lies there; and the
    /// edge of a Gaussian in front reaches over pixels that show what lies behind it.
    pub fn count(
        weights: &BlendWeights,
        labels: &SegmentMap,
        depth: &CowImage<'_, f32>,
        tolerance: f32,
        gaussian_count: usize,
    ) -> Self {
        let by_tile = weights.tiles().par_iter().map(|tile| count_tile(tile, labels, depth, tolerance)).collect();
        Self { by_tile, gaussian_count }
    }

    /// Gives every Gaussian its votes: a label's share of what is seen of the Gaussian, or the weight itself where less
    /// than a pixel is. Returns how many Gaussians had votes, and what that changes for ids.
    pub fn apply(&self, votes: &mut [Votes], settings: &MemorySettings) -> (usize, CensusChanges) {
        let chunks = self.gaussian_count.div_ceil(CHUNK);
        let mut by_chunk: Vec<Vec<&Labelled>> = vec![Vec::new(); chunks];
        for labelled in self.by_tile.iter().flatten() {
            by_chunk[labelled.gaussian as usize / CHUNK].push(labelled);
        }
        let applied: Vec<(usize, CensusChanges)> = votes
            .par_chunks_mut(CHUNK)
            .zip(by_chunk)
            .enumerate()
            .map(|(chunk, (votes, entries))| apply_chunk(votes, &entries, chunk * CHUNK, settings))
            .collect();
        let (mut count, mut changes) = (0, CensusChanges::default());
        for (of_chunk, changes_of_chunk) in applied {
            count += of_chunk;
            changes.merge(changes_of_chunk);
        }
        (count, changes)
    }
}

impl Labelled {
    #[inline(always)]
    fn add(&mut self, id: SegmentId, weight: f32) {
        self.total += weight;
        if weight == 0.0 || id == ABSTAIN {
            return;
        }
        for slot in 0..LABELS {
            if self.weights[slot] == 0.0 || self.ids[slot] == id {
                self.ids[slot] = id;
                self.weights[slot] += weight;
                return;
            }
        }
        // A fifth label is rare and has little weight: it counts in the total alone.
    }
}

fn count_tile(tile: &TileWeights, labels: &SegmentMap, depth: &CowImage<'_, f32>, tolerance: f32) -> Vec<Labelled> {
    let labels = cut(tile, labels);
    let observed = cut(tile, depth);
    let measured = observed.iter().copied().filter(|observed| *observed > 0.0);
    let (nearest, farthest) = measured.fold((f32::INFINITY, 0.0f32), |(min, max), at| (min.min(at), max.max(at)));
    tile.gaussians()
        .iter()
        .enumerate()
        .map(|(column, gaussian)| {
            let mut labelled = Labelled { gaussian: *gaussian, ..Labelled::default() };
            // Runs of one label are added before they are looked up.
            let (mut current, mut sum) = (0, 0.0);
            let depth = tile.depths()[column];
            // Most tiles show one surface: then no pixel needs to be looked at.
            let is_near_all = depth <= nearest + tolerance && depth >= farthest - tolerance;
            for (pixel, weight) in tile.column(column) {
                let observed = observed[usize::from(pixel)];
                if !is_near_all && observed > 0.0 && (depth - observed).abs() > tolerance {
                    continue;
                }
                let label = labels[usize::from(pixel)];
                if label != current {
                    labelled.add(current, sum);
                    (current, sum) = (label, 0.0);
                }
                sum += weight;
            }
            labelled.add(current, sum);
            labelled
        })
        .collect()
}

/// Adds up the tiles' entries of the Gaussians from `first` on, in the order of tiles, and gives the votes.
fn apply_chunk(
    votes: &mut [Votes],
    entries: &[&Labelled],
    first: usize,
    settings: &MemorySettings,
) -> (usize, CensusChanges) {
    let mut changes = CensusChanges::default();
    if entries.is_empty() {
        return (0, changes);
    }
    let mut seen = vec![Labelled::default(); votes.len()];
    for entry in entries {
        let sums = &mut seen[entry.gaussian as usize - first];
        let mut unlabelled = entry.total;
        for slot in 0..LABELS {
            sums.add(entry.ids[slot], entry.weights[slot]);
            unlabelled -= entry.weights[slot];
        }
        sums.total += unlabelled;
    }
    let mut count = 0;
    for (votes, seen) in votes.iter_mut().zip(&seen).filter(|(_, seen)| seen.total > 0.0) {
        let before = *votes;
        for slot in 0..LABELS {
            let share = seen.weights[slot] / seen.total.max(1.0);
            let share = if seen.ids[slot] == 0 { share * settings.no_segment_weight } else { share };
            if share > 0.0 {
                votes.add(seen.ids[slot], share);
            }
        }
        votes.cap(settings.max_votes);
        changes.replace(&before, votes, settings.min_evidence);
        count += 1;
    }
    (count, changes)
}
