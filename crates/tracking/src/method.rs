//! What every method does.

use crate::{FrameOutput, TrackingError};
use splatseg_geometry::{RgbdFrame, ScoredMask};
use splatseg_memory::SplatMemory;

/// Gives segments of an RGB-D video their ids, one frame at a time.
pub trait Method: Send {
    /// The name in tables and on the command line, e.g. `fastsam-splat`.
    fn name(&self) -> &str;

    /// Segments the next frame of the video. Methods are online: the result depends on this frame and earlier ones.
    ///
    /// # Errors
    /// [`TrackingError`] says what went wrong; the next frame can be fed all the same.
    fn process(&mut self, frame: &RgbdFrame) -> Result<FrameOutput, TrackingError>;

    /// The splat memory, if the method has one.
    fn memory(&self) -> Option<&SplatMemory> {
        None
    }
}

/// That masks which a method was given are of its frame's size.
pub(crate) fn check_sizes(frame: &RgbdFrame, masks: &[ScoredMask]) -> Result<(), TrackingError> {
    let expected = (frame.width(), frame.height());
    match masks.iter().map(|mask| (mask.mask.width(), mask.mask.height())).find(|found| *found != expected) {
        Some(found) => Err(TrackingError::MaskSize { found, expected }),
        None => Ok(()),
    }
}
