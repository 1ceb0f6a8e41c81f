//! Checks that ground truth and predictions cover the frames to score.

use super::EvaluationError;
use serde::Serialize;
use splatseg_annotations::{AnnotationError, Predictions, SelectedFrames};

/// Maximum number of names listed in an error.
const LISTED_NAMES: usize = 5;

/// Policy for frames that are missing from the predictions or the ground truth.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MissingFrames {
    /// Return an error.
    Refused,
    /// Score frames without prediction as empty, and leave out frames without ground truth.
    Allowed,
}

/// Numbers of frames that are missing from the predictions, the ground truth or the scene.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct MissingCounts {
    /// Frames without prediction.
    pub missing_predictions: usize,
    /// Frames without ground truth.
    pub unlabelled_frames: usize,
    /// Predicted frames that are not in the scene.
    pub unknown_predictions: usize,
}

/// Compares the selected frames with the predicted ones. Predictions for frames that exist but are not selected are
/// not an error.
pub(super) fn check_predictions(
    frames: &SelectedFrames,
    predictions: &Predictions,
    missing: MissingFrames,
) -> Result<MissingCounts, EvaluationError> {
    let names: Vec<&str> = frames.selected().iter().map(|(_, name)| name.as_str()).collect();
    let without: Vec<&str> = names.into_iter().filter(|name| !predictions.has(name)).collect();
    let unknown: Vec<&str> = predictions.names().filter(|name| !frames.contains(name)).collect();
    if missing == MissingFrames::Refused {
        let refused = |text: String| Err(AnnotationError::at(predictions.path(), text).into());
        if !without.is_empty() {
            let text = count_and_names(&without, "without prediction");
            return refused(format!("{text}; --allow-missing scores them as empty"));
        }
        if !unknown.is_empty() {
            let text = count_and_names(&unknown, "predicted but not in the scene");
            return refused(format!("{text}; --allow-missing leaves them out"));
        }
    }
    Ok(MissingCounts { missing_predictions: without.len(), unlabelled_frames: 0, unknown_predictions: unknown.len() })
}

/// Formats the number of frames that are `what`, with their names.
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
