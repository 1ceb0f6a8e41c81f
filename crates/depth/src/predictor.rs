//! The trait of everything that predicts depth from colour.

use splatseg_geometry::{CameraFrame, Image};
use std::error::Error;
use thiserror::Error;

/// Depth of a frame as predicted from its colour.
#[derive(Clone, Debug, PartialEq)]
pub struct PredictedDepth {
    /// z-depth, `[height, width]` as the frame, 0 where nothing is predicted. In metres if the predictor knows the scale;
    /// otherwise in any unit, the same all over the image.
    pub depth: Image<f32>,
    /// How far the depth can be trusted, 0 to 1, `[height, width]`. `None` if the predictor does not know.
    pub confidence: Option<Image<f32>>,
}

/// An error predicting depth.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum DepthPredictorError {
    /// The prediction has another size than the frame; both are `(width, height)`.
    #[error("the depth predictor {name} returned {}x{} pixels, expected {}x{}, the frame's size", found.0, found.1, expected.0, expected.1)]
    Size {
        /// Name of the predictor.
        name: String,
        /// Size of the prediction.
        found: (usize, usize),
        /// Size of the frame.
        expected: (usize, usize),
    },
    /// An error of another kind.
    #[error("the depth predictor {name} failed: {source}")]
    Other {
        /// Name of the predictor.
        name: String,
        /// The error.
        source: Box<dyn Error + Send + Sync>,
    },
}

/// Predicts depth from colour.
///
/// To add your own, implement this trait and report its errors as [`DepthPredictorError::Other`].
pub trait DepthPredictor: Send {
    /// A short name for messages.
    fn name(&self) -> &str;

    /// Returns the depth of a frame. Measured depth that came with the frame may be ignored.
    ///
    /// # Errors
    /// [`DepthPredictorError`] if the frame's depth cannot be predicted.
    fn predict(&mut self, frame: &CameraFrame<'_>) -> Result<PredictedDepth, DepthPredictorError>;

    /// False if the unit of its depth is not known to be the metre.
    fn knows_scale(&self) -> bool {
        true
    }
}

impl PredictedDepth {
    /// Checks that a prediction belongs to a frame: its size, and that no value is negative, infinite or NaN. Values that
    /// are become 0.
    ///
    /// # Errors
    /// [`DepthPredictorError::Size`].
    pub fn checked(mut self, predictor: &str, frame: &CameraFrame<'_>) -> Result<Self, DepthPredictorError> {
        let expected = (frame.width(), frame.height());
        let sizes = [Some(self.depth.size()), self.confidence.as_ref().map(Image::size)];
        if let Some(found) = sizes.into_iter().flatten().find(|found| *found != expected) {
            return Err(DepthPredictorError::Size { name: predictor.to_owned(), found, expected });
        }
        for depth in self.depth.pixels_mut() {
            if !(depth.is_finite() && *depth > 0.0) {
                *depth = 0.0;
            }
        }
        Ok(self)
    }
}
