//! The result of a segmenter for one frame.

use crate::{ScoredMask, SegmentMap};

/// The segments of a frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Segmentation {
    /// Masks of the frame's size, in any order, possibly overlapping.
    pub masks: Vec<ScoredMask>,
    /// Regions that lie in one object as far as the segmenter can tell: a finer cut of the image than its masks,
    /// `[height, width]`, numbered from 1, with 0 for none. `None` for a segmenter that knows only masks.
    pub regions: Option<SegmentMap>,
}

impl From<Vec<ScoredMask>> for Segmentation {
    /// Masks of a segmenter that knows no regions.
    fn from(masks: Vec<ScoredMask>) -> Self {
        Self { masks, regions: None }
    }
}
