//! FastSAM as a segmenter. The network itself is in `splatseg-models`.

use crate::{Segmenter, SegmenterError};
use splatseg_geometry::{CameraFrame, ScoredMask, Segmentation};
use splatseg_models::fastsam::FastSamPredictor;

/// FastSAM on the frame's colour image. Depth is ignored.
#[derive(Clone, Debug)]
pub struct FastSamSegmenter {
    predictor: FastSamPredictor,
}

impl FastSamSegmenter {
    /// Wraps a predictor.
    pub fn new(predictor: FastSamPredictor) -> Self {
        Self { predictor }
    }
}

impl Segmenter for FastSamSegmenter {
    fn name(&self) -> &str {
        "fastsam"
    }

    fn prefers_upright(&self) -> bool {
        true
    }

    /// Returns FastSAM's masks, highest score first. Its boxes are dropped: they are only where it searched for masks.
    fn segment(&mut self, frame: &CameraFrame) -> Result<Segmentation, SegmenterError> {
        let detections = self.predictor.predict(frame.color())?;
        let masks = detections.into_iter().map(|found| ScoredMask { mask: found.mask, score: found.score });
        Ok(masks.collect::<Vec<ScoredMask>>().into())
    }
}
