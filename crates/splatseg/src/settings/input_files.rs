//! The input files and folders named in settings.

use super::{Settings, TrackerSettings};
use std::path::Path;

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

impl Settings {
    /// Returns all inputs named in the settings, the segmenter's first. Code that protects, hashes or measures inputs
    /// uses this list.
    pub fn input_files(&self) -> Vec<SettingsInput<'_>> {
        let tracker = self.method.tracker().and_then(TrackerSettings::input);
        self.segmenter.input().into_iter().chain(tracker).collect()
    }
}
