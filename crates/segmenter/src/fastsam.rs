//! FastSAM as a segmenter.

use crate::{Segmenter, SegmenterError};
use splatseg_geometry::{RgbdFrame, ScoredMask};
use splatseg_models::fastsam::FastSamPredictor;

/// FastSAM on the frame's colour image; depth is not looked at.
#[derive(Clone, Debug)]
pub struct FastSamSegmenter {
    predictor: FastSamPredictor,
}

impl FastSamSegmenter {
    /// A segmenter over a predictor.
    pub fn new(predictor: FastSamPredictor) -> Self {
        Self { predictor }
    }
}

impl Segmenter for FastSamSegmenter {
    fn name(&self) -> &str {
        "fastsam"
    }

    /// Best first. Boxes are left out: they say where the masks were looked for.
    fn segment(&mut self, frame: &RgbdFrame) -> Result<Vec<ScoredMask>, SegmenterError> {
        let detections = self.predictor.predict(frame.color())?;
        Ok(detections.into_iter().map(|found| ScoredMask { mask: found.mask, score: found.score }).collect())
    }
}
