//! The files and folders that settings name as inputs.

use super::{SegmenterSettings, Settings, TrackerSettings};
use std::path::Path;

/// A file or folder that a run reads besides its scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SettingsInput<'a> {
    /// Its name in messages, e.g. `the file of --weights`.
    pub what: &'static str,
    /// Where it is.
    pub path: &'a Path,
    /// Whether it is a network's checkpoint.
    pub is_checkpoint: bool,
    /// Whether only the segmenter reads it.
    pub is_of_segmenter: bool,
}

impl Settings {
    /// All inputs that the settings name, the segmenter's first. Whatever protects, hashes or measures inputs uses this
    /// list.
    pub fn input_files(&self) -> Vec<SettingsInput<'_>> {
        let segmenter = match &self.segmenter {
            SegmenterSettings::Affinity { weights, .. } | SegmenterSettings::Fastsam { weights, .. } => {
                weights.as_deref().map(|path| ("the file of --weights", path, true))
            }
            SegmenterSettings::Masks { masks } => masks.as_deref().map(|path| ("the folder of --masks", path, false)),
            SegmenterSettings::Graph { .. } | SegmenterSettings::Oracle { .. } => None,
        };
        let tracker = match self.method.tracker() {
            Some(TrackerSettings::Sam2 { tracker_weights, .. }) => {
                tracker_weights.as_deref().map(|path| ("the file of --tracker-weights", path, true))
            }
            Some(TrackerSettings::Sim { .. }) | None => None,
        };
        let input = |is_of_segmenter| {
            move |(what, path, is_checkpoint)| SettingsInput { what, path, is_checkpoint, is_of_segmenter }
        };
        segmenter.map(input(true)).into_iter().chain(tracker.map(input(false))).collect()
    }
}
