//! Which detections become new tracks (METHOD, "SAM2-Splat, one frame", steps 1 and 4).

use crate::TrackingError;
use serde::{Deserialize, Serialize};
use splatseg_geometry::{Mask, ScoredMask, SegmentId};

/// Where a tracker's mask prompts come from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PromptSource {
    /// A segmenter's detections; those that lie on a track are not new.
    #[default]
    Detections,
    /// The ground truth, each object on the frame where it becomes visible; all of them are new.
    GroundTruth,
}

/// Which detections are new objects. The same for every method over a tracker.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct NewObjectSettings {
    /// Where detections come from.
    pub prompts: PromptSource,
    /// Detections with a larger IoU with any track's mask, or with a better detection of the same frame, are no new
    /// objects. In [0, 1]. The paper's: 0.1.
    pub max_detection_iou: f64,
    /// Detections of fewer pixels are ignored.
    pub min_segment_area: usize,
}

impl Default for NewObjectSettings {
    fn default() -> Self {
        Self { prompts: PromptSource::Detections, max_detection_iou: 0.1, min_segment_area: 50 }
    }
}

impl NewObjectSettings {
    /// The settings, if all are in range.
    ///
    /// # Errors
    /// [`TrackingError::Setting`] names the first that is not.
    pub fn validated(self) -> Result<Self, TrackingError> {
        if (0.0..=1.0).contains(&self.max_detection_iou) {
            return Ok(self);
        }
        let (field, found) = ("max_detection_iou", self.max_detection_iou.to_string());
        Err(TrackingError::Setting { field, found, expected: "0 to 1" })
    }

    /// The detections that show an object which no track follows, best first.
    ///
    /// With detections as prompts that is non-maximum suppression, tracks before detections and better scores before
    /// worse. As long as there are no tracks, on the first frame, every detection is new. Ground truth always is.
    pub fn new_objects<'a>(&self, tracks: &[(SegmentId, Mask)], detections: &'a [ScoredMask]) -> Vec<&'a Mask> {
        let large = detections.iter().filter(|found| found.mask.area() >= self.min_segment_area.max(1));
        if self.prompts == PromptSource::GroundTruth || tracks.is_empty() {
            return large.map(|found| &found.mask).collect();
        }
        let mut ranked: Vec<&ScoredMask> = large.collect();
        // Stable: equally good ones stay in the segmenter's order.
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
        let settings = NewObjectSettings { min_segment_area: 6, ..NewObjectSettings::default() };
        let detections =
            [found(0, 10, 0.9), found(50, 60, 0.5), found(52, 62, 0.8), found(19, 28, 0.7), found(90, 92, 1.0)];
        let tracks = [(1, stripe(0, 20)), (2, Mask::empty(100, 2))];
        assert_eq!(settings.new_objects(&tracks, &detections), [&stripe(52, 62), &stripe(19, 28)]);
        assert_eq!(settings.new_objects(&[], &detections).len(), 4, "all large ones on the first frame");
        let truth = NewObjectSettings { prompts: PromptSource::GroundTruth, ..settings };
        assert_eq!(truth.new_objects(&tracks, &detections).len(), 4);
        let error = NewObjectSettings { max_detection_iou: -0.1, ..settings }.validated().unwrap_err();
        assert_eq!(error.to_string(), "max_detection_iou is -0.1, expected 0 to 1");
    }
}
