//! The result of a segmenter for one frame.

use crate::{Affinities, QuarterTurn, ScoredMask, SegmentMap};

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

impl Segmentation {
    /// The segments of the turned frame. `size` (width, height) is the frame's before the turn.
    #[must_use]
    pub fn turned(&self, turn: QuarterTurn, size: (usize, usize)) -> Self {
        let mask = |scored: &ScoredMask| ScoredMask { mask: scored.mask.turned(turn), score: scored.score };
        Self {
            masks: self.masks.iter().map(mask).collect(),
            regions: self.regions.as_ref().map(|regions| regions.turned(turn)),
            affinities: self.affinities.as_ref().map(|affinities| affinities.turned(turn, size)),
        }
    }
}
