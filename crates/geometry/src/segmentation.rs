//! The result of a segmenter for one frame.

use crate::{Affinities, ScoredMask, SegmentMap};

/// The segments of a frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Segmentation {
    /// Masks of the frame's size, in any order, possibly overlapping.
    pub masks: Vec<ScoredMask>,
    /// Regions that lie in one object as far as the segmenter can tell: a finer cut of the image than its masks,
    /// `[height, width]`, numbered from 1, with 0 for none. `None` for a segmenter that knows only masks.
    pub regions: Option<SegmentMap>,
    /// How surely pairs of pixels show one object. `None` for a segmenter that knows only masks.
    pub affinities: Option<Affinities>,
}

impl From<Vec<ScoredMask>> for Segmentation {
    /// Masks of a segmenter that knows nothing else.
    fn from(masks: Vec<ScoredMask>) -> Self {
        Self { masks, regions: None, affinities: None }
    }
}
