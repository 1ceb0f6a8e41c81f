//! Overlaps of true segments and predicted labels in one frame.

use crate::prediction::Labels;
use crate::{ScoreSettings, Void};
use splatseg_geometry::{MaskRuns, SegmentId, SegmentMap};
use std::collections::BTreeMap;

/// Number of pixels shared by a true segment (0: unlabelled) and a predicted label (0: none).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Overlap {
    pub(crate) truth: SegmentId,
    pub(crate) label: SegmentId,
    pub(crate) pixels: u64,
}

/// The counts of one frame from which all metrics are computed. True segments below the minimum area are left out, as
/// are predictions on unlabelled pixels with [`Void::Excluded`].
#[derive(Debug)]
pub(crate) struct FrameOverlaps {
    /// Area of every true segment.
    pub(crate) truth_areas: BTreeMap<SegmentId, u64>,
    /// Overlaps of every predicted label (above 0), with its whole mask, and every true id or unlabelled pixels (0).
    full: Vec<Overlap>,
    /// The same with one label per pixel. `None` for a prediction with one label per pixel, for which `full` is the
    /// same.
    flat: Option<Vec<Overlap>>,
    /// Labels of predicted masks without pixels.
    pub(crate) empty_labels: Vec<SegmentId>,
    /// Pixels with a true and a predicted label.
    pub(crate) labelled_predicted: u64,
    /// Pixels with a true label only.
    pub(crate) labelled_missed: u64,
    /// Pixels with a predicted label only.
    pub(crate) unlabelled_predicted: u64,
}

impl FrameOverlaps {
    /// Counts a frame. `truth` and `labels` must have the same size.
    pub(crate) fn count(truth: &SegmentMap, labels: &Labels, settings: &ScoreSettings) -> Self {
        let min_area = settings.min_ground_truth_area * truth.pixels().len() as f64;
        let mut truth_areas: BTreeMap<SegmentId, u64> =
            truth.areas().into_iter().map(|(id, area)| (id, area as u64)).collect();
        truth_areas.retain(|_, area| *area as f64 >= min_area);

        let cleaned = |mut overlaps: Vec<Overlap>| {
            for overlap in &mut overlaps {
                if !truth_areas.contains_key(&overlap.truth) {
                    overlap.truth = 0;
                }
            }
            overlaps.retain(|overlap| overlap.label != 0 && (overlap.truth != 0 || settings.void == Void::Counted));
            overlaps
        };
        let (full, flat, empty_labels) = match labels {
            Labels::Map(map) => (cleaned(overlaps_of_map(truth, map.pixels())), None, Vec::new()),
            Labels::Masks(masks) => {
                let full = cleaned(overlaps_of_masks(truth, masks));
                let flat = cleaned(overlaps_of_map(truth, &composited(masks, truth.pixels().len())));
                let empty = masks.iter().filter(|(_, runs)| runs.area() == 0).map(|(label, _)| *label).collect();
                (full, Some(flat), empty)
            }
        };
        let one_per_pixel = flat.as_ref().unwrap_or(&full);
        let predicted_pixels =
            |labelled: bool| one_per_pixel.iter().filter(|o| (o.truth != 0) == labelled).map(|o| o.pixels).sum::<u64>();
        let (labelled_predicted, unlabelled_predicted) = (predicted_pixels(true), predicted_pixels(false));
        let labelled_missed = truth_areas.values().sum::<u64>() - labelled_predicted;
        Self { truth_areas, full, flat, empty_labels, labelled_predicted, labelled_missed, unlabelled_predicted }
    }

    /// Overlaps with every predicted mask in full.
    pub(crate) fn full(&self) -> &[Overlap] {
        &self.full
    }

    /// Overlaps with one label per pixel.
    pub(crate) fn flat(&self) -> &[Overlap] {
        self.flat.as_ref().unwrap_or(&self.full)
    }
}

/// Composites masks that may overlap to one label per pixel. The smallest mask is on top; ties go to the lowest label.
/// The paper's code uses the same order (`binmasks_to_panomask` in `metrics/utils.py`).
pub(crate) fn composited(masks: &[(SegmentId, MaskRuns)], pixels: usize) -> Vec<SegmentId> {
    let mut order: Vec<&(SegmentId, MaskRuns)> = masks.iter().collect();
    order.sort_by_key(|(label, runs)| std::cmp::Reverse((runs.area(), *label)));
    let mut map = vec![0; pixels];
    for (label, runs) in order {
        for run in runs.runs() {
            map[run.clone()].fill(*label);
        }
    }
    map
}

/// Counts equal (truth, label) pairs, including label 0. Collects runs first, since neighbours are mostly equal.
fn overlaps_of_map(truth: &SegmentMap, labels: &[SegmentId]) -> Vec<Overlap> {
    let mut pairs = truth.pixels().iter().zip(labels);
    let Some((truth_id, label)) = pairs.next() else { return Vec::new() };
    let mut run = Overlap { truth: *truth_id, label: *label, pixels: 1 };
    let mut runs = Vec::new();
    for (truth_id, label) in pairs {
        if (*truth_id, *label) == (run.truth, run.label) {
            run.pixels += 1;
        } else {
            runs.push(run);
            run = Overlap { truth: *truth_id, label: *label, pixels: 1 };
        }
    }
    runs.push(run);
    merged(runs)
}

fn overlaps_of_masks(truth: &SegmentMap, masks: &[(SegmentId, MaskRuns)]) -> Vec<Overlap> {
    let mut runs = Vec::new();
    for (label, mask) in masks {
        for run in mask.runs() {
            for same in truth.pixels()[run.clone()].chunk_by(|left, right| left == right) {
                runs.push(Overlap { truth: same[0], label: *label, pixels: same.len() as u64 });
            }
        }
    }
    merged(runs)
}

/// Sums the runs of each (truth, label). The result is sorted by both.
fn merged(mut runs: Vec<Overlap>) -> Vec<Overlap> {
    runs.sort_unstable_by_key(|run| (run.truth, run.label));
    runs.dedup_by(|later, first| {
        let same = (later.truth, later.label) == (first.truth, first.label);
        if same {
            first.pixels += later.pixels;
        }
        same
    });
    runs
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::FramePrediction;
    use splatseg_geometry::Mask;

    /// Truth 1 1 0 2; masks 5 = pixels 0..3 and 6 = pixels 2..4.
    fn counted(settings: &ScoreSettings) -> FrameOverlaps {
        let truth = SegmentMap::from_pixels(4, 1, vec![1, 1, 0, 2]).unwrap();
        let masks =
            [(5, Mask::from_fn(4, 1, |column, _| column < 3)), (6, Mask::from_fn(4, 1, |column, _| column >= 2))];
        let labels = FramePrediction::Masks(&masks).labels(0, (4, 1)).unwrap();
        FrameOverlaps::count(&truth, &labels, settings)
    }

    fn triples(overlaps: &[Overlap]) -> Vec<(u32, u32, u64)> {
        overlaps.iter().map(|overlap| (overlap.truth, overlap.label, overlap.pixels)).collect()
    }

    #[test]
    fn overlapping_masks_count_in_full_and_the_smaller_is_on_top() {
        let frame = counted(&ScoreSettings::default());
        assert_eq!(triples(frame.full()), [(0, 5, 1), (0, 6, 1), (1, 5, 2), (2, 6, 1)]);
        assert_eq!(triples(frame.flat()), [(0, 6, 1), (1, 5, 2), (2, 6, 1)]);
        assert_eq!((frame.labelled_predicted, frame.labelled_missed, frame.unlabelled_predicted), (3, 0, 1));
    }

    #[test]
    fn unlabelled_pixels_and_small_truths_can_be_left_out() {
        let settings = ScoreSettings { void: Void::Excluded, min_ground_truth_area: 0.3, ..ScoreSettings::default() };
        let frame = counted(&settings);
        assert_eq!(triples(frame.full()), [(1, 5, 2)]);
        assert_eq!(frame.truth_areas.into_iter().collect::<Vec<_>>(), [(1, 2)]);
    }

    #[test]
    fn a_truth_of_exactly_the_smallest_area_stays() {
        let settings = ScoreSettings { min_ground_truth_area: 0.25, ..ScoreSettings::default() };
        assert_eq!(counted(&settings).truth_areas.len(), 2);
    }
}
