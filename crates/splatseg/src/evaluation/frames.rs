//! Which frames are scored, and whether ground truth and predictions have them.

use super::{EvaluationError, Predictions};
use serde::Serialize;
use splatseg_dataset::{DatasetSettings, Scene, unpadded_number};
use std::collections::{BTreeMap, BTreeSet};

/// At most this many names are listed in an error.
const LISTED_NAMES: usize = 5;

/// What to do about frames that the predictions or the ground truth lack.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MissingFrames {
    /// An error.
    Refused,
    /// Without prediction: scored as empty; without ground truth: left out.
    Allowed,
}

/// How many frames the predictions or the ground truth lack.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct MissingCounts {
    /// Frames without prediction.
    pub missing_predictions: usize,
    /// Frames without ground truth.
    pub unlabelled_frames: usize,
    /// Predictions of frames that the scene does not have.
    pub unknown_predictions: usize,
}

/// The frames of a scene that are scored.
#[derive(Clone, Debug)]
pub struct SelectedFrames {
    selected: Vec<(usize, String)>,
    all_names: BTreeSet<String>,
    /// The names of frames by their unpadded names.
    by_number: BTreeMap<String, String>,
}

impl SelectedFrames {
    /// The frames that the settings select.
    ///
    /// # Errors
    /// If a setting is out of range or selects no frame.
    pub fn of(scene: &dyn Scene, settings: &DatasetSettings) -> Result<Self, EvaluationError> {
        let indices = settings.selected_frames(scene.frame_count())?;
        let selected = indices.into_iter().map(|index| (index, scene.frame_name(index))).collect();
        let all_names: BTreeSet<String> = (0..scene.frame_count()).map(|index| scene.frame_name(index)).collect();
        let by_number = all_names.iter().map(|name| (unpadded_number(name).to_owned(), name.clone())).collect();
        Ok(Self { selected, all_names, by_number })
    }

    /// Index in the scene and name of each, in order.
    pub fn selected(&self) -> &[(usize, String)] {
        &self.selected
    }

    /// Whether the scene has a frame of this name, selected or not.
    pub fn knows(&self, name: &str) -> bool {
        self.all_names.contains(name)
    }

    /// The frame of the scene that a name means: that frame's own name, or its number with or without zeros in front.
    pub fn meant_by<'a>(&'a self, name: &'a str) -> Option<&'a str> {
        if self.knows(name) {
            return Some(name);
        }
        self.by_number.get(unpadded_number(name)).map(String::as_str)
    }

    /// Compares the frames with those of the predictions. Predictions of frames that exist but are not selected are not
    /// an error.
    pub(super) fn check(
        &self,
        predictions: &Predictions,
        missing: MissingFrames,
    ) -> Result<MissingCounts, EvaluationError> {
        let names: Vec<&str> = self.selected.iter().map(|(_, name)| name.as_str()).collect();
        let without: Vec<&str> = names.into_iter().filter(|name| !predictions.has(name)).collect();
        let unknown: Vec<&str> = predictions.names().filter(|name| !self.knows(name)).collect();
        if missing == MissingFrames::Refused {
            let path = predictions.path();
            if !without.is_empty() {
                let text = count_and_names(&without, "without prediction");
                return Err(EvaluationError::at(path, format!("{text}; --allow-missing scores them as empty")));
            }
            if !unknown.is_empty() {
                let text = count_and_names(&unknown, "predicted that the scene does not have");
                return Err(EvaluationError::at(path, format!("{text}; --allow-missing leaves them out")));
            }
        }
        Ok(MissingCounts {
            missing_predictions: without.len(),
            unlabelled_frames: 0,
            unknown_predictions: unknown.len(),
        })
    }
}

/// How many frames are `what`, and which.
pub(super) fn count_and_names(names: &[&str], what: &str) -> String {
    let listed = names.iter().take(LISTED_NAMES).copied().collect::<Vec<_>>().join(", ");
    let frames = if names.len() == 1 { "frame" } else { "frames" };
    match names.len().saturating_sub(LISTED_NAMES) {
        0 => format!("{} {frames} {what}: {listed}", names.len()),
        more => format!("{} {frames} {what}: {listed} and {more} more", names.len()),
    }
}

#[cfg(test)]
mod tests {
    use super::count_and_names;

    #[test]
    fn long_lists_are_counted() {
        assert_eq!(count_and_names(&["7"], "without x"), "1 frame without x: 7");
        let names = ["a", "b", "c", "d", "e", "f", "g"];
        assert_eq!(count_and_names(&names, "without x"), "7 frames without x: a, b, c, d, e and 2 more");
    }
}
