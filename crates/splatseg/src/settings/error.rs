//! Everything that can be wrong with settings.

use super::Need;
use splatseg_settings::SettingError;
use std::path::PathBuf;
use thiserror::Error;

/// Settings that cannot be used.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum SettingsError {
    /// The file cannot be read.
    #[error("{}: {source}", path.display())]
    Read {
        /// The TOML file.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// The file is not TOML.
    #[error("{}: {message}", path.display())]
    Syntax {
        /// The TOML file.
        path: PathBuf,
        /// What is wrong, and where.
        message: String,
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
    /// A setting out of range, or of the wrong type.
    #[error(transparent)]
    Setting(#[from] SettingError),
    /// A setting of a method, segmenter, tracker or memory that was not chosen.
    #[error("{key} is not used here: it needs {need}, but {} is {found}", need.key)]
    Unused {
        /// The setting.
        key: String,
        /// The choice that it needs.
        need: Need,
        /// The choice that was made instead.
        found: String,
    },
    /// A file that the chosen segmenter or tracker needs was not given.
    #[error("{} needs {}: {}", .0.chosen, .0.key, .0.what)]
    Missing(MissingFile),
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
