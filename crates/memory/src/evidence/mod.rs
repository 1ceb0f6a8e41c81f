//! The memory of evidence: every Gaussian keeps votes, how often it was seen as which segment.
//!
//! With blend weights `W` and `votes_i` of Gaussian `i`, the evidence for a segment at pixel `p` is
//! `E_p(id) = Σ_i W[p,i] · votes_i(id)`. Id 0, "no segment", takes part like any other.
//!
//! - **Expected** ([`EvidenceStore::read_tile`]): the id with the most evidence, if that exceeds `min_evidence` and the
//!   silhouette 0.5. Its confidence is that evidence, at most 1: what one fresh observation has.
//! - **Shown** ([`EvidenceStore::fuse`]): the id with the most evidence once the frame's own prediction has
//!   `observation_weight` of it; "no prediction" has `no_segment_weight` of that, for id 0.
//! - **Learnt** ([`EvidenceStore::learn`]): each Gaussian takes a vote for the predictions where it is seen. Predictions
//!   vote, not what was shown, so that evidence never confirms itself.

mod census;
mod votes;
mod voting;

pub use votes::Votes;

use crate::map::{NewGaussian, retain};
use crate::ply::SplatContentView;
use crate::recall::{Recall, TileSurface, cut};
use crate::segment_store::{SegmentStore, StoreTile};
use crate::{ABSTAIN, LearningExtent, MemoryError, MemorySettings, SegmentHold};
use census::{Census, CensusChanges};
use rayon::prelude::*;
use splatseg_geometry::{SegmentId, SegmentMap};
use splatseg_render::{Splats, TileWeights};
use voting::FrameVotes;

const PIXELS: usize = TileWeights::PIXELS;

/// A segment is expected only where the map covers at least this much of the pixel.
const MIN_SILHOUETTE: f32 = 0.5;

/// Where less light than this comes through what is gone, nothing can be told of what lies behind.
const MIN_LIGHT: f32 = 0.05;

/// Gaussians that one task counts when a memory is loaded.
const GAUSSIANS_PER_COUNT: usize = 1 << 16;

/// Votes per Gaussian.
#[derive(Clone, Debug)]
pub(crate) struct EvidenceStore {
    settings: MemorySettings,
    votes: Vec<Votes>,
    census: Census,
}

/// The id with the most evidence at each pixel of a tile, and that evidence.
struct Winners {
    ids: [SegmentId; PIXELS],
    evidence: [f32; PIXELS],
}

impl Winners {
    /// Lets an id compete. Of equal ones the smaller id wins, in whatever order Gaussians brought them.
    fn offer(&mut self, id: SegmentId, evidence: &[f32; PIXELS]) {
        // Without branches, so that the compiler compares several pixels at once.
        let winners = self.ids.iter_mut().zip(&mut self.evidence);
        for ((winner, most), found) in winners.zip(evidence) {
            let wins = (found > most) | ((found == most) & (id < *winner));
            (*winner, *most) = if wins { (id, *found) } else { (*winner, *most) };
        }
    }
}

impl EvidenceStore {
    /// A store for a map without Gaussians.
    pub fn new(settings: MemorySettings) -> Self {
        Self { settings, votes: Vec::new(), census: Census::default() }
    }

    /// The store of an earlier run.
    pub fn restored(settings: MemorySettings, votes: Vec<Votes>) -> Self {
        let count = |votes: &[Votes]| {
            let mut changes = CensusChanges::default();
            votes.iter().for_each(|votes| changes.add(votes, settings.min_evidence));
            changes
        };
        let counted: Vec<CensusChanges> = votes.par_chunks(GAUSSIANS_PER_COUNT).map(count).collect();
        let mut census = Census::default();
        counted.into_iter().for_each(|changes| census.apply(changes));
        Self { settings, votes, census }
    }

    /// `E_p(id)` of a tile: the ids, and `[ids, 16, 16]` of evidence.
    ///
    /// Only what lies near the observed depth counts. What lies in front of it is gone, or never was there: the light
    /// that it takes is given back to what is behind.
    fn evidence(&self, tile: &TileWeights, observed: &[f32; PIXELS]) -> (Vec<SegmentId>, Vec<f32>) {
        let tolerance = self.settings.depth_tolerance;
        let (mut ids, mut evidence): (Vec<SegmentId>, Vec<f32>) = (Vec::new(), Vec::new());
        let mut light = [1.0f32; PIXELS];
        let mut counted: Vec<(u8, f32)> = Vec::with_capacity(PIXELS);
        for (column, gaussian) in tile.gaussians().iter().enumerate() {
            let depth = tile.depths()[column];
            counted.clear();
            for (pixel, weight) in tile.column(column) {
                let observed = observed[usize::from(pixel)];
                let behind = if observed > 0.0 { depth - observed } else { 0.0 };
                if behind < -tolerance {
                    light[usize::from(pixel)] -= weight;
                } else if behind <= tolerance && weight >= self.settings.min_weight * light[usize::from(pixel)] {
                    counted.push((pixel, weight));
                }
            }
            if counted.is_empty() {
                continue;
            }
            for (id, votes) in self.votes[*gaussian as usize].iter() {
                // A tile shows few segments, and neighbours mostly the same one.
                let place = ids.iter().position(|known| *known == id).unwrap_or_else(|| {
                    ids.push(id);
                    evidence.resize(evidence.len() + PIXELS, 0.0);
                    ids.len() - 1
                });
                let pixels = &mut evidence.as_chunks_mut::<PIXELS>().0[place];
                for (pixel, weight) in &counted {
                    pixels[usize::from(*pixel)] += weight * votes;
                }
            }
        }
        if light.iter().any(|light| *light < 1.0) {
            for pixels in evidence.as_chunks_mut::<PIXELS>().0 {
                for (evidence, light) in pixels.iter_mut().zip(&light) {
                    *evidence /= light.max(MIN_LIGHT);
                }
            }
        }
        (ids, evidence)
    }
}

impl SegmentStore for EvidenceStore {
    fn read_tile(&self, tile: &TileWeights, surface: &TileSurface) -> StoreTile {
        let (ids, values) = self.evidence(tile, &surface.observed);
        let mut best = Winners { ids: [0; PIXELS], evidence: [0.0; PIXELS] };
        for (id, evidence) in ids.iter().zip(values.as_chunks().0) {
            best.offer(*id, evidence);
        }
        let (mut segments, mut confidence) = (best.ids.to_vec(), vec![0.0; PIXELS]);
        for pixel in 0..PIXELS {
            if best.evidence[pixel] <= self.settings.min_evidence || surface.silhouette[pixel] <= MIN_SILHOUETTE {
                segments[pixel] = 0;
            }
            if segments[pixel] != 0 {
                confidence[pixel] = best.evidence[pixel].min(1.0);
            }
        }
        StoreTile { segments, confidence, ids, values }
    }

    fn fuse(&self, recall: &Recall<'_>, seen: &SegmentMap) -> SegmentMap {
        let (observed, unobserved) =
            (self.settings.observation_weight, self.settings.observation_weight * self.settings.no_segment_weight);
        recall.map_tiles(|tile, found, fused| {
            let seen = cut(tile, seen);
            // What is seen competes with what is remembered; "no segment" needs no memory to compete.
            let weights = seen.map(|seen| match seen {
                ABSTAIN => 0.0,
                0 => unobserved,
                _ => observed,
            });
            let mut best = Winners { ids: seen.map(|seen| if seen == ABSTAIN { 0 } else { seen }), evidence: weights };
            let remembered = || found.ids.iter().zip(found.values.as_chunks::<PIXELS>().0);
            for (id, evidence) in remembered() {
                for pixel in 0..PIXELS {
                    best.evidence[pixel] += if seen[pixel] == *id { evidence[pixel] } else { 0.0 };
                }
            }
            for (id, evidence) in remembered() {
                best.offer(*id, evidence);
            }
            *fused = best.ids;
        })
    }

    fn grow(&mut self, added: &[NewGaussian], _: &Recall<'_>, seen: &SegmentMap) {
        let mut changes = CensusChanges::default();
        for gaussian in added {
            let votes = match seen.pixels()[gaussian.pixel] {
                0 => Votes::one(0, self.settings.no_segment_weight),
                ABSTAIN => Votes::default(),
                id => Votes::one(id, 1.0),
            };
            changes.add(&votes, self.settings.min_evidence);
            self.votes.push(votes);
        }
        self.census.apply(changes);
    }

    fn learn(&mut self, recall: &mut Recall<'_>, _: &dyn Splats, seen: &SegmentMap) -> LearningExtent {
        let (weights, depth) = (recall.view.weights(), recall.frame.depth());
        let frame = FrameVotes::count(weights, seen, depth, self.settings.depth_tolerance, self.votes.len());
        let (active_gaussians, changes) = frame.apply(&mut self.votes, &self.settings);
        self.census.apply(changes);
        LearningExtent { active_pixels: seen.pixels().len(), active_gaussians }
    }

    fn favour(&mut self, gaussians: &[u32], id: SegmentId) {
        let mut changes = CensusChanges::default();
        for gaussian in gaussians {
            let votes = &mut self.votes[*gaussian as usize];
            let before = *votes;
            votes.add(id, 2.0 * self.settings.max_votes);
            votes.cap(self.settings.max_votes);
            changes.replace(&before, votes, self.settings.min_evidence);
        }
        self.census.apply(changes);
    }

    fn retain(&mut self, keep: &[bool]) {
        let mut changes = CensusChanges::default();
        for (votes, _) in self.votes.iter().zip(keep).filter(|(_, keep)| !**keep) {
            changes.remove(votes, self.settings.min_evidence);
        }
        self.census.apply(changes);
        retain(&mut self.votes, keep);
    }

    fn new_segment(&mut self, _: SegmentId) -> Result<(), MemoryError> {
        Ok(())
    }

    fn segment_ids(&self) -> Vec<SegmentId> {
        self.votes.iter().map(|votes| votes.winner(self.settings.min_evidence)).collect()
    }

    fn segment_shares(&self) -> Option<Vec<f32>> {
        let share = |votes: &Votes| votes.share(votes.winner(self.settings.min_evidence));
        Some(self.votes.iter().map(share).collect())
    }

    fn changed_holds(&mut self) -> Option<Vec<(SegmentId, SegmentHold)>> {
        Some(self.census.take_changes())
    }

    fn numbers_per_gaussian(&self) -> usize {
        2 * Votes::SLOTS
    }

    fn content(&self) -> Option<SplatContentView<'_>> {
        Some(SplatContentView::Evidence { votes: &self.votes })
    }
}
