//! Everything that can be wrong with settings.

use super::Need;
use splatseg_memory::SplatFileError;
use splatseg_models::device::DeviceError;
use splatseg_settings::SettingError;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Settings that cannot be used.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum SettingsError {
    /// The file cannot be read.
    #[error("{}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// The file is not TOML, or not JSON if its name ends so.
    #[error("{}: {message}", place(path, *line))]
    Syntax {
        /// The file.
        path: PathBuf,
        /// The line, counted from 1.
        line: Option<usize>,
        /// What is wrong.
        message: String,
    },
    /// A value of a file is wrong.
    #[error("{}: {source}", place(path, *line))]
    InFile {
        /// The file.
        path: PathBuf,
        /// The line, counted from 1; `None` for JSON.
        line: Option<usize>,
        /// What is wrong.
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
    /// A section in the place of a setting.
    #[error("{key} is a section of settings, e.g. {example}: give one of these")]
    IsSection {
        /// The section.
        key: String,
        /// A setting of it.
        example: String,
    },
    /// A name that is almost one of the allowed ones.
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
    /// A setting of a method, segmenter, tracker or memory that was not chosen.
    #[error("{key} is not used here: it needs {need}, but {found}")]
    Unused {
        /// The setting.
        key: String,
        /// What it needs.
        need: Need,
        /// The choices that were made instead, e.g. `segmenter is graph`.
        found: String,
    },
    /// A setting that differs from what a saved memory says.
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
    /// The device is not part of the program.
    #[error(transparent)]
    Device(#[from] DeviceError),
    /// The file of a memory cannot be read.
    #[error(transparent)]
    SavedMemory(#[from] SplatFileError),
    /// A file that the chosen segmenter or tracker needs was not given.
    #[error("{} needs {}: {}", .0.chosen, .0.key, .0.what)]
    Missing(MissingFile),
}

impl SettingsError {
    /// The full key of the setting that is wrong, if it is one.
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

/// A file that is needed and was not given.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MissingFile {
    /// The choice that needs it, e.g. `segmenter = fastsam`.
    pub chosen: &'static str,
    /// The setting that names the file.
    pub key: &'static str,
    /// The file expected there.
    pub what: &'static str,
}

/// A file, and the line in it.
fn place(path: &Path, line: Option<usize>) -> String {
    let line = line.map(|line| format!(", line {line}")).unwrap_or_default();
    format!("{}{line}", path.display())
}

/// The end of the error for an unknown key.
fn suggestion(nearest: Option<&str>) -> String {
    nearest.map(|nearest| format!(", did you mean {nearest}?")).unwrap_or_default()
}

impl MissingFile {
    pub(super) const FASTSAM: Self = Self {
        chosen: "segmenter = fastsam",
        key: "weights",
        what: "a checkpoint of FastSAM, e.g. --weights FastSAM-x.pt",
    };
    pub(super) const MASKS: Self = Self {
        chosen: "segmenter = masks",
        key: "masks",
        what: "a folder with one .png or .json file per frame, e.g. --masks DIR",
    };
    pub(super) const SAM2: Self = Self {
        chosen: "tracker = sam2",
        key: "tracker_weights",
        what: "a checkpoint of SAM 2.1, e.g. --tracker-weights sam2.1_hiera_base_plus.pt",
    };
}
