//! What every tracker of prompted objects does.

use splatseg_geometry::{Mask, RgbdFrame, SegmentId};
use splatseg_models::sam2::{Prompt, Sam2Error};
use splatseg_segmenter::SegmenterError;
use thiserror::Error;

/// Follows objects that it was prompted with through a video, each as a track with an id that the caller chose.
///
/// A frame: [`Tracker::track`] first, then any prompts on that frame. What is wrong or new in a frame should come in
/// **one** call of [`Tracker::prompt`], as networks work on many prompts at a time.
pub trait Tracker: Send {
    /// A short name for tables and summaries, e.g. `sam2`.
    fn name(&self) -> &str;

    /// Takes the next frame and follows every track into it. Masks are of the frame's size, come by increasing id and
    /// may overlap; that of a track whose object is not in the frame is empty.
    ///
    /// # Errors
    /// If the tracker cannot use the frame.
    fn track(&mut self, frame: &RgbdFrame) -> Result<Vec<(SegmentId, Mask)>, TrackerError>;

    /// Prompts tracks on the current frame. An unknown id becomes a new track; a prompt to a known one corrects it, in
    /// this frame and for those to come. Masks are those after prompting, in the order of the prompts; empty where
    /// the prompt shows nothing.
    ///
    /// # Errors
    /// If there is no current frame, or a prompt makes no sense. No prompt takes effect then.
    fn prompt(&mut self, prompts: &[(SegmentId, Prompt)]) -> Result<Vec<(SegmentId, Mask)>, TrackerError>;

    /// Stops following a track and forgets it; its id may be prompted again. Nothing happens if there is no such track.
    fn remove(&mut self, track: SegmentId);
}

/// What keeps a tracker from its work.
#[derive(Debug, Error)]
pub enum TrackerError {
    /// The network refuses a frame, a prompt or a setting.
    #[error("the tracker sam2: {0}")]
    Sam2(#[from] Sam2Error),
    /// The simulated tracker cannot learn what is true.
    #[error("the tracker sim: {0}")]
    GroundTruth(#[from] SegmenterError),
    /// Prompts came before the first frame.
    #[error("a prompt came before the first frame")]
    NoFrame,
    /// A mask prompt is not of the frame's size; both are `(width, height)`.
    #[error("the mask given for track {track} has {}x{} pixels, expected the frame's {}x{}", found.0, found.1, expected.0, expected.1)]
    MaskSize {
        /// The track prompted.
        track: SegmentId,
        /// Size of the mask.
        found: (usize, usize),
        /// Size of the frame.
        expected: (usize, usize),
    },
    /// A click lies outside the frame.
    #[error("the click ({x}, {y}) for track {track} is outside the frame of {width}x{height} pixels")]
    ClickOutside {
        /// The track prompted.
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
    /// A setting is out of range.
    #[error("{field} is {found}, expected {expected}")]
    Setting {
        /// The setting's name, e.g. `sim_tracker.swap_rate`.
        field: &'static str,
        /// Its value.
        found: String,
        /// What it may be.
        expected: &'static str,
    },
}
