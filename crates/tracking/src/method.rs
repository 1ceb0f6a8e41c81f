//! What every method does.

use crate::{FrameOutput, TrackingError};
use splatseg_geometry::{RgbdFrame, ScoredMask};
use splatseg_memory::SplatMemory;
use splatseg_segmenter::Segmenter;
use std::time::Instant;

/// Gives segments of an RGB-D video their ids, one frame at a time.
pub trait Method: Send {
    /// The name in tables and on the command line, e.g. `fastsam-splat`.
    fn name(&self) -> &str;

    /// The segmenter that [`Method::process`] asks for masks.
    fn segmenter(&mut self) -> &mut dyn Segmenter;

    /// Gives masks of the next frame, from whatever source, their ids: every step but the segmenter's.
    ///
    /// # Errors
    /// [`TrackingError`] says what went wrong, e.g. [`TrackingError::MaskSize`] if a mask is not of the frame's size.
    fn track(&mut self, frame: &RgbdFrame, masks: &[ScoredMask]) -> Result<FrameOutput, TrackingError>;

    /// Segments the next frame of the video. Methods are online: the result depends on this frame and earlier ones.
    ///
    /// # Errors
    /// [`TrackingError`] says what went wrong; where it was the segmenter, the next frame can be fed all the same.
    fn process(&mut self, frame: &RgbdFrame) -> Result<FrameOutput, TrackingError> {
        let started = Instant::now();
        let masks = self.segmenter().segment(frame)?;
        let segment = started.elapsed();
        let mut output = self.track(frame, &masks)?;
        output.times.segment = segment;
        Ok(output)
    }

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
