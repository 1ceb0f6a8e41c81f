//! The input files and folders named in settings.

use super::{Settings, SettingsInput};

impl Settings {
    /// Returns all inputs named in the settings, the segmenter's first. Code that protects, hashes or measures inputs
    /// uses this list.
    pub fn input_files(&self) -> Vec<SettingsInput<'_>> {
        let tracker = self.method.tracker().into_iter().flat_map(|tracker| tracker.inputs(false));
        let namer = self.namer.iter().flat_map(|namer| namer.inputs(false));
        self.segmenter.inputs(true).chain(tracker).chain(namer).collect()
    }
}
