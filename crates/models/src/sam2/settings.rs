//! Settings of SAM 2.1.

use super::Sam2Error;
use serde::{Deserialize, Serialize};
use splatseg_settings::choices;

choices! {
    /// Reduction of remembered maps before memory attention. EfficientTAM is trained with one of them; its checkpoints
    /// do not tell which.
    pub enum MemoryPooling, default None {
        /// None: `efficienttam_s`, `efficienttam_ti`, and the other networks
        None = "none",
        /// 2 × 2 tokens become one that counts four times: `efficienttam_s_1`, `efficienttam_ti_1`
        Weighted = "weighted",
        /// 2 × 2 tokens become one, to whose key ln 4 is added in every channel: `efficienttam_s_2`, `efficienttam_ti_2`
        Shifted = "shifted",
    }
}

/// Settings for tracking a video. Settings shared with the official predictor have its names and defaults.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Sam2PredictorSettings {
    /// Number of objects that the network processes together. More is faster and takes more memory; results do not
    /// change.
    pub objects_per_chunk: usize,
    /// Maximum number of an object's conditioning frames in attention, the latest ones; `None` for all of them, which
    /// is -1 in the official code. An object has one conditioning frame unless corrections condition or it has rested.
    pub max_cond_frames_in_attn: Option<usize>,
    /// Makes a tracked frame a conditioning frame when it is corrected. If false, the corrected mask is remembered like
    /// the masks of other tracked frames, and for as long.
    pub add_all_frames_to_correct_as_cond: bool,
    /// Tracks a corrected frame that does not condition again without its prompts before the next frame, so that the
    /// correction is lost. The official code does this when its propagation restarts at that frame; when it continues
    /// with the next frame, the correction is remembered.
    pub track_corrected_frames_again: bool,
    /// Maximum area of holes filled in masks, in pixels at a quarter of the input's resolution; 0 fills none.
    pub fill_hole_area: usize,
    /// Number of consecutive frames without an object after which it rests: the network no longer processes it, and
    /// only its conditioning frames are kept, until it is prompted or found again. 0: objects never rest, as in the
    /// official code.
    pub max_absent_frames: usize,
    /// Number of frames between checks for a resting object, which is tracked again if found; 0: never checked.
    pub absent_check_interval: usize,
    /// Maximum number of resting objects; beyond it, those that have rested longest are forgotten. 0: no limit.
    pub max_resting_objects: usize,
    /// Number of frames of the video, if known: for videos of fewer than 16 frames, the official code scales the age of
    /// object pointers by it.
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
    /// The official predictor's defaults, for a video of `length` frames.
    pub fn official(length: usize) -> Self {
        Self { max_cond_frames_in_attn: None, video_length: Some(length), ..Self::default() }
    }

    /// Returns the settings if all are in range.
    pub(super) fn validated(self) -> Result<Self, Sam2Error> {
        let setting =
            |field, found: usize| Sam2Error::Setting { field, found: found.to_string(), expected: "at least 1".into() };
        match self {
            Self { objects_per_chunk: 0, .. } => Err(setting("objects_per_chunk", 0)),
            Self { max_cond_frames_in_attn: Some(0), .. } => Err(setting("max_cond_frames_in_attn", 0)),
            _ => Ok(self),
        }
    }
}
