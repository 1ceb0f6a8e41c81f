//! The frames of a scene, by the names that predictions use for them.

use crate::AnnotationError;
use splatseg_dataset::{DatasetSettings, Scene, unpadded_number};
use std::collections::{BTreeMap, BTreeSet};

/// The frames of a scene that predictions are for.
#[derive(Clone, Debug)]
pub struct SelectedFrames {
    selected: Vec<(usize, String)>,
    all_names: BTreeSet<String>,
    /// Frame names by unpadded name.
    by_number: BTreeMap<String, String>,
}

impl SelectedFrames {
    /// Selects frames of a scene by the settings.
    ///
    /// # Errors
    /// If a setting is out of range or selects no frame.
    pub fn new(scene: &dyn Scene, settings: &DatasetSettings) -> Result<Self, AnnotationError> {
        let indices = settings.selected_frames(scene.frame_count())?;
        let selected = indices.into_iter().map(|index| (index, scene.frame_name(index))).collect();
        let all_names: BTreeSet<String> = (0..scene.frame_count()).map(|index| scene.frame_name(index)).collect();
        let by_number = all_names.iter().map(|name| (unpadded_number(name).to_owned(), name.clone())).collect();
        Ok(Self { selected, all_names, by_number })
    }

    /// Index in the scene and name of each selected frame, in order.
    pub fn selected(&self) -> &[(usize, String)] {
        &self.selected
    }

    /// Returns true if the scene has a frame of this name, selected or not.
    pub fn contains(&self, name: &str) -> bool {
        self.all_names.contains(name)
    }

    /// Returns the name of the frame that `name` refers to: `name` may be the frame's own name, or its number with or
    /// without leading zeros.
    pub fn resolve<'a>(&'a self, name: &'a str) -> Option<&'a str> {
        if self.contains(name) {
            return Some(name);
        }
        self.by_number.get(unpadded_number(name)).map(String::as_str)
    }
}
