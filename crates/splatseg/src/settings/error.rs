//! Errors in settings.

use super::{MissingFile, Requirement};
use splatseg_dataset::DatasetError;
use splatseg_memory::SplatFileError;
use splatseg_models::device::DeviceError;
use splatseg_settings::SettingError;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Errors reading or checking settings.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum SettingsError {
    /// The source has no depth, and no depth predictor is chosen.
    #[error(transparent)]
    NoDepth(DatasetError),
    /// The file cannot be read.
    #[error("{}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// The file is not valid TOML; or, if its name ends in `.json`, not valid JSON.
    #[error("{}: {message}", place(path, *line))]
    Syntax {
        /// The file.
        path: PathBuf,
        /// The line, counted from 1.
        line: Option<usize>,
        /// The error in the syntax.
        message: String,
    },
    /// A value in a file is invalid.
    #[error("{}: {source}", place(path, *line))]
    InFile {
        /// The file.
        path: PathBuf,
        /// The line, counted from 1; `None` for JSON.
        line: Option<usize>,
        /// The error in the value.
        source: Box<SettingsError>,
    },
    /// `--set` without `=`, or with an invalid key.
    #[error("--set {0}: expected KEY=VALUE, e.g. memory.max_votes=8")]
    Assignment(String),
    /// A key that does not exist.
    #[error("there is no setting {key}{}", suggestion(nearest.as_deref()))]
    UnknownKey {
        /// The key.
        key: String,
        /// The setting with the most similar key.
        nearest: Option<String>,
    },
    /// A section where a setting is expected.
    #[error("{key} is a section: choose one of its settings, e.g. {example}")]
    IsSection {
        /// The section.
        key: String,
        /// A setting in it.
        example: String,
    },
    /// A misspelt name.
    #[error("{key} is {found:?}, did you mean {nearest}?")]
    UnknownName {
        /// The setting.
        key: String,
        /// The name found.
        found: String,
        /// The most similar allowed name.
        nearest: String,
    },
    /// A setting out of range, or of the wrong type.
    #[error(transparent)]
    Setting(#[from] SettingError),
    /// A setting that the chosen method, segmenter, tracker or memory does not use.
    #[error("{key} is not used here: it needs {need}, but {found}")]
    Unused {
        /// The setting.
        key: String,
        /// Its unmet requirement.
        need: Requirement,
        /// The actual choices, e.g. `segmenter is graph`.
        found: String,
    },
    /// A setting that differs from the saved memory.
    #[error("{key} is {found}, but the memory in {} has {saved}: leave the setting out", path.display())]
    SavedOtherwise {
        /// The setting.
        key: &'static str,
        /// The value given.
        found: String,
        /// The file of the memory.
        path: PathBuf,
        /// The value in it.
        saved: String,
    },
    /// The network, or support for its device, is not built in.
    #[error(transparent)]
    Device(#[from] DeviceError),
    /// The saved memory cannot be read.
    #[error(transparent)]
    SavedMemory(#[from] SplatFileError),
    /// A file that the chosen segmenter or tracker needs was not given.
    #[error("{} needs {}: {}", .0.chosen, .0.key, .0.what)]
    Missing(MissingFile),
}

impl SettingsError {
    /// Returns the full key of the invalid setting, if the error is about one.
    pub fn key(&self) -> Option<&str> {
        match self {
            Self::UnknownKey { key, .. }
            | Self::IsSection { key, .. }
            | Self::UnknownName { key, .. }
            | Self::Unused { key, .. } => Some(key),
            Self::SavedOtherwise { key, .. } => Some(key),
            Self::Setting(error) => Some(&error.key),
            Self::InFile { source, .. } => source.key(),
            _ => None,
        }
    }
}

/// Formats the path of a file and, if known, the line.
fn place(path: &Path, line: Option<usize>) -> String {
    let line = line.map(|line| format!(", line {line}")).unwrap_or_default();
    format!("{}{line}", path.display())
}

/// Formats the suggestion at the end of the error for an unknown key.
fn suggestion(nearest: Option<&str>) -> String {
    nearest.map(|nearest| format!(", did you mean {nearest}?")).unwrap_or_default()
}
