//! How well single frames are segmented, over all frames: ids do not matter.

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

/// Counts of single frames. Counts of several videos can be added. They do not depend on the protocol.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct SingleFrameCounts {
    /// Segments and true objects of each frame, matched as [`Protocol::Paper`] does at k = 1. VSQ¹ looks at every
    /// fifteenth frame only; these are all frames.
    pub matches: VsqCounts,
    /// Segments as detections of objects.
    pub detections: DetectionCounts,
    /// Boundaries between segments.
    pub boundary: BoundaryCounts,
    /// Pixels with a true and a predicted label.
    pub covered: u64,
    /// Those in the segment that covers most of their object.
    pub in_main_segment: u64,
    /// Those in the object that has most of their segment.
    pub in_main_object: u64,
}

/// How well single frames are segmented, percent unless said otherwise; `None` (JSON `null`) where there is nothing to
/// divide by.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct SingleFrameScores {
    /// Σ IoU of matched segments / mean of the numbers of segments and objects: VSQ¹ of protocol `paper`, over all frames.
    pub quality: Option<f64>,
    /// Average precision as COCO defines it, class-agnostic: the mean over IoUs of 0.5, 0.55, …, 0.95. `None` if
    /// segments have no confidence.
    pub ap: Option<f64>,
    /// Average precision at an IoU of 0.5.
    pub ap50: Option<f64>,
    /// COCO's average recall with at most 100 segments a frame: the mean over the IoUs of `ap`.
    pub ar: Option<f64>,
    /// `ar` by the object's area in the frame.
    pub ar_by_size: BTreeMap<SizeClass, Option<f64>>,
    /// F-score of the pixels on boundaries, which may be [`BOUNDARY_TOLERANCE_PX`] apart.
    pub boundary_f: Option<f64>,
    /// Pixels outside the segment that covers most of their object, of those with a segment and an object.
    pub over_segmentation: Option<f64>,
    /// Pixels outside the object that has most of their segment, of the same pixels.
    pub under_segmentation: Option<f64>,
    /// Mean number of segments a frame.
    pub segments_per_frame: Option<f64>,
    /// Mean number of true objects a frame.
    pub objects_per_frame: Option<f64>,
}

impl SingleFrameCounts {
    /// Adds a frame. `confidences` has those of labels, if they are known.
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
        let (mut of_object, mut of_segment) = (BTreeMap::new(), BTreeMap::new());
        for overlap in frame.flat().iter().filter(|overlap| overlap.truth != 0) {
            self.covered += overlap.pixels;
            for (largest, key) in [(&mut of_object, overlap.truth), (&mut of_segment, overlap.label)] {
                let largest: &mut u64 = largest.entry(key).or_default();
                *largest = overlap.pixels.max(*largest);
            }
        }
        self.in_main_segment += of_object.values().sum::<u64>();
        self.in_main_object += of_segment.values().sum::<u64>();
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
