//! Scores predictions against a scene's ground truth, frame by frame.

use super::frames::count_and_names;
use super::{EvaluationError, MissingFrames, ScoredFrame};
use splatseg_annotations::{AnnotationError, Fit, Prediction, Predictions, SelectedFrames};
use splatseg_dataset::{DatasetSettings, Scene, read_segments_png};
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

/// Where true ids are from.
#[derive(Clone, Copy)]
pub enum Truth<'a> {
    /// The ground truth of a scene.
    Scene(&'a dyn Scene),
    /// The id images of another run.
    OtherRun(&'a Predictions),
}

impl Truth<'_> {
    /// The true ids of a frame with their size before framing; `None` if there are none.
    fn read(
        &self,
        index: usize,
        name: &str,
        dataset: &DatasetSettings,
    ) -> Result<Option<(SegmentMap, Fit)>, EvaluationError> {
        let framing = dataset.framing();
        let fit = |original, framed: &SegmentMap| Fit { framing, original, framed: framed.size() };
        match self {
            Self::Scene(scene) => {
                let Some(truth) = scene.read_ground_truth(index)? else { return Ok(None) };
                let original = truth.size();
                let truth = framing.apply_to_labels(truth)?;
                let fit = fit(original, &truth);
                Ok(Some((truth, fit)))
            }
            // A run has framed them.
            Self::OtherRun(run) => {
                let Some(image) = run.image_of(name) else { return Ok(None) };
                let truth = read_segments_png(&image)?;
                let fit = fit(truth.size(), &truth);
                Ok(Some((truth, fit)))
            }
        }
    }
}

/// The predictions to score, with the truth and the frames.
pub struct Scoring<'a> {
    /// The true ids.
    pub truth: Truth<'a>,
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
    /// `each` is called with every other one.
    pub fn run(
        &self,
        mut scorer: VideoScorer,
        missing: MissingFrames,
        each: &mut dyn FnMut(&ScoredFrame<'_>),
    ) -> Result<(VideoScore, usize), EvaluationError> {
        let mut unlabelled = Vec::new();
        for (index, name) in self.frames.selected() {
            let Some((truth, fit)) = self.truth.read(*index, name, self.dataset)? else {
                unlabelled.push(name.as_str());
                continue;
            };
            let prediction = self.predictions.read(name, &fit)?;
            let image = self.predictions.image_of(name);
            each(&ScoredFrame { image: image.as_deref(), truth: &truth, prediction: &prediction });
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
