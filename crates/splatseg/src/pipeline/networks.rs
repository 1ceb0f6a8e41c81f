//! Networks that are loaded once for many pipelines.

use super::PipelineError;
use splatseg_models::checkpoint::Checkpoint;
use splatseg_models::device::DeviceName;
use splatseg_models::fastsam::{FastSamPredictor, FastSamPredictorSettings};
use splatseg_models::sam2::Sam2Network;
use splatseg_segmenter::SegmenterError;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

/// The networks that pipelines have loaded, for later ones that need the same: copies share their weights.
#[derive(Debug, Default)]
pub struct LoadedNetworks {
    fastsam: Mutex<Option<(PathBuf, FastSamPredictorSettings, DeviceName, FastSamPredictor)>>,
    sam2: Mutex<Option<(PathBuf, Option<usize>, DeviceName, Sam2Network)>>,
}

impl LoadedNetworks {
    /// FastSAM of a checkpoint.
    ///
    /// # Errors
    /// If it cannot be loaded.
    pub(super) fn fastsam(
        &self,
        weights: &Path,
        settings: &FastSamPredictorSettings,
        device: DeviceName,
    ) -> Result<FastSamPredictor, PipelineError> {
        let mut loaded = self.fastsam.lock().unwrap_or_else(PoisonError::into_inner);
        match &*loaded {
            Some((path, with, on, predictor)) if (path.as_path(), with, *on) == (weights, settings, device) => {
                Ok(predictor.clone())
            }
            _ => {
                let predictor = FastSamPredictor::open(weights, settings.clone(), &device.open()?);
                let predictor = predictor.map_err(SegmenterError::from)?;
                *loaded = Some((weights.to_owned(), settings.clone(), device, predictor.clone()));
                Ok(predictor)
            }
        }
    }

    /// SAM 2.1 of a checkpoint, for images of a size.
    ///
    /// # Errors
    /// If it cannot be loaded.
    pub(super) fn sam2(
        &self,
        weights: &Path,
        image_size: Option<usize>,
        device: DeviceName,
    ) -> Result<Sam2Network, PipelineError> {
        let mut loaded = self.sam2.lock().unwrap_or_else(PoisonError::into_inner);
        match &*loaded {
            Some((path, size, on, network)) if (path.as_path(), *size, *on) == (weights, image_size, device) => {
                Ok(network.clone())
            }
            _ => {
                let checkpoint = Checkpoint::open(weights)?;
                let network = Sam2Network::load(&checkpoint, image_size, &device.open()?)
                    .map_err(|source| PipelineError::Sam2 { path: weights.to_owned(), source: Box::new(source) })?;
                *loaded = Some((weights.to_owned(), image_size, device, network.clone()));
                Ok(network)
            }
        }
    }
}
