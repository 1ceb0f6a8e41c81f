//! Scores predictions against a scene's ground truth, frame by frame.

use super::frames::count_and_names;
use super::{EvaluationError, Fit, MissingFrames, Predictions, SelectedFrames};
use splatseg_dataset::{DatasetSettings, Scene};
use splatseg_metrics::{VideoScore, VideoScorer};

/// Whether predicted ids mean the same object in every frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ids {
    /// They do.
    Lasting,
    /// They only tell apart the masks of one frame.
    PerFrame,
}

/// Everything that is scored.
pub struct Scoring<'a> {
    /// The scene with its ground truth.
    pub scene: &'a dyn Scene,
    /// How the scene is read.
    pub dataset: &'a DatasetSettings,
    /// The frames to score.
    pub frames: &'a SelectedFrames,
    /// The predictions for them.
    pub predictions: &'a Predictions,
    /// What predicted ids mean.
    pub ids: Ids,
}

impl Scoring<'_> {
    /// The video's score, and the number of frames without ground truth.
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
            prediction
                .push_to(&mut scorer, &truth, self.ids)
                .map_err(|error| EvaluationError::at(self.predictions.path(), format!("frame {name}: {error}")))?;
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
