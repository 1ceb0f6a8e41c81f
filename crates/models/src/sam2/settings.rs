//! Settings of SAM 2.1.

use super::Sam2Error;
use serde::{Deserialize, Serialize};

/// How a video is tracked.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Sam2PredictorSettings {
    /// How many objects go through the network together. More is faster and takes more memory; results do not change.
    pub objects_per_chunk: usize,
    /// How many prompted frames of an object attention sees, the latest ones; `None` for all of them, as in the official
    /// code, whose memory grows with every prompted frame.
    pub max_prompted_frames: Option<usize>,
    /// Whether a correction on a tracked frame conditions the frames after it. If not, it changes only what is returned
    /// for its own frame, as in the official code, which tracks that frame again without the clicks.
    pub corrections_condition: bool,
    /// Number of frames of the video, where known: the official code measures the age of object pointers against it in
    /// videos of fewer than 16 frames.
    pub video_length: Option<usize>,
}

impl Default for Sam2PredictorSettings {
    fn default() -> Self {
        Self { objects_per_chunk: 4, max_prompted_frames: Some(4), corrections_condition: true, video_length: None }
    }
}

impl Sam2PredictorSettings {
    /// What the official predictor does, for a video of `length` frames.
    pub fn parity(length: usize) -> Self {
        Self { max_prompted_frames: None, corrections_condition: false, video_length: Some(length), ..Self::default() }
    }

    /// The settings, if all are in range.
    pub(super) fn validated(self) -> Result<Self, Sam2Error> {
        let setting =
            |field, found: usize| Sam2Error::Setting { field, found: found.to_string(), expected: "at least 1" };
        match self {
            Self { objects_per_chunk: 0, .. } => Err(setting("objects_per_chunk", 0)),
            Self { max_prompted_frames: Some(0), .. } => Err(setting("max_prompted_frames", 0)),
            _ => Ok(self),
        }
    }
}
