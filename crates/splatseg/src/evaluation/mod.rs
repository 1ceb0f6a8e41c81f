//! Scores predictions of any origin against a scene's ground truth, as `splatseg eval` does.
//!
//! The crate `splatseg-annotations` reads the predictions. `frames.rs` checks that they cover the frames to score.
//! `run_summary.rs` reads the summary of the run that made the predictions. `scoring.rs` compares predictions with ground
//! truth. `mesh.rs` scores a memory on a mesh. `trajectory.rs` reads the poses of a scene.

mod error;
mod frames;
mod mesh;
mod run_summary;
mod scoring;
mod trajectory;

pub use error::EvaluationError;
pub use frames::{MissingCounts, MissingFrames};
pub use mesh::{MeshScore, MeshTruth};
pub use run_summary::RunSummary;
pub use scoring::Ids;
pub use trajectory::SceneTrajectory;

use frames::check_predictions;
use scoring::{Scoring, Truth};
use splatseg_annotations::{AnnotationError, Prediction, PredictionChoice, Predictions, SelectedFrames};
use splatseg_dataset::{DatasetSettings, Scene};
use splatseg_geometry::SegmentMap;
use splatseg_metrics::{ScoreSettings, VideoScore, VideoScorer};
use std::path::{Path, PathBuf};

/// Options for scoring predictions.
#[derive(Clone, Debug)]
pub struct EvaluationOptions {
    /// The definition of the metrics.
    pub score: ScoreSettings,
    /// Policy for frames that are missing from the predictions or the ground truth.
    pub missing: MissingFrames,
    /// Scope of predicted ids: the video or a single frame.
    pub ids: Ids,
    /// The video's id or name in predictions for several videos. `None` selects the video named like the scene, or the
    /// only one.
    pub video: Option<String>,
    /// Predictions with a lower score are left out.
    pub min_score: f64,
    /// Folder of another run, or of id images, whose ids are the truth. `None` for the scene's.
    pub truth: Option<PathBuf>,
}

/// The result of scoring a video.
#[derive(Clone, Debug)]
pub struct Evaluation {
    /// The scores.
    pub score: VideoScore,
    /// Numbers of frames that were left out or scored as empty.
    pub missing: MissingCounts,
}

/// A frame with its ground truth, as it is scored.
#[derive(Clone, Copy, Debug)]
pub struct ScoredFrame<'a> {
    /// The frame's id image, if the predictions are a folder of them.
    pub image: Option<&'a Path>,
    /// True ids, `[height, width]`, 0 for none.
    pub truth: &'a SegmentMap,
    /// The prediction, of the same size.
    pub prediction: &'a Prediction,
}

/// Scores the predictions at `path` on the frames of a scene that `dataset` selects. `path` is a folder of id images, the
/// folder of a run, or a JSON file with masks or in COCO's panoptic format.
///
/// # Errors
/// If the scene has no ground truth, if a file cannot be read or has the wrong size, or, with
/// [`MissingFrames::Refused`], if frames are missing.
pub fn evaluate(
    scene: &dyn Scene,
    dataset: &DatasetSettings,
    path: &Path,
    options: &EvaluationOptions,
) -> Result<Evaluation, EvaluationError> {
    evaluate_each(scene, dataset, path, options, &mut |_| {})
}

/// As [`evaluate`]; `each` is called with every frame. With `options.truth`, the ids of another run are the truth.
///
/// # Errors
/// As [`evaluate`].
pub fn evaluate_each(
    scene: &dyn Scene,
    dataset: &DatasetSettings,
    path: &Path,
    options: &EvaluationOptions,
    each: &mut dyn FnMut(&ScoredFrame<'_>),
) -> Result<Evaluation, EvaluationError> {
    if options.truth.is_none() && !scene.has_ground_truth() {
        return Err(AnnotationError::at(Path::new(scene.name()), "the scene has no ground truth").into());
    }
    let frames = SelectedFrames::new(scene, dataset)?;
    let (video, min_score) = (options.video.as_deref(), options.min_score);
    let per_frame_ids = options.ids == Ids::PerFrame;
    let choice = PredictionChoice { video, min_score, scene: scene.name(), per_frame_ids };
    let predictions = Predictions::open(path, &frames, &choice)?;
    let mut missing = check_predictions(&frames, &predictions, options.missing)?;
    let choice = PredictionChoice { video: None, ..choice };
    let other = options.truth.as_ref().map(|path| Predictions::open(path, &frames, &choice)).transpose()?;
    let truth = other.as_ref().map_or(Truth::Scene(scene), Truth::OtherRun);
    let scoring = Scoring { truth, dataset, frames: &frames, predictions: &predictions, ids: options.ids };
    let (score, unlabelled) = scoring.run(VideoScorer::new(options.score), options.missing, each)?;
    missing.unlabelled_frames = unlabelled;
    Ok(Evaluation { score, missing })
}
