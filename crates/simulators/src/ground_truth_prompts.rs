//! Prompts from the ground truth (`docs/PAPER.md`, "SAM2-Splat", step 4).

use crate::{GroundTruthSource, SimulatorError};
use splatseg_geometry::{CameraFrame, Mask, ScoredMask, SegmentId, Segmentation};
use splatseg_segmenter::{Segmenter, SegmenterError};
use std::collections::BTreeSet;

/// Returns the true mask of each object once, in the frame where it becomes visible.
///
/// Unlike other segmenters it keeps state between frames, so frames must be in the order of the video. A frame without
/// new objects gives no masks.
pub struct GroundTruthPrompts {
    truth: Box<dyn GroundTruthSource>,
    min_area: usize,
    seen: BTreeSet<SegmentId>,
}

impl GroundTruthPrompts {
    /// Creates a source of prompts for a video. An object counts as visible once it has `min_area` pixels (at least 1),
    /// since the sliver at the image border that often appears first is a poor prompt.
    pub fn new(truth: impl GroundTruthSource + 'static, min_area: usize) -> Self {
        Self { truth: Box::new(truth), min_area: min_area.max(1), seen: BTreeSet::new() }
    }
}

impl Segmenter for GroundTruthPrompts {
    fn name(&self) -> &str {
        "ground-truth"
    }

    /// Returns masks by increasing id of the objects, with scores of 1.
    fn segment(&mut self, frame: &CameraFrame) -> Result<Segmentation, SegmenterError> {
        let truth = self.truth.ground_truth(frame)?;
        SimulatorError::check_size(frame, truth.size())?;
        let mut objects = Mask::of_segments(&truth);
        objects.retain(|(id, mask)| mask.area() >= self.min_area && self.seen.insert(*id));
        let masks = objects.into_iter().map(|(_, mask)| ScoredMask { mask, score: 1.0 });
        Ok(masks.collect::<Vec<ScoredMask>>().into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use splatseg_geometry::{Image, Intrinsics, SegmentMap};

    #[test]
    fn each_object_is_returned_once_when_it_is_large_enough() {
        let camera = Intrinsics { fx: 4.0, fy: 4.0, cx: 1.5, cy: 0.0, width: 4, height: 1 };
        let frame = |name: &str| {
            let (color, depth) = (Image::filled(4, 1, [0; 3]), Image::filled(4, 1, 1.0));
            CameraFrame::new(name, color, depth, camera).unwrap()
        };
        let truth = |frame: &CameraFrame| {
            let ids = match frame.name() {
                "0" => vec![7, 7, 0, 3],
                "1" => vec![7, 7, 3, 3],
                "2" => vec![0, 0, 0, 0],
                _ => vec![3, 3, 7, 7],
            };
            Ok(SegmentMap::from_pixels(4, 1, ids).unwrap())
        };
        let mut prompts = GroundTruthPrompts::new(truth, 2);
        let mut areas = |name: &str| -> Vec<usize> {
            prompts.segment(&frame(name)).unwrap().masks.iter().map(|found| found.mask.area()).collect()
        };
        assert_eq!(areas("0"), [2], "object 3 is a sliver");
        assert_eq!(areas("1"), [2], "object 3 is large enough");
        assert!(areas("2").is_empty() && areas("3").is_empty());
    }
}
