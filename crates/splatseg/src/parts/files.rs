//! The files and folders that parts read, as settings name them.

use super::PartError;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// A file or folder that a part reads: a setting at the top level. Parts of one kind may share a setting.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PartFile {
    /// The setting that names it, e.g. `weights`.
    pub key: &'static str,
    /// Help of the setting. Of parts that share a setting, the first one's is shown.
    pub help: &'static str,
    /// Description for the error if it is missing, e.g. `a checkpoint of FastSAM, e.g. --weights FastSAM-x.pt`.
    pub what: &'static str,
    /// Its name in other messages, e.g. `the file of --weights`.
    pub called: &'static str,
    /// True if the part cannot be built without it.
    pub is_required: bool,
    /// True for a network's checkpoint.
    pub is_checkpoint: bool,
}

/// The files and folders that settings name for a part, by the key of their setting.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct PartFiles(pub(super) BTreeMap<&'static str, PathBuf>);

impl PartFiles {
    /// Returns the path that the setting names, if any.
    pub fn get(&self, file: &PartFile) -> Option<&Path> {
        self.0.get(file.key).map(PathBuf::as_path)
    }

    /// Returns the path that the setting names.
    ///
    /// # Errors
    /// [`PartError::NoFile`] if it names none.
    pub fn required(&self, file: &PartFile) -> Result<&Path, PartError> {
        self.get(file).ok_or(PartError::NoFile { key: file.key, what: file.what })
    }
}

/// A required file that was not given.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MissingFile {
    /// The choice that needs it, e.g. `segmenter = fastsam`.
    pub chosen: String,
    /// The setting that names the file.
    pub key: &'static str,
    /// Description of the expected file.
    pub what: &'static str,
}

/// A file or folder that a run reads besides its scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SettingsInput<'a> {
    /// Description in messages, e.g. `the file of --weights`.
    pub what: &'static str,
    /// Path.
    pub path: &'a Path,
    /// True for a network's checkpoint.
    pub is_checkpoint: bool,
    /// True if only the segmenter reads it.
    pub is_of_segmenter: bool,
}
