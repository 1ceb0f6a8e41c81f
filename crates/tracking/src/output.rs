//! What a method says about one frame.

use crate::{StageTimes, TrackErrorCounts};
use splatseg_geometry::{Mask, SegmentId, SegmentMap};
use splatseg_memory::FrameUpdate;

/// A method's result for one frame.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameOutput {
    /// One lasting id per pixel, `[height, width]`; 0 where there is no segment.
    pub segments: SegmentMap,
    /// The segments in full, each id once, where a method finds masks that may overlap: `segments` shows them painted,
    /// smaller ones over larger ones, and scores count them as they are. Empty for methods with one id per pixel.
    pub masks: Vec<(SegmentId, Mask)>,
    /// Predicted segments that were large enough to count.
    pub predictions: usize,
    /// Errors of the tracker that were found and put right; 0 for methods that look for none.
    pub track_errors: TrackErrorCounts,
    /// What the frame did to the memory.
    pub update: FrameUpdate,
    /// Where the time went.
    pub times: StageTimes,
}
