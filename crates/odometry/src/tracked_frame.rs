//! Frame data that tracking reads.

use crate::pyramid::{GreyFrame, Pyramid};
use splatseg_geometry::{CameraFrame, CowImage};
use std::time::Duration;

/// A frame to track.
pub(crate) struct TrackedFrame<'a> {
    pub(crate) grey: GreyFrame,
    pub(crate) pyramid: Pyramid,
    /// sRGB, `[height, width]`.
    pub(crate) color: &'a CowImage<'a, [u8; 3]>,
    pub(crate) timestamp: Option<Duration>,
}

impl<'a> TrackedFrame<'a> {
    pub(crate) fn new(frame: &'a CameraFrame<'_>) -> Self {
        let grey = GreyFrame::new(frame);
        let pyramid = Pyramid::new(&grey);
        Self { grey, pyramid, color: frame.color(), timestamp: frame.timestamp() }
    }
}
