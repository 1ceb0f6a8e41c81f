//! Average precision and recall as COCO defines them (`cocoeval.py` of github.com/cocodataset/cocoapi), with one class.

use crate::SizeClass;
use crate::overlap::FrameOverlaps;
use serde::{Deserialize, Serialize};
use splatseg_geometry::{Ratio, SegmentId};
use std::collections::BTreeMap;

/// IoUs in twentieths: 0.5, 0.55, …, 0.95.
const IOUS: [u64; 10] = [10, 11, 12, 13, 14, 15, 16, 17, 18, 19];
/// Maximum number of segments in a frame. Only the most confident ones count.
const MAX_SEGMENTS: usize = 100;
/// Number of confidence levels. Segments of the same level are treated as equally confident.
const CONFIDENCE_STEPS: f32 = 100.0;
/// Number of intervals between the points of the precision-recall curve, at recalls of 0, 0.01, …, 1.
const RECALL_STEPS: u64 = 100;

/// Counts of segments as detections of true objects.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct DetectionCounts {
    /// By the object's area in the frame: number of true objects in all frames, and number of objects found, summed
    /// over IoU thresholds.
    pub objects: BTreeMap<SizeClass, (u64, u64)>,
    /// Segments with known confidence, by confidence in hundredths, rounded down.
    pub by_confidence: BTreeMap<u8, ConfidenceCounts>,
    /// Number of segments with unknown confidence.
    pub without_confidence: u64,
}

/// The segments of one confidence level.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ConfidenceCounts {
    /// Number of segments.
    pub segments: u32,
    /// Number of segments that match an object at IoU thresholds of 0.5, 0.55, …, 0.95.
    pub right: [u32; 10],
}

impl DetectionCounts {
    /// Adds a frame.
    pub(super) fn push(&mut self, frame: &FrameOverlaps, confidences: Option<&BTreeMap<SegmentId, f32>>) {
        let segments = ranked(frame, confidences);
        let mut matched = vec![[false; IOUS.len()]; segments.len()];
        for area in frame.truth_areas.values() {
            self.objects.entry(SizeClass::from_area(*area, 1)).or_default().0 += 1;
        }
        for (index, iou) in IOUS.into_iter().enumerate() {
            let mut free: BTreeMap<SegmentId, u64> = frame.truth_areas.clone();
            for (segment, matched) in segments.iter().zip(&mut matched) {
                let candidates = segment.overlaps.iter().filter_map(|(truth, shared)| {
                    let ratio = Ratio::iou(*shared, *free.get(truth)?, segment.area);
                    (20 * ratio.numerator >= iou * ratio.denominator).then_some((*truth, ratio))
                });
                // Like COCO's code, takes the later of several objects with equal IoU.
                let best = candidates.max_by(|(_, a), (_, b)| a.to_f64().total_cmp(&b.to_f64()));
                if let Some((truth, _)) = best {
                    let area = free.remove(&truth).unwrap_or_default();
                    self.objects.entry(SizeClass::from_area(area, 1)).or_default().1 += 1;
                    matched[index] = true;
                }
            }
        }
        for (segment, matched) in segments.iter().zip(matched) {
            let Some(confidence) = segment.confidence else {
                self.without_confidence += 1;
                continue;
            };
            let step = (confidence.clamp(0.0, 1.0) * CONFIDENCE_STEPS).min(CONFIDENCE_STEPS - 1.0) as u8;
            let counts = self.by_confidence.entry(step).or_default();
            counts.segments += 1;
            counts.right.iter_mut().zip(matched).for_each(|(right, matched)| *right += u32::from(matched));
        }
    }

    pub(super) fn add(&mut self, other: &Self) {
        for (class, (objects, found)) in &other.objects {
            let counts = self.objects.entry(*class).or_default();
            *counts = (counts.0 + objects, counts.1 + found);
        }
        for (step, more) in &other.by_confidence {
            let counts = self.by_confidence.entry(*step).or_default();
            counts.segments += more.segments;
            counts.right.iter_mut().zip(more.right).for_each(|(right, more)| *right += more);
        }
        self.without_confidence += other.without_confidence;
    }

    /// AP in percent. `None` without true objects, or if any confidence is unknown.
    pub(super) fn average_precision(&self) -> Option<f64> {
        let sum: Option<f64> = (0..IOUS.len()).map(|iou| self.precision(iou)).sum();
        sum.map(|sum| sum / IOUS.len() as f64)
    }

    /// AP at an IoU threshold of 0.5, percent.
    pub(super) fn average_precision_50(&self) -> Option<f64> {
        self.precision(0)
    }

    /// For each recall level, the best precision at that recall or above, averaged over the levels.
    fn precision(&self, iou: usize) -> Option<f64> {
        let objects: u64 = self.objects.values().map(|(objects, _)| objects).sum();
        if objects == 0 || self.without_confidence > 0 {
            return None;
        }
        let (mut segments, mut right, mut curve) = (0, 0, Vec::new());
        for counts in self.by_confidence.values().rev() {
            segments += u64::from(counts.segments);
            right += u64::from(counts.right[iou]);
            curve.push((right, right as f64 / segments as f64));
        }
        let mut best: f64 = 0.0;
        for (_, precision) in curve.iter_mut().rev() {
            best = best.max(*precision);
            *precision = best;
        }
        let at = |step: u64| {
            let reached = curve.partition_point(|(right, _)| right * RECALL_STEPS < step * objects);
            curve.get(reached).map_or(0.0, |(_, precision)| *precision)
        };
        Some(100.0 * (0..=RECALL_STEPS).map(at).sum::<f64>() / (RECALL_STEPS + 1) as f64)
    }

    /// Average recall in percent. `None` without true objects.
    pub(super) fn average_recall(&self) -> Option<f64> {
        recall(self.objects.values().fold((0, 0), |sum, counts| (sum.0 + counts.0, sum.1 + counts.1)))
    }

    /// Average recall by the object's area, for every class.
    pub(super) fn average_recall_by_size(&self) -> BTreeMap<SizeClass, Option<f64>> {
        SizeClass::ALL.map(|class| (class, self.objects.get(&class).copied().and_then(recall))).into()
    }
}

fn recall((objects, found): (u64, u64)) -> Option<f64> {
    (objects > 0).then(|| 100.0 * found as f64 / (objects * IOUS.len() as u64) as f64)
}

/// A segment of a frame.
struct Segment {
    label: SegmentId,
    area: u64,
    confidence: Option<f32>,
    /// Each overlapping true object with the number of shared pixels.
    overlaps: Vec<(SegmentId, u64)>,
}

/// Returns the segments that count, by decreasing confidence, then by label.
fn ranked(frame: &FrameOverlaps, confidences: Option<&BTreeMap<SegmentId, f32>>) -> Vec<Segment> {
    let mut segments: BTreeMap<SegmentId, Segment> = BTreeMap::new();
    for overlap in frame.full() {
        let label = overlap.label;
        let confidence = confidences.map(|known| known.get(&label).copied().unwrap_or(0.0));
        let new = || Segment { label, area: 0, confidence, overlaps: Vec::new() };
        let segment = segments.entry(label).or_insert_with(new);
        segment.area += overlap.pixels;
        if overlap.truth != 0 {
            segment.overlaps.push((overlap.truth, overlap.pixels));
        }
    }
    let mut segments: Vec<Segment> = segments.into_values().collect();
    let confidence = |segment: &Segment| segment.confidence.unwrap_or(0.0);
    segments.sort_by(|a, b| confidence(b).total_cmp(&confidence(a)).then(a.label.cmp(&b.label)));
    segments.truncate(MAX_SEGMENTS);
    segments
}
