//! Networks that are loaded once for many pipelines.

use super::PipelineError;
use splatseg_models::checkpoint::Checkpoint;
use splatseg_models::device::DeviceName;
use splatseg_models::fastsam::{FastSamPredictor, FastSamPredictorSettings};
use splatseg_models::sam2::Sam2Network;
use splatseg_segmenter::{AffinityNetwork, SegmenterError};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

/// The networks that pipelines have loaded, for later ones that need the same: copies share their weights. Of each kind
/// the latest is kept.
#[derive(Debug, Default)]
pub struct LoadedNetworks {
    affinity: Latest<(Option<PathBuf>, DeviceName), AffinityNetwork>,
    fastsam: Latest<(PathBuf, FastSamPredictorSettings, DeviceName), FastSamPredictor>,
    sam2: Latest<(PathBuf, Option<usize>, DeviceName), Sam2Network>,
}

/// The network that was loaded last, and what it was loaded from.
#[derive(Debug)]
struct Latest<K, N>(Mutex<Option<(K, N)>>);

impl<K, N> Default for Latest<K, N> {
    fn default() -> Self {
        Self(Mutex::new(None))
    }
}

impl<K: PartialEq, N: Clone> Latest<K, N> {
    fn get(&self, key: K, load: impl FnOnce(&K) -> Result<N, PipelineError>) -> Result<N, PipelineError> {
        let mut latest = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, network)) = latest.as_ref().filter(|(found, _)| *found == key) {
            return Ok(network.clone());
        }
        let network = load(&key)?;
        *latest = Some((key, network.clone()));
        Ok(network)
    }
}

impl LoadedNetworks {
    /// The affinity network of a file, or of the weights built in.
    ///
    /// # Errors
    /// If it cannot be loaded.
    pub(super) fn affinity(
        &self,
        weights: Option<&Path>,
        device: DeviceName,
    ) -> Result<AffinityNetwork, PipelineError> {
        self.affinity.get((weights.map(Path::to_owned), device), |(weights, device)| {
            let network = match (device, weights) {
                (DeviceName::Cpu, None) => AffinityNetwork::built_in(),
                (DeviceName::Cpu, Some(weights)) => AffinityNetwork::open(weights),
                (device, weights) => AffinityNetwork::on_device(weights.as_deref(), &device.open()?),
            };
            Ok(network.map_err(SegmenterError::from)?)
        })
    }

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
        self.fastsam.get((weights.to_owned(), settings.clone(), device), |(weights, settings, device)| {
            let predictor = FastSamPredictor::open(weights, settings.clone(), &device.open()?);
            Ok(predictor.map_err(SegmenterError::from)?)
        })
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
        self.sam2.get((weights.to_owned(), image_size, device), |(weights, image_size, device)| {
            let checkpoint = Checkpoint::open(weights)?;
            Sam2Network::load(&checkpoint, *image_size, &device.open()?)
                .map_err(|source| PipelineError::Sam2 { path: weights.clone(), source: Box::new(source) })
        })
    }
}
