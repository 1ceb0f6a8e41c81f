//! Scores predictions of any origin against a scene's ground truth, as `splatseg eval` does.
//!
//! `frames.rs` says which frames are scored, `predictions.rs` and `annotations.rs` read what was predicted for them,
//! `run_summary.rs` what the run that made them says, and `scoring.rs` compares both.

mod annotations;
mod error;
mod frames;
mod predictions;
mod run_summary;
mod scoring;

pub use annotations::EncodedMask;
pub use error::EvaluationError;
pub use frames::{MissingCounts, MissingFrames, SelectedFrames};
pub use predictions::{Fit, Prediction, Predictions};
pub use run_summary::RunSummary;
pub use scoring::Ids;

use scoring::Scoring;
use splatseg_dataset::{DatasetSettings, Scene};
use splatseg_metrics::{ScoreSettings, VideoScore, VideoScorer};
use std::path::Path;

/// How predictions are scored.
#[derive(Clone, Copy, Debug)]
pub struct EvaluationOptions {
    /// The definition of the metrics.
    pub score: ScoreSettings,
    /// What to do about frames that the predictions or the ground truth lack.
    pub missing: MissingFrames,
    /// What predicted ids mean.
    pub ids: Ids,
}

/// What came of scoring a video.
#[derive(Clone, Debug)]
pub struct Evaluation {
    /// The scores.
    pub score: VideoScore,
    /// Frames that were left out, or scored as empty.
    pub missing: MissingCounts,
}

/// Scores the predictions at `path` for the frames of a scene that `dataset` selects: a folder of id images, the folder of
/// a run, or a JSON file with masks.
///
/// # Errors
/// If the scene has no ground truth, if something cannot be read or has another size, and, with
/// [`MissingFrames::Refused`], if frames are missing.
pub fn evaluate(
    scene: &dyn Scene,
    dataset: &DatasetSettings,
    path: &Path,
    options: &EvaluationOptions,
) -> Result<Evaluation, EvaluationError> {
    if !scene.has_ground_truth() {
        return Err(EvaluationError::at(Path::new(scene.name()), "the scene has no ground truth"));
    }
    let frames = SelectedFrames::of(scene, dataset)?;
    let predictions = Predictions::open(path, &frames)?;
    let mut missing = frames.check(&predictions, options.missing)?;
    let scoring = Scoring { scene, dataset, frames: &frames, predictions: &predictions, ids: options.ids };
    let (score, unlabelled) = scoring.run(VideoScorer::new(options.score), options.missing)?;
    missing.unlabelled_frames = unlabelled;
    Ok(Evaluation { score, missing })
}
