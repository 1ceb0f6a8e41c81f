//! Tubes, a segment's masks over several frames, as pixel counts.

use crate::overlap::{FrameOverlaps, Overlap};
use splatseg_geometry::SegmentId;
use std::collections::BTreeMap;

/// The number of a predicted tube: its id, or a running number where masks are linked.
pub(crate) type TubeId = u64;

/// Which tube each label of a frame belongs to.
#[derive(Clone, Copy, Debug)]
pub(crate) enum TubeOfLabel<'a> {
    /// Labels are ids, the same in every frame.
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

/// Areas of the true and predicted tubes of some frames, and of their intersections: all that VSQ needs to know about a
/// window, and STQ about a video. The maps are ordered, so that sums are always taken in the same order.
#[derive(Clone, Debug, Default)]
pub(crate) struct TubeCounts {
    pub(crate) truth_areas: BTreeMap<SegmentId, u64>,
    pub(crate) predicted_areas: BTreeMap<TubeId, u64>,
    /// By (true tube, predicted tube); pairs that do not overlap are absent.
    pub(crate) intersections: BTreeMap<(SegmentId, TubeId), u64>,
}

impl TubeCounts {
    /// Adds a frame. `overlaps` are its `full` or `flat` ones.
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

    /// Adds a predicted tube, without pixels if it is new.
    pub(crate) fn add_empty_tube(&mut self, tube: TubeId) {
        self.predicted_areas.entry(tube).or_insert(0);
    }

    /// Every overlapping pair with (intersection, true area, predicted area), by true and then predicted tube.
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

/// Pixel counts of a true and a predicted tube that overlap.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PairAreas {
    pub(crate) intersection: u64,
    pub(crate) truth: u64,
    pub(crate) predicted: u64,
}
