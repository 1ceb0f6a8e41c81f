//! Segmentation quality of single frames, regardless of ids, over all frames.

mod boundary;
mod detections;

pub use boundary::{BOUNDARY_TOLERANCE_PX, BoundaryCounts};
pub use detections::{ConfidenceCounts, DetectionCounts};

use crate::overlap::FrameOverlaps;
use crate::tubes::{TubeCounts, TubeOfLabel};
use crate::{Protocol, SizeClass, VsqCounts};
use serde::{Deserialize, Serialize};
use splatseg_geometry::SegmentId;
use std::collections::BTreeMap;

/// Counts of single frames. They do not depend on the protocol. Counts of several videos can be added.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct SingleFrameCounts {
    /// Segments and true objects of each frame, matched as in [`Protocol::Paper`] at k = 1. VSQ¹ uses only every
    /// fifteenth frame; these counts are of all frames.
    pub matches: VsqCounts,
    /// Segments as detections of objects.
    pub detections: DetectionCounts,
    /// Boundaries between segments.
    pub boundary: BoundaryCounts,
    /// Pixels with a true and a predicted label.
    pub covered: u64,
    /// Number of `covered` pixels in the segment that covers most of their object.
    pub in_main_segment: u64,
    /// Number of `covered` pixels in the object that contains most of their segment.
    pub in_main_object: u64,
}

/// Segmentation quality of single frames, in percent unless stated otherwise. `None` (JSON `null`) where the
/// denominator is 0.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct SingleFrameScores {
    /// Σ IoU of matched segments / mean of the numbers of segments and objects: VSQ¹ of protocol `paper`, but over all
    /// frames.
    pub quality: Option<f64>,
    /// COCO's average precision, class-agnostic: the mean over IoU thresholds of 0.5, 0.55, …, 0.95. `None` if segments
    /// have no confidence.
    pub ap: Option<f64>,
    /// Average precision at an IoU threshold of 0.5.
    pub ap50: Option<f64>,
    /// COCO's average recall with at most 100 segments per frame: the mean over the IoU thresholds of `ap`.
    pub ar: Option<f64>,
    /// `ar` by the object's area in the frame.
    pub ar_by_size: BTreeMap<SizeClass, Option<f64>>,
    /// F-score of boundary pixels, with a tolerance of [`BOUNDARY_TOLERANCE_PX`].
    pub boundary_f: Option<f64>,
    /// Of the pixels with a segment and an object, those outside the segment that covers most of their object.
    pub over_segmentation: Option<f64>,
    /// Of the pixels with a segment and an object, those outside the object that contains most of their segment.
    pub under_segmentation: Option<f64>,
    /// Mean number of segments per frame.
    pub segments_per_frame: Option<f64>,
    /// Mean number of true objects per frame.
    pub objects_per_frame: Option<f64>,
}

impl SingleFrameCounts {
    /// Adds a frame. `confidences` contains the confidences of labels, if known.
    pub(crate) fn push(
        &mut self,
        frame: &FrameOverlaps,
        boundary: BoundaryCounts,
        confidences: Option<&BTreeMap<SegmentId, f32>>,
    ) {
        let mut tubes = TubeCounts::default();
        tubes.add(frame, frame.full(), TubeOfLabel::Id);
        self.matches.add(&VsqCounts::from_window(&tubes, Protocol::Paper));
        self.detections.push(frame, confidences);
        self.boundary.add(&boundary);
        let (mut by_object, mut by_segment) = (BTreeMap::new(), BTreeMap::new());
        for overlap in frame.flat().iter().filter(|overlap| overlap.truth != 0) {
            self.covered += overlap.pixels;
            for (largest, key) in [(&mut by_object, overlap.truth), (&mut by_segment, overlap.label)] {
                let largest: &mut u64 = largest.entry(key).or_default();
                *largest = overlap.pixels.max(*largest);
            }
        }
        self.in_main_segment += by_object.values().sum::<u64>();
        self.in_main_object += by_segment.values().sum::<u64>();
    }

    pub(crate) fn add(&mut self, other: &Self) {
        self.matches.add(&other.matches);
        self.detections.add(&other.detections);
        self.boundary.add(&other.boundary);
        self.covered += other.covered;
        self.in_main_segment += other.in_main_segment;
        self.in_main_object += other.in_main_object;
    }

    pub(crate) fn scores(&self) -> SingleFrameScores {
        let matches = &self.matches;
        let outside = |inside: u64| (self.covered > 0).then(|| 100.0 - 100.0 * inside as f64 / self.covered as f64);
        let per_frame = |count: u64| {
            (matches.windows > 0).then(|| (count + matches.true_positives) as f64 / matches.windows as f64)
        };
        SingleFrameScores {
            quality: matches.quality().map(|quality| 100.0 * quality),
            ap: self.detections.average_precision(),
            ap50: self.detections.average_precision_50(),
            ar: self.detections.average_recall(),
            ar_by_size: self.detections.average_recall_by_size(),
            boundary_f: self.boundary.f_score(),
            over_segmentation: outside(self.in_main_segment),
            under_segmentation: outside(self.in_main_object),
            segments_per_frame: per_frame(matches.false_positives),
            objects_per_frame: per_frame(matches.false_negatives),
        }
    }
}
