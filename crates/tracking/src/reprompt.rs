//! Settings of re-prompting, and from the tracker's errors to clicks (METHOD, "SAM2-Splat, one frame", step 3).

use crate::track_errors::{Remedy, TrackError};
use crate::{TrackingError, sample_clicks};
use serde::{Deserialize, Serialize};
use splatseg_geometry::{Mask, SegmentId};
use splatseg_models::sam2::{Click, Prompt};

/// Which errors of a tracker are looked for, and what is asked of it then. The paper names the errors and the number of
/// clicks; the thresholds are ours.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RepromptSettings {
    /// Whether segments that are expected but absent are prompted.
    pub not_tracked: bool,
    /// Whether segments that are tracked under another id, or whose track lies elsewhere, are prompted.
    pub incorrect_track: bool,
    /// Whether tracks of a segment that its own track follows, too, are put right or removed.
    pub duplicated_track: bool,
    /// Positive clicks per error, and as many negative ones where a region has the wrong label. At least 1. The paper's: 5.
    pub clicks: usize,
    /// A track lies on an expected segment if their F-score, where the memory knows what to expect, is at least this.
    /// Above 0, at most 1.
    pub min_f_score: f64,
    /// A track is wrong if the memory expects other segments on more than this share of the pixels that show its id. In
    /// [0, 1].
    pub max_wrong_share: f64,
    /// Pixels this near to the track's own expected segment are not wrong, in steps along rows and columns.
    pub outline_tolerance_px: usize,
    /// An absent segment is prompted if other tracks cover at most this share of it. In [0, 1].
    pub max_covered_share: f64,
    /// Expected segments of fewer pixels are not trusted.
    pub min_expected_area: usize,
    /// Expected segments with a smaller mean confidence are not trusted.
    pub min_confidence: f32,
}

impl Default for RepromptSettings {
    fn default() -> Self {
        Self {
            not_tracked: true,
            incorrect_track: true,
            duplicated_track: true,
            clicks: 5,
            min_f_score: 0.5,
            max_wrong_share: 0.25,
            outline_tolerance_px: 2,
            max_covered_share: 0.5,
            min_expected_area: 100,
            min_confidence: 0.6,
        }
    }
}

impl RepromptSettings {
    /// The settings, if all are in range.
    ///
    /// # Errors
    /// [`TrackingError::Setting`] names the first that is not.
    pub fn validated(self) -> Result<Self, TrackingError> {
        let setting = |field, found: String, expected| Err(TrackingError::Setting { field, found, expected });
        if self.clicks == 0 {
            return setting("reprompt.clicks", "0".to_owned(), "1 or more");
        }
        if !(self.min_f_score > 0.0 && self.min_f_score <= 1.0) {
            return setting("reprompt.min_f_score", self.min_f_score.to_string(), "more than 0 and at most 1");
        }
        let shares = [
            ("reprompt.max_wrong_share", self.max_wrong_share),
            ("reprompt.max_covered_share", self.max_covered_share),
        ];
        for (field, found) in shares {
            if !(0.0..=1.0).contains(&found) {
                return setting(field, found.to_string(), "0 to 1");
            }
        }
        if !(self.min_confidence.is_finite() && self.min_confidence >= 0.0) {
            let found = self.min_confidence.to_string();
            return setting("reprompt.min_confidence", found, "a number that is not negative");
        }
        Ok(self)
    }
}

/// The prompts that put errors right, and the tracks to be removed.
pub(crate) fn corrections(errors: &[TrackError], clicks: usize) -> (Vec<(SegmentId, Prompt)>, Vec<SegmentId>) {
    let (mut prompts, mut removed) = (Vec::new(), Vec::new());
    for error in errors {
        match &error.remedy {
            Remedy::Remove => removed.push(error.track),
            Remedy::Prompt { expected, wrong } => {
                let mut all = clicks_in(expected, clicks, true);
                all.extend(clicks_in(wrong, clicks, false));
                prompts.push((error.track, Prompt::Points { bounding_box: None, clicks: all }));
            }
        }
    }
    (prompts, removed)
}

/// Clicks at the centres of pixels: a [`Click`] counts from the image's border.
fn clicks_in(region: &Mask, count: usize, positive: bool) -> Vec<Click> {
    let click = |(column, row): (usize, usize)| Click { x: column as f32 + 0.5, y: row as f32 + 0.5, positive };
    sample_clicks(region, count).into_iter().map(click).collect()
}
