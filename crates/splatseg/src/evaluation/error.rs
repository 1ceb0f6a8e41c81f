//! What can go wrong when predictions are scored.

use crate::settings::SettingsError;
use splatseg_dataset::DatasetError;
use splatseg_settings::SettingError;
use std::fmt::Display;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Why predictions cannot be scored.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum EvaluationError {
    /// The scene cannot be read.
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    /// A setting does not fit the scene.
    #[error(transparent)]
    Setting(#[from] SettingError),
    /// The settings of the run that made the predictions cannot be read.
    #[error(transparent)]
    Settings(#[from] SettingsError),
    /// The predictions, or what belongs to them, cannot be used.
    #[error("{}: {problem}", path.display())]
    Predictions {
        /// The file, folder or scene.
        path: PathBuf,
        /// What is wrong with it.
        problem: String,
    },
    /// The ground truth lacks frames.
    #[error("{0}; --allow-missing leaves them out")]
    Unlabelled(String),
    /// There is nothing to score.
    #[error("none of the frames has ground truth")]
    NothingLabelled,
}

impl EvaluationError {
    /// Something that is wrong with a file, folder or scene.
    pub(super) fn at(path: &Path, problem: impl Display) -> Self {
        Self::Predictions { path: path.to_owned(), problem: problem.to_string() }
    }
}
