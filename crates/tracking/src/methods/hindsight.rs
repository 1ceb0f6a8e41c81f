//! Earlier frames, decided again with what the method has learnt since.

use super::FrameOutput;
use crate::TrackingError;
use splatseg_geometry::{RgbdFrame, SegmentMap};

/// Result of a frame when it was processed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ShownFrame {
    /// Id of each pixel, `[height, width]`, 0 for none, with the names that ids have by now.
    pub segments: SegmentMap,
    /// The segmenter's finer cut; see [`Segmentation::regions`](splatseg_geometry::Segmentation::regions).
    pub regions: Option<SegmentMap>,
}

/// Decides earlier frames again. The frames need no segmenter, may come in any order, and change nothing.
pub trait Hindsight: Sync {
    /// Returns the object that each pixel of an earlier frame shows, as far as is known now. `frame` has its final pose.
    ///
    /// # Errors
    /// [`TrackingError::MaskSize`] if `shown` does not have the frame's size.
    fn look_again(&self, frame: &RgbdFrame, shown: &ShownFrame) -> Result<FrameOutput, TrackingError>;
}
