//! FastSAM (Zhao et al. 2023, arXiv 2306.12156), without the network.

#[path = "../fastsam/detection.rs"]
mod detection;
#[path = "../fastsam/error.rs"]
mod error;
#[path = "../fastsam/point_prompt.rs"]
mod point_prompt;
#[path = "../fastsam/settings.rs"]
mod settings;

pub use detection::Detection;
pub use error::FastSamError;
pub use point_prompt::masks_at;
pub use settings::FastSamPredictorSettings;

use super::Device;
use splatseg_geometry::CowImage;
use std::path::Path;

/// FastSAM, which this program does not contain.
#[derive(Clone, Debug)]
pub struct FastSamPredictor(Device);

impl FastSamPredictor {
    /// Stands for loading the network from a checkpoint.
    ///
    /// # Errors
    /// Never, as there is no device.
    pub fn open(_: &Path, _: FastSamPredictorSettings, device: &Device) -> Result<Self, FastSamError> {
        device.unreachable()
    }

    /// Stands for segmenting an image.
    ///
    /// # Errors
    /// Never, as there is no predictor.
    pub fn predict(&self, _: &CowImage<'_, [u8; 3]>) -> Result<Vec<Detection>, FastSamError> {
        self.0.unreachable()
    }
}
