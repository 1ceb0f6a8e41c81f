//! Scores predictions of any origin against a scene's ground truth, as `splatseg eval` does.
//!
//! `frames.rs` says which frames are scored, `predictions.rs`, `annotations.rs` and `panoptic.rs` read what was predicted for
//! them (`choice.rs`: of which video),
//! `run_summary.rs` what the run that made them says, and `scoring.rs` compares both. `mesh.rs` scores a memory on a mesh.

mod annotations;
mod choice;
mod error;
mod frames;
mod mesh;
mod panoptic;
mod predictions;
mod run_summary;
mod scoring;

pub use annotations::EncodedMask;
pub use choice::PredictionChoice;
pub use error::EvaluationError;
pub use frames::{MissingCounts, MissingFrames, SelectedFrames};
pub use mesh::{MeshScore, MeshTruth};
pub use panoptic::{PanopticFrame, PanopticFrames};
pub use predictions::{Fit, Prediction, Predictions};
pub use run_summary::RunSummary;
pub use scoring::Ids;

use scoring::Scoring;
use splatseg_dataset::{DatasetSettings, Scene};
use splatseg_metrics::{ScoreSettings, VideoScore, VideoScorer};
use std::path::Path;

/// How predictions are scored.
#[derive(Clone, Debug)]
pub struct EvaluationOptions {
    /// The definition of the metrics.
    pub score: ScoreSettings,
    /// What to do about frames that the predictions or the ground truth lack.
    pub missing: MissingFrames,
    /// What predicted ids mean.
    pub ids: Ids,
    /// The video's id or name in predictions for several; without it the one that is named like the scene, or the only one.
    pub video: Option<String>,
    /// Predictions with a lower score are left out.
    pub min_score: f64,
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
/// a run, or a JSON file with masks or of COCO's panoptic format.
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
    let (video, min_score) = (options.video.as_deref(), options.min_score);
    let predictions = Predictions::open(path, &frames, &PredictionChoice { video, min_score, scene: scene.name() })?;
    let mut missing = frames.check(&predictions, options.missing)?;
    let scoring = Scoring { scene, dataset, frames: &frames, predictions: &predictions, ids: options.ids };
    let (score, unlabelled) = scoring.run(VideoScorer::new(options.score), options.missing)?;
    missing.unlabelled_frames = unlabelled;
    Ok(Evaluation { score, missing })
}
