//! The input files and folders named in settings.

use super::{Settings, SettingsInput};
use crate::relative_paths::relative_to;
use std::path::Path;

impl Settings {
    /// Returns all inputs named in the settings, the segmenter's first. Code that protects, hashes or measures inputs
    /// uses this list.
    pub fn input_files(&self) -> Vec<SettingsInput<'_>> {
        let tracker = self.method.tracker().into_iter().flat_map(|tracker| tracker.inputs(false));
        let namer = self.namer.iter().flat_map(|namer| namer.inputs(false));
        let depth = self.depth_predictor.iter().flat_map(|predictor| predictor.inputs(false));
        self.segmenter.inputs(true).chain(tracker).chain(namer).chain(depth).collect()
    }

    /// Returns the settings with the paths of inputs, which were relative to the current folder, relative to `folder`.
    #[must_use]
    pub(crate) fn relative_to(mut self, folder: &Path) -> Self {
        let change = |path: &Path| relative_to(folder, path);
        self.segmenter.change_paths(&change);
        self.method.tracker_mut().into_iter().for_each(|tracker| tracker.change_paths(&change));
        self.namer.iter_mut().for_each(|namer| namer.change_paths(&change));
        self.depth_predictor.iter_mut().for_each(|predictor| predictor.change_paths(&change));
        self
    }
}
