//! Errors scoring predictions.

use crate::settings::SettingsError;
use splatseg_annotations::AnnotationError;
use splatseg_dataset::DatasetError;
use thiserror::Error;

/// An error scoring predictions.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum EvaluationError {
    /// The scene cannot be read.
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    /// The settings of the run that made the predictions cannot be read.
    #[error(transparent)]
    Settings(#[from] SettingsError),
    /// The predictions, or files that belong to them, cannot be used.
    #[error(transparent)]
    Annotations(#[from] AnnotationError),
    /// The ground truth lacks frames.
    #[error("{0}; --allow-missing leaves them out")]
    Unlabelled(String),
    /// There is nothing to score.
    #[error("none of the frames has ground truth")]
    NothingLabelled,
}
