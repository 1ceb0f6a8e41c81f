//! Segmentation and tracking quality: STQ = √(AQ · SQ).

use crate::Protocol;
use crate::overlap::FrameOverlaps;
use crate::tubes::{PairAreas, TubeCounts, TubeOfLabel};
use serde::{Deserialize, Serialize};
use splatseg_geometry::SegmentId;
use std::collections::BTreeMap;

/// Counts of STQ. Counts of several videos can be added.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct StqCounts {
    /// Sum over true tracks g of (1/|g|) Σ over predicted tracks p of TPA² / |p ∪ g| (STEP, equation 3).
    pub sum_association: f64,
    /// Number of true tracks.
    pub tracks: u64,
    /// Number of true tracks that are counted more than once: overlapping predicted masks make the sum of their
    /// overlaps with all predicted tracks exceed their area. `sum_association` can then exceed `tracks`. Always 0 under
    /// [`Protocol::Strict`].
    pub overcounted_tracks: u64,
    /// Pixels with a true and a predicted label.
    pub labelled_predicted: u64,
    /// Pixels with a true label only.
    pub labelled_missed: u64,
    /// Pixels with a predicted label only.
    pub unlabelled_predicted: u64,
}

impl StqCounts {
    /// Association quality, in [0, 1] if predicted masks do not overlap; 0 without tracks.
    pub fn association_quality(&self) -> f64 {
        if self.tracks == 0 { 0.0 } else { self.sum_association / self.tracks as f64 }
    }

    /// Segmentation quality in [0, 1].
    ///
    /// If the denominator is 0, `Strict` gives 0, as in STEP's code. `Paper` gives `None`; the paper's code gives NaN.
    pub fn segmentation_quality(&self, protocol: Protocol) -> Option<f64> {
        let labelled = self.labelled_predicted + self.labelled_missed;
        let ratio = |intersection: u64, union: u64| intersection as f64 / union as f64;
        match protocol {
            Protocol::Strict => {
                let union = labelled + self.unlabelled_predicted;
                Some(if union == 0 { 0.0 } else { ratio(self.labelled_predicted, union) })
            }
            Protocol::Paper => {
                let recall = (labelled > 0).then(|| ratio(self.labelled_predicted, labelled))?;
                // If any labelled pixel is missed, background is a class with IoU 0.
                let classes = if self.labelled_missed > 0 { 2.0 } else { 1.0 };
                Some(recall / classes)
            }
        }
    }

    /// STQ in [0, 1]. `None` if the segmentation quality is `None`.
    pub fn quality(&self, protocol: Protocol) -> Option<f64> {
        self.segmentation_quality(protocol).map(|segmentation| (self.association_quality() * segmentation).sqrt())
    }

    pub(crate) fn add(&mut self, other: &Self) {
        self.sum_association += other.sum_association;
        self.tracks += other.tracks;
        self.overcounted_tracks += other.overcounted_tracks;
        self.labelled_predicted += other.labelled_predicted;
        self.labelled_missed += other.labelled_missed;
        self.unlabelled_predicted += other.unlabelled_predicted;
    }
}

/// Collects the counts of STQ, frame by frame. Keeps one count for each overlapping pair of tracks.
#[derive(Clone, Debug)]
pub(crate) struct StqAccumulator {
    protocol: Protocol,
    tracks: TubeCounts,
    counts: StqCounts,
}

impl StqAccumulator {
    pub(crate) fn new(protocol: Protocol) -> Self {
        Self { protocol, tracks: TubeCounts::default(), counts: StqCounts::default() }
    }

    /// Adds a frame.
    pub(crate) fn push(&mut self, frame: &FrameOverlaps, tube_of_label: TubeOfLabel) {
        let overlaps = match self.protocol {
            Protocol::Paper => frame.full(),
            Protocol::Strict => frame.flat(),
        };
        self.tracks.add(frame, overlaps, tube_of_label);
        self.counts.labelled_predicted += frame.labelled_predicted;
        self.counts.labelled_missed += frame.labelled_missed;
        self.counts.unlabelled_predicted += frame.unlabelled_predicted;
    }

    /// Contribution of each true track so far to [`StqCounts::sum_association`]. Tracks without overlap are absent.
    pub(crate) fn associations(&self) -> BTreeMap<SegmentId, f64> {
        let mut associations = BTreeMap::new();
        for (truth, _, areas) in self.tracks.pairs() {
            *associations.entry(truth).or_insert(0.0) += association(areas);
        }
        associations
    }

    pub(crate) fn finish(self) -> StqCounts {
        let sum_association = self.tracks.pairs().map(|(_, _, areas)| association(areas)).sum();
        let tracks = self.tracks.truth_areas.len() as u64;
        StqCounts { sum_association, tracks, overcounted_tracks: self.overcounted_tracks(), ..self.counts }
    }

    fn overcounted_tracks(&self) -> u64 {
        let mut covered: BTreeMap<SegmentId, u64> = BTreeMap::new();
        for (truth, _, areas) in self.tracks.pairs() {
            *covered.entry(truth).or_insert(0) += areas.intersection;
        }
        covered.iter().filter(|(truth, pixels)| **pixels > self.tracks.truth_areas[truth]).count() as u64
    }
}

/// (1/|g|) · TPA² / |p ∪ g| of a true and a predicted track.
fn association(areas: PairAreas) -> f64 {
    let shared = areas.intersection as f64;
    let union = (areas.truth + areas.predicted - areas.intersection) as f64;
    shared * (shared / union) / areas.truth as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quality_of_empty_counts() {
        let empty = StqCounts::default();
        assert_eq!(empty.quality(Protocol::Strict), Some(0.0));
        assert_eq!(empty.quality(Protocol::Paper), None);
    }

    #[test]
    fn the_papers_sq_is_half_the_recall_unless_nothing_is_missed() {
        let counts =
            StqCounts { labelled_predicted: 6, labelled_missed: 2, unlabelled_predicted: 4, ..Default::default() };
        assert_eq!(counts.segmentation_quality(Protocol::Paper), Some(0.375));
        assert_eq!(counts.segmentation_quality(Protocol::Strict), Some(0.5));
        let all_found = StqCounts { labelled_missed: 0, ..counts };
        assert_eq!(all_found.segmentation_quality(Protocol::Paper), Some(1.0));
    }
}
