//! What every segmenter does.

use crate::SegmenterError;
use splatseg_geometry::{RgbdFrame, ScoredMask};

/// Finds the segments of single frames.
pub trait Segmenter: Send {
    /// A short name for tables and summaries, e.g. `graph`.
    fn name(&self) -> &str;

    /// The segments of `frame`: masks of the frame's size, which may overlap, in any order. Empty masks are left out,
    /// so a frame in which nothing was found gives an empty list.
    ///
    /// # Errors
    /// [`SegmenterError`] says what kept the segmenter from its work.
    fn segment(&mut self, frame: &RgbdFrame) -> Result<Vec<ScoredMask>, SegmenterError>;
}
