//! The memory of evidence: every Gaussian keeps votes for the segments that it was predicted as.
//!
//! With blend weights `W` and `votes_i` of Gaussian `i`, the evidence for a segment at pixel `p` is
//! `E_p(id) = Σ_i W[p,i] · votes_i(id)`. Id 0, "no segment", takes part like any other.
//!
//! - **Expected** ([`EvidenceStore::read_tile`]): the id with the most evidence, where the silhouette exceeds
//!   [`COVERED`]. Its confidence is that evidence, at most 1, the evidence of one fresh observation.
//! - **Fused** ([`EvidenceStore::fuse`]): the id with the most evidence once the frame's own prediction has added one
//!   vote; "no prediction" adds `no_segment_weight` to id 0.
//! - **Learnt** ([`EvidenceStore::learn`]): each Gaussian gets a vote, split over the predictions where it is seen. The
//!   predictions vote, not the fused segments, so that evidence never confirms itself.

mod census;
mod votes;
mod voting;

pub use votes::Votes;

use crate::map::{NewGaussian, retain};
use crate::ply::SplatContentView;
use crate::recall::{Recall, StoreTile};
use crate::segment_store::{LearningStats, SegmentStore};
use crate::settings::COVERED;
use crate::tile_surface::{RUN, SurfaceDepths, TileSurface, any, cut, run, run_mut};
use crate::{MemoryError, MemorySettings, SegmentHold, Verdict};
use census::{Census, CensusChanges};
use rayon::prelude::*;
use splatseg_geometry::{SegmentId, SegmentMap};
use splatseg_kernels::{Instructions, Vectorize};
use splatseg_render::{Splats, TileWeights};
use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};
use voting::FrameVotes;

const PIXELS: usize = TileWeights::PIXELS;

/// If less light than this comes through Gaussians in front of the observed surface, evidence behind them is
/// unreliable: the correction for that light divides by at least this.
const MIN_TRANSMITTANCE: f32 = 0.05;

/// A second opinion with less evidence, relative to one vote for a contradicted mask, is what is left of a thing that was
/// there.
const MIN_OPINION: f32 = 0.4;

/// Gaussians counted per task when a memory is loaded.
const GAUSSIANS_PER_COUNT: usize = 1 << 16;

/// Votes per Gaussian.
#[derive(Clone, Debug)]
pub(crate) struct EvidenceStore {
    settings: MemorySettings,
    votes: Vec<Votes>,
    census: Census,
}

/// The id with the most evidence at each pixel of a tile, and that evidence.
struct ArgMax {
    ids: [SegmentId; PIXELS],
    evidence: [f32; PIXELS],
}

impl ArgMax {
    /// Replaces the id where `id` has more evidence. Of ids with equal evidence the smaller one wins, so that the order of
    /// Gaussians does not matter.
    fn update(&mut self, id: SegmentId, evidence: &[f32; PIXELS]) {
        // Without branches, so that the compiler compares several pixels at once.
        let entries = self.ids.iter_mut().zip(&mut self.evidence);
        for ((winner, most), found) in entries.zip(evidence) {
            let wins = (found > most) | ((found == most) & (id < *winner));
            (*winner, *most) = if wins { (id, *found) } else { (*winner, *most) };
        }
    }
}

impl EvidenceStore {
    /// Creates a store for a map without Gaussians.
    pub fn new(settings: MemorySettings) -> Self {
        Self { settings, votes: Vec::new(), census: Census::default() }
    }

    /// Restores the store of an earlier run.
    pub fn restored(settings: MemorySettings, votes: Vec<Votes>) -> Self {
        let count = |votes: &[Votes]| {
            let mut changes = CensusChanges::default();
            votes.iter().for_each(|votes| changes.add(votes));
            changes
        };
        let counted: Vec<CensusChanges> = votes.par_chunks(GAUSSIANS_PER_COUNT).map(count).collect();
        let mut census = Census::default();
        counted.into_iter().for_each(|changes| census.apply(changes));
        Self { settings, votes, census }
    }

    /// The votes of a Gaussian and the verdict on it. Together they weigh no more than votes do, or Gaussians that were seen
    /// often would outvote their neighbours.
    #[inline(always)]
    fn votes_with(&self, verdicts: &[Verdict], gaussian: usize) -> Votes {
        let mut votes = self.votes[gaussian];
        if let Some(verdict) = verdicts.get(gaussian).filter(|verdict| verdict.id != 0) {
            votes.add(verdict.id, verdict.votes);
            votes.cap(self.settings.max_votes);
        }
        votes
    }

    /// [`Self::votes_with`] of all Gaussians.
    fn all_with(&self, verdicts: &[Verdict]) -> impl Iterator<Item = Votes> {
        (0..self.votes.len()).map(|gaussian| self.votes_with(verdicts, gaussian))
    }

    /// Returns `E_p(id)` of a tile: the ids, and their evidence `[ids, 16, 16]`.
    ///
    /// Only Gaussians near the observed depth count. Gaussians in front of it are gone or were wrong: the light that
    /// they block is returned to the Gaussians behind.
    fn evidence(
        &self,
        tile: &TileWeights,
        observed: &[f32; PIXELS],
        verdicts: &[Verdict],
    ) -> (Vec<SegmentId>, Vec<f32>) {
        let depths = SurfaceDepths::new(observed, &self.settings);
        Instructions::best().run(SumEvidence { store: self, tile, depths: &depths, verdicts })
    }
}

/// The sum of [`EvidenceStore::evidence`].
struct SumEvidence<'a> {
    store: &'a EvidenceStore,
    tile: &'a TileWeights,
    depths: &'a SurfaceDepths,
    verdicts: &'a [Verdict],
}

impl Vectorize for SumEvidence<'_> {
    type Output = (Vec<SegmentId>, Vec<f32>);

    #[inline(always)]
    fn run(self) -> (Vec<SegmentId>, Vec<f32>) {
        let Self { store, tile, depths, verdicts } = self;
        let (mut ids, mut evidence): (Vec<SegmentId>, Vec<f32>) = (Vec::new(), Vec::new());
        let mut light = [1.0f32; PIXELS];
        let mut counted = [[0f32; RUN]; PIXELS / RUN];
        for column in 0..tile.gaussians().len() {
            let (gaussian, depth) = (tile.gaussians()[column], tile.depths()[column]);
            let (firsts, weights) = tile.runs(column);
            let runs = firsts.len().min(weights.len()).min(counted.len());
            let mut is_seen = false;
            for index in 0..runs {
                let in_front = depths.in_front(firsts[index], depth, &weights[index]);
                let mut left = *run(&light, firsts[index]);
                for lane in 0..RUN {
                    left[lane] -= in_front[lane];
                }
                *run_mut(&mut light, firsts[index]) = left;
                counted[index] = depths.seen(firsts[index], depth, &weights[index]);
                is_seen |= any(&counted[index]);
            }
            if !is_seen {
                continue;
            }
            for (id, votes) in store.votes_with(verdicts, gaussian as usize).iter() {
                // A tile shows few segments, and neighbours mostly show the same one.
                let place = ids.iter().position(|known| *known == id).unwrap_or_else(|| {
                    ids.push(id);
                    evidence.resize(evidence.len() + PIXELS, 0.0);
                    ids.len() - 1
                });
                let pixels = &mut evidence.as_chunks_mut::<PIXELS>().0[place];
                for index in 0..runs {
                    let mut sums = *run(pixels, firsts[index]);
                    for lane in 0..RUN {
                        sums[lane] += counted[index][lane] * votes;
                    }
                    *run_mut(pixels, firsts[index]) = sums;
                }
            }
        }
        if light.iter().any(|light| *light < 1.0) {
            for pixels in evidence.as_chunks_mut::<PIXELS>().0 {
                for (evidence, light) in pixels.iter_mut().zip(&light) {
                    *evidence /= light.max(MIN_TRANSMITTANCE);
                }
            }
        }
        (ids, evidence)
    }
}

impl SegmentStore for EvidenceStore {
    fn read_tile(&self, tile: &TileWeights, surface: &TileSurface) -> StoreTile {
        self.read_tile_with(tile, surface, &[])
    }

    fn read_tile_with(&self, tile: &TileWeights, surface: &TileSurface, verdicts: &[Verdict]) -> StoreTile {
        let (ids, values) = self.evidence(tile, &surface.observed, verdicts);
        let mut best = ArgMax { ids: [0; PIXELS], evidence: [0.0; PIXELS] };
        for (id, evidence) in ids.iter().zip(values.as_chunks().0) {
            best.update(*id, evidence);
        }
        let (mut segments, mut confidence) = (best.ids.to_vec(), vec![0.0; PIXELS]);
        for pixel in 0..PIXELS {
            if surface.silhouette[pixel] <= COVERED {
                segments[pixel] = 0;
            }
            if segments[pixel] != 0 {
                confidence[pixel] = best.evidence[pixel].min(1.0);
            }
        }
        StoreTile { segments, confidence, ids, values }
    }

    fn fuse(&self, recall: &Recall<'_>, predicted: &SegmentMap) -> SegmentMap {
        let weight = |id: SegmentId| if id == 0 { self.settings.no_segment_weight } else { 1.0 };
        recall.map_tiles(|tile, found, fused| {
            let predicted = cut(tile, predicted);
            // The prediction competes with the remembered ids, even with "no segment", which needs no votes.
            let mut best = ArgMax { ids: predicted, evidence: predicted.map(weight) };
            let remembered = || found.ids.iter().zip(found.values.as_chunks::<PIXELS>().0);
            for (id, evidence) in remembered() {
                for pixel in 0..PIXELS {
                    best.evidence[pixel] += if predicted[pixel] == *id { evidence[pixel] } else { 0.0 };
                }
            }
            for (id, evidence) in remembered() {
                best.update(*id, evidence);
            }
            *fused = best.ids;
        })
    }

    fn second_opinion(&self, recall: &Recall<'_>) -> SegmentMap {
        let expected = &recall.belief.segments;
        let least = MIN_OPINION * self.settings.contradicted_weight;
        recall.map_tiles(|tile, found, second| {
            let expected = cut(tile, expected);
            let mut best = ArgMax { ids: [0; PIXELS], evidence: [0.0; PIXELS] };
            for (id, evidence) in found.ids.iter().zip(found.values.as_chunks::<PIXELS>().0).filter(|(id, _)| **id != 0)
            {
                let mut others = *evidence;
                for (evidence, expected) in others.iter_mut().zip(&expected) {
                    *evidence = if expected == id { 0.0 } else { *evidence };
                }
                best.update(*id, &others);
            }
            for ((second, id), evidence) in second.iter_mut().zip(best.ids).zip(best.evidence) {
                *second = if evidence >= least { id } else { 0 };
            }
        })
    }

    fn grow(
        &mut self,
        added: &[NewGaussian],
        _: &Recall<'_>,
        predicted: &SegmentMap,
        contradicted: &BTreeSet<SegmentId>,
    ) {
        let mut changes = CensusChanges::default();
        for gaussian in added {
            let id = predicted.pixels()[gaussian.pixel];
            let votes = Votes::one(id, self.settings.vote_weight(id, contradicted));
            changes.add(&votes);
            self.votes.push(votes);
        }
        self.census.apply(changes);
    }

    fn replace(&mut self, replaced: &[(usize, SegmentId)]) {
        let mut changes = CensusChanges::default();
        for (gaussian, id) in replaced {
            let votes = Votes::one(*id, 1.0);
            changes.replace(&self.votes[*gaussian], &votes);
            self.votes[*gaussian] = votes;
        }
        self.census.apply(changes);
    }

    fn learn(
        &mut self,
        recall: &Recall<'_>,
        _: &dyn Splats,
        predicted: &SegmentMap,
        contradicted: &BTreeSet<SegmentId>,
    ) -> LearningStats {
        let (weights, depth) = (recall.view.weights(), recall.frame.depth());
        let frame = FrameVotes::count(weights, predicted, depth, &self.settings, self.votes.len());
        let (active_gaussians, changes) = frame.apply(&mut self.votes, contradicted, &self.settings);
        self.census.apply(changes);
        LearningStats { active_pixels: predicted.pixels().len(), active_gaussians }
    }

    fn retain(&mut self, keep: &[bool]) {
        let mut changes = CensusChanges::default();
        for (votes, _) in self.votes.iter().zip(keep).filter(|(_, keep)| !**keep) {
            changes.remove(votes);
        }
        self.census.apply(changes);
        retain(&mut self.votes, keep);
    }

    fn can_remap(&self) -> bool {
        true
    }

    fn remap(&mut self, names: &BTreeMap<SegmentId, SegmentId>) {
        let mut changes = CensusChanges::default();
        for votes in &mut self.votes {
            if votes.iter().any(|(id, _)| names.contains_key(&id)) {
                let renamed = votes.renamed(|id| names.get(&id).copied().unwrap_or(id));
                changes.replace(votes, &renamed);
                *votes = renamed;
            }
        }
        self.census.apply(changes);
    }

    fn count_verdicts(&mut self, verdicts: &[Verdict]) {
        let mut changes = CensusChanges::default();
        for gaussian in 0..self.votes.len().min(verdicts.len()) {
            let votes = self.votes_with(verdicts, gaussian);
            changes.replace(&self.votes[gaussian], &votes);
            self.votes[gaussian] = votes;
        }
        self.census.apply(changes);
    }

    fn merge_gaussian(&mut self, from: usize, into: usize) {
        let (more, before) = (self.votes[from], self.votes[into]);
        let votes = &mut self.votes[into];
        more.iter().for_each(|(id, more)| votes.add(id, more));
        votes.cap(self.settings.max_votes);
        let mut changes = CensusChanges::default();
        changes.replace(&before, votes);
        self.census.apply(changes);
    }

    fn append(&mut self, content: SplatContentView<'_>) -> bool {
        let SplatContentView::Evidence { votes } = content else { return false };
        let mut changes = CensusChanges::default();
        votes.iter().for_each(|votes| changes.add(votes));
        self.census.apply(changes);
        self.votes.extend_from_slice(&votes);
        true
    }

    fn new_segment(&mut self, _: SegmentId) -> Result<(), MemoryError> {
        Ok(())
    }

    fn segment_ids(&self) -> Vec<SegmentId> {
        self.votes.iter().map(|votes| votes.winner()).collect()
    }

    fn segment_ids_with(&self, verdicts: &[Verdict]) -> Vec<SegmentId> {
        self.all_with(verdicts).map(|votes| votes.winner()).collect()
    }

    fn segment_shares(&self, verdicts: &[Verdict]) -> Option<Vec<f32>> {
        Some(self.all_with(verdicts).map(|votes| votes.share(votes.winner())).collect())
    }

    fn segment_votes(&self, verdicts: &[Verdict]) -> Option<Vec<f32>> {
        Some(self.all_with(verdicts).map(|votes| votes.most()).collect())
    }

    fn changed_holds(&mut self) -> Option<Vec<(SegmentId, SegmentHold)>> {
        Some(self.census.take_changes())
    }

    fn numbers_per_gaussian(&self) -> usize {
        2 * Votes::SLOTS
    }

    fn content(&self) -> Option<SplatContentView<'_>> {
        Some(SplatContentView::Evidence { votes: Cow::Borrowed(&self.votes) })
    }

    fn content_with(&self, verdicts: &[Verdict]) -> Option<SplatContentView<'_>> {
        match verdicts {
            [] => self.content(),
            _ => Some(SplatContentView::Evidence { votes: self.all_with(verdicts).collect() }),
        }
    }
}
