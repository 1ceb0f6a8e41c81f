//! Selection of detections that become new tracks (`docs/PAPER.md`, "SAM2-Splat", step 4).

use splatseg_geometry::{Mask, ScoredMask, SegmentId};
use splatseg_settings::choices;

choices! {
    /// Source of a tracker's mask prompts.
    pub enum PromptSource, default Detections {
        /// The segmenter's detections that no track covers.
        Detections = "detections",
        /// The scene's ground truth: every object, in the frame where it becomes visible.
        GroundTruth = "ground-truth",
    }
}

/// The rule for new objects, common to all methods with a tracker.
#[derive(Clone, Copy, Debug)]
pub(crate) struct NewObjects {
    /// Source of the detections.
    pub prompts: PromptSource,
    /// Detections with a larger IoU with any track's mask, or with a better detection of the frame, are not new.
    pub max_detection_iou: f64,
    /// Detections with fewer pixels are ignored.
    pub min_area: usize,
}

impl NewObjects {
    /// Returns the detections of objects that no track follows, best first.
    ///
    /// With detections as prompts, this is NMS in which tracks precede detections, and better scores precede worse
    /// ones. Without tracks, as on the first frame, every detection is new. Ground truth is always new.
    pub fn among<'a>(&self, tracks: &[(SegmentId, Mask)], detections: &'a [ScoredMask]) -> Vec<&'a Mask> {
        let large = detections.iter().filter(|found| found.mask.area() >= self.min_area.max(1));
        if self.prompts == PromptSource::GroundTruth || tracks.is_empty() {
            return large.map(|found| &found.mask).collect();
        }
        let mut ranked: Vec<&ScoredMask> = large.collect();
        // Stable: ties stay in the segmenter's order.
        ranked.sort_by(|a, b| b.score.total_cmp(&a.score));
        let mut accepted: Vec<&Mask> = Vec::new();
        for ScoredMask { mask, .. } in ranked {
            let mut known = tracks.iter().map(|(_, known)| known).chain(accepted.iter().copied());
            if known.all(|known| known.iou(mask) <= self.max_detection_iou) {
                accepted.push(mask);
            }
        }
        accepted
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stripe(from: usize, to: usize) -> Mask {
        Mask::from_fn(100, 2, |column, _| (from..to).contains(&column))
    }

    fn found(from: usize, to: usize, score: f32) -> ScoredMask {
        ScoredMask { mask: stripe(from, to), score }
    }

    #[test]
    fn detections_on_tracks_and_on_better_detections_are_not_new() {
        let settings = NewObjects { prompts: PromptSource::Detections, max_detection_iou: 0.1, min_area: 6 };
        let detections =
            [found(0, 10, 0.9), found(50, 60, 0.5), found(52, 62, 0.8), found(19, 28, 0.7), found(90, 92, 1.0)];
        let tracks = [(1, stripe(0, 20)), (2, Mask::empty(100, 2))];
        assert_eq!(settings.among(&tracks, &detections), [&stripe(52, 62), &stripe(19, 28)]);
        assert_eq!(settings.among(&[], &detections).len(), 4, "all large ones on the first frame");
        let truth = NewObjects { prompts: PromptSource::GroundTruth, ..settings };
        assert_eq!(truth.among(&tracks, &detections).len(), 4);
    }
}
