//! Trackers of prompted objects.

use splatseg_geometry::{CameraFrame, Mask, Prompt, SegmentId};
use splatseg_models::sam2::Sam2Error;
use splatseg_settings::SettingError;
use thiserror::Error;

mod new_objects;
mod sam2;
mod track_masks;

pub(crate) use new_objects::NewObjects;
pub use new_objects::PromptSource;
pub use sam2::{Sam2Tracker, Sam2TrackerSettings};
pub(crate) use track_masks::{add_tracks, prompt_tracks, remove_tracks, visible};

/// Follows prompted objects through a video, each as a track with an id that the caller chooses.
///
/// For each frame, call [`Tracker::track`] first, then [`Tracker::prompt`] with any prompts on that frame. Give all
/// prompts of a frame in **one** call, as networks process many at a time.
pub trait Tracker: Send {
    /// Short name for tables and summaries, e.g. `sam2`.
    fn name(&self) -> &str;

    /// Follows every track into the next frame. Returns masks of the frame's size, by increasing id. Masks may overlap,
    /// and are empty for tracks whose object is not in the frame.
    ///
    /// # Errors
    /// If the tracker cannot use the frame.
    fn track(&mut self, frame: &CameraFrame) -> Result<Vec<(SegmentId, Mask)>, TrackerError>;

    /// Prompts tracks on the current frame. An unknown id becomes a new track; a prompt to a known one corrects it, in
    /// this frame and in later ones. Returns the masks after prompting, in the order of the prompts; a mask is empty if
    /// the prompt selects nothing.
    ///
    /// # Errors
    /// If there is no current frame, or a prompt is invalid. Then no prompt takes effect.
    fn prompt(&mut self, prompts: &[(SegmentId, Prompt)]) -> Result<Vec<(SegmentId, Mask)>, TrackerError>;

    /// Removes a track; its id may be prompted again. Does nothing if there is no such track.
    fn remove(&mut self, track: SegmentId);
}

/// An error of a tracker.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum TrackerError {
    /// The network rejected a frame, a prompt or a setting.
    #[error("the tracker sam2: {0}")]
    Sam2(#[from] Sam2Error),
    /// A setting is out of range.
    #[error(transparent)]
    Setting(#[from] SettingError),
    /// A prompt was given before the first frame.
    #[error("a prompt came before the first frame")]
    NoFrame,
    /// A mask prompt does not have the frame's size; both sizes are `(width, height)`.
    #[error(
        "the mask prompt of track {track} has {}x{} pixels, expected the frame's {}x{}",
        found.0, found.1, expected.0, expected.1
    )]
    MaskSize {
        /// The prompted track.
        track: SegmentId,
        /// Size of the mask.
        found: (usize, usize),
        /// Size of the frame.
        expected: (usize, usize),
    },
    /// A click lies outside the frame.
    #[error("the click ({x}, {y}) of track {track} is outside the frame of {width}x{height} pixels")]
    ClickOutside {
        /// The prompted track.
        track: SegmentId,
        /// Column, in pixels.
        x: f32,
        /// Row, in pixels.
        y: f32,
        /// Width of the frame.
        width: usize,
        /// Height of the frame.
        height: usize,
    },
    /// A tracker defined outside this crate failed.
    #[error("the tracker {name}: {source}")]
    Other {
        /// Name of the tracker.
        name: String,
        /// The tracker's error.
        source: Box<dyn std::error::Error + Send + Sync>,
    },
}
