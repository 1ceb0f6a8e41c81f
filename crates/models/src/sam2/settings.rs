//! Settings of SAM 2.1.

use super::Sam2Error;
use serde::{Deserialize, Serialize};

/// How a video is tracked. Names and defaults are those of the official predictor where it has the setting.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Sam2PredictorSettings {
    /// How many objects go through the network together. More is faster and takes more memory; results do not change.
    pub objects_per_chunk: usize,
    /// How many conditioning frames of an object attention sees, the latest ones; `None` for all of them, which is the
    /// official -1. An object has one conditioning frame unless corrections condition or it has rested.
    pub max_cond_frames_in_attn: Option<usize>,
    /// Whether a correction on a tracked frame makes it a conditioning frame. If not, the corrected mask is remembered
    /// as the masks of other tracked frames are, for as long as those.
    pub add_all_frames_to_correct_as_cond: bool,
    /// Whether a corrected frame that does not condition is tracked again without its prompts before the next frame, so
    /// that the correction is lost. This is what the official code does when its propagation starts over at that frame;
    /// when it goes on with the next frame, the correction is remembered.
    pub track_corrected_frames_again: bool,
    /// Holes of at most this many pixels are filled in masks at a quarter of the input's resolution; 0 fills none.
    pub fill_hole_area: usize,
    /// An object that has been absent from this many frames in a row comes to rest: it no longer goes through the
    /// network, and only its conditioning frames are kept, until it is prompted. 0: objects never rest, as in the
    /// official code.
    pub max_absent_frames: usize,
    /// A resting object is looked for every so many frames, and followed again if it is found; 0: it is not looked for.
    pub absent_check_interval: usize,
    /// Of more resting objects than this, those are forgotten that have rested for longest; 0: none is.
    pub max_resting_objects: usize,
    /// Number of frames of the video, where known: the official code measures the age of object pointers against it in
    /// videos of fewer than 16 frames.
    pub video_length: Option<usize>,
}

impl Default for Sam2PredictorSettings {
    fn default() -> Self {
        Self {
            objects_per_chunk: 4,
            max_cond_frames_in_attn: Some(4),
            add_all_frames_to_correct_as_cond: false,
            track_corrected_frames_again: false,
            fill_hole_area: 8,
            max_absent_frames: 0,
            absent_check_interval: 0,
            max_resting_objects: 0,
            video_length: None,
        }
    }
}

impl Sam2PredictorSettings {
    /// What the official predictor does by default, for a video of `length` frames.
    pub fn official(length: usize) -> Self {
        Self { max_cond_frames_in_attn: None, video_length: Some(length), ..Self::default() }
    }

    /// The settings, if all are in range.
    pub(super) fn validated(self) -> Result<Self, Sam2Error> {
        let setting =
            |field, found: usize| Sam2Error::Setting { field, found: found.to_string(), expected: "at least 1" };
        match self {
            Self { objects_per_chunk: 0, .. } => Err(setting("objects_per_chunk", 0)),
            Self { max_cond_frames_in_attn: Some(0), .. } => Err(setting("max_cond_frames_in_attn", 0)),
            _ => Ok(self),
        }
    }
}
