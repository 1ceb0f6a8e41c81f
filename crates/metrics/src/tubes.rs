//! Pixel counts of tubes. A tube is the masks of a segment over several frames.

use crate::overlap::{FrameOverlaps, Overlap};
use splatseg_geometry::SegmentId;
use std::collections::BTreeMap;

/// Number of a predicted tube: its id, or a running number for linked masks.
pub(crate) type TubeId = u64;

/// Mapping from the labels of a frame to tubes.
#[derive(Clone, Copy, Debug)]
pub(crate) enum TubeOfLabel<'a> {
    /// Labels are ids that are the same in every frame.
    Id,
    /// Label `i + 1` belongs to tube `tubes[i]`.
    Linked(&'a [TubeId]),
}

impl TubeOfLabel<'_> {
    pub(crate) fn tube(self, label: SegmentId) -> TubeId {
        match self {
            Self::Id => TubeId::from(label),
            Self::Linked(tubes) => tubes[label as usize - 1],
        }
    }
}

/// Areas of the true and predicted tubes of several frames, and of their intersections, for VSQ of a window or STQ of a
/// video. The maps are ordered, so that sums are always computed in the same order.
#[derive(Clone, Debug, Default)]
pub(crate) struct TubeCounts {
    pub(crate) truth_areas: BTreeMap<SegmentId, u64>,
    pub(crate) predicted_areas: BTreeMap<TubeId, u64>,
    /// By (true tube, predicted tube); pairs that do not overlap are absent.
    pub(crate) intersections: BTreeMap<(SegmentId, TubeId), u64>,
}

impl TubeCounts {
    /// Adds a frame. `overlaps` are its [`full`](FrameOverlaps::full) or [`flat`](FrameOverlaps::flat) overlaps.
    pub(crate) fn add(&mut self, frame: &FrameOverlaps, overlaps: &[Overlap], tube_of_label: TubeOfLabel) {
        for (truth, area) in &frame.truth_areas {
            *self.truth_areas.entry(*truth).or_insert(0) += area;
        }
        for overlap in overlaps {
            let tube = tube_of_label.tube(overlap.label);
            *self.predicted_areas.entry(tube).or_insert(0) += overlap.pixels;
            if overlap.truth != 0 {
                *self.intersections.entry((overlap.truth, tube)).or_insert(0) += overlap.pixels;
            }
        }
    }

    /// Adds a predicted tube without pixels, unless it exists.
    pub(crate) fn add_empty_tube(&mut self, tube: TubeId) {
        self.predicted_areas.entry(tube).or_insert(0);
    }

    /// Every overlapping pair with its areas, sorted by true tube, then by predicted tube.
    pub(crate) fn pairs(&self) -> impl Iterator<Item = (SegmentId, TubeId, PairAreas)> + '_ {
        self.intersections.iter().map(|((truth, tube), intersection)| {
            let areas = PairAreas {
                intersection: *intersection,
                truth: self.truth_areas[truth],
                predicted: self.predicted_areas[tube],
            };
            (*truth, *tube, areas)
        })
    }
}

/// Pixel counts of an overlapping pair of a true and a predicted tube.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PairAreas {
    pub(crate) intersection: u64,
    pub(crate) truth: u64,
    pub(crate) predicted: u64,
}
