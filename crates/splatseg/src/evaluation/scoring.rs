//! Scores predictions against a scene's ground truth, frame by frame.

use super::frames::count_and_names;
use super::{EvaluationError, MissingFrames};
use splatseg_annotations::{AnnotationError, Fit, Prediction, Predictions, SelectedFrames};
use splatseg_dataset::{DatasetSettings, Scene};
use splatseg_geometry::{Mask, SegmentId, SegmentMap};
use splatseg_metrics::{FramePrediction, MetricsError, VideoScore, VideoScorer};

/// Scope of predicted ids.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ids {
    /// An id means the same object in every frame.
    Lasting,
    /// Ids only distinguish the masks of one frame.
    PerFrame,
}

/// The predictions to score, with the scene and the frames.
pub struct Scoring<'a> {
    /// The scene with its ground truth.
    pub scene: &'a dyn Scene,
    /// Dataset settings.
    pub dataset: &'a DatasetSettings,
    /// The frames to score.
    pub frames: &'a SelectedFrames,
    /// The predictions for them.
    pub predictions: &'a Predictions,
    /// Scope of predicted ids.
    pub ids: Ids,
}

impl Scoring<'_> {
    /// Returns the video's score, and the number of frames without ground truth.
    pub fn run(&self, mut scorer: VideoScorer, missing: MissingFrames) -> Result<(VideoScore, usize), EvaluationError> {
        let mut unlabelled = Vec::new();
        for (index, name) in self.frames.selected() {
            let Some(truth) = self.scene.read_ground_truth(*index)? else {
                unlabelled.push(name.as_str());
                continue;
            };
            let original = truth.size();
            let truth = self.dataset.framing().apply_to_labels(truth)?;
            let fit = Fit { framing: self.dataset.framing(), original, framed: truth.size() };
            let prediction = self.predictions.read(name, &fit)?;
            score_frame(&mut scorer, &truth, &prediction, self.ids)
                .map_err(|error| AnnotationError::at(self.predictions.path(), format!("frame {name}: {error}")))?;
        }
        if missing == MissingFrames::Refused && !unlabelled.is_empty() {
            return Err(EvaluationError::Unlabelled(count_and_names(&unlabelled, "without ground truth")));
        }
        if scorer.frames() == 0 {
            return Err(EvaluationError::NothingLabelled);
        }
        Ok((scorer.finish(), unlabelled.len()))
    }
}

/// Scores the prediction of a frame against the truth.
fn score_frame(
    scorer: &mut VideoScorer,
    truth: &SegmentMap,
    prediction: &Prediction,
    ids: Ids,
) -> Result<(), MetricsError> {
    let without_ids = |masks: &[(SegmentId, Mask)]| masks.iter().map(|(_, mask)| mask.clone()).collect::<Vec<_>>();
    match (prediction, ids) {
        (Prediction::Map(map), Ids::Lasting) => scorer.push(truth, &FramePrediction::Ids(map)),
        (Prediction::Masks(masks), Ids::Lasting) => scorer.push(truth, &FramePrediction::Masks(masks)),
        (Prediction::Map(map), Ids::PerFrame) => {
            scorer.push(truth, &FramePrediction::Unlinked(&without_ids(&Mask::of_segments(map))))
        }
        (Prediction::Masks(masks), Ids::PerFrame) => {
            scorer.push(truth, &FramePrediction::Unlinked(&without_ids(masks)))
        }
    }
}
