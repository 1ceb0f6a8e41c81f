//! Cache of loaded networks, shared by pipelines.

use super::PartError;
use splatseg_models::checkpoint::Checkpoint;
use splatseg_models::depth_anything::{DepthAnythingNetwork, DepthOutput};
use splatseg_models::device::DeviceName;
use splatseg_models::fastsam::{FastSamPredictor, FastSamPredictorSettings};
use splatseg_models::sam2::{MemoryPooling, Sam2Network};
use splatseg_segmenter::{AffinityNetwork, AffinityWeights, SegmenterError};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

/// Cache of loaded networks. Pipelines that need the same network share its weights. Only the latest network of each kind
/// is kept.
#[derive(Debug, Default)]
pub struct LoadedNetworks {
    affinity: Latest<(Option<PathBuf>, DeviceName), AffinityNetworks>,
    depth_anything: Latest<(PathBuf, Option<DepthOutput>), Arc<DepthAnythingNetwork>>,
    fastsam: Latest<(PathBuf, FastSamPredictorSettings, DeviceName), FastSamPredictor>,
    sam2: Latest<(PathBuf, Option<usize>, MemoryPooling, DeviceName), Sam2Network>,
}

/// An affinity network, and that for frames with noisy depth.
type AffinityNetworks = (AffinityNetwork, Option<AffinityNetwork>);

/// The network that was loaded last, and its key.
#[derive(Debug)]
struct Latest<K, N>(Mutex<Option<(K, N)>>);

impl<K, N> Default for Latest<K, N> {
    fn default() -> Self {
        Self(Mutex::new(None))
    }
}

impl<K: PartialEq, N: Clone> Latest<K, N> {
    fn get(&self, key: K, load: impl FnOnce(&K) -> Result<N, PartError>) -> Result<N, PartError> {
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
    /// Returns the affinity network of a file, or the one with built-in weights and that for noisy depth.
    ///
    /// # Errors
    /// If they cannot be loaded.
    pub(crate) fn affinity(&self, weights: Option<&Path>, device: DeviceName) -> Result<AffinityNetworks, PartError> {
        self.affinity.get((weights.map(Path::to_owned), device), |(weights, device)| {
            let load = |weights: &AffinityWeights| match device {
                DeviceName::Cpu => AffinityNetwork::load(weights),
                device => AffinityNetwork::load_on_device(weights, &device.open()?),
            };
            let load = |weights| load(&weights).map_err(SegmenterError::from);
            Ok(match weights {
                Some(file) => (load(AffinityWeights::File(file.clone()))?, None),
                None => (load(AffinityWeights::BuiltIn)?, Some(load(AffinityWeights::NoisyDepth)?)),
            })
        })
    }

    /// Returns the depth network of a file; `output` is what it returns, if that is known.
    ///
    /// # Errors
    /// If it cannot be loaded.
    pub(crate) fn depth_anything(
        &self,
        weights: &Path,
        output: Option<DepthOutput>,
    ) -> Result<Arc<DepthAnythingNetwork>, PartError> {
        self.depth_anything.get((weights.to_owned(), output), |(weights, output)| {
            let other = |source| PartError::Other { name: "depth_weights".to_owned(), source: Box::new(source) };
            Ok(Arc::new(DepthAnythingNetwork::open(weights, *output).map_err(other)?))
        })
    }

    /// Returns FastSAM with the weights of a checkpoint.
    ///
    /// # Errors
    /// If it cannot be loaded.
    pub(crate) fn fastsam(
        &self,
        weights: &Path,
        settings: &FastSamPredictorSettings,
        device: DeviceName,
    ) -> Result<FastSamPredictor, PartError> {
        self.fastsam.get((weights.to_owned(), settings.clone(), device), |(weights, settings, device)| {
            let predictor = FastSamPredictor::open(weights, settings.clone(), &device.open()?);
            Ok(predictor.map_err(SegmenterError::from)?)
        })
    }

    /// Returns SAM 2.1, EdgeTAM or EfficientTAM with the weights of a checkpoint, for the given image size.
    ///
    /// # Errors
    /// If it cannot be loaded.
    pub(crate) fn sam2(
        &self,
        weights: &Path,
        image_size: Option<usize>,
        pooling: MemoryPooling,
        device: DeviceName,
    ) -> Result<Sam2Network, PartError> {
        self.sam2.get((weights.to_owned(), image_size, pooling, device), |(weights, image_size, pooling, device)| {
            let checkpoint = Checkpoint::open(weights)?;
            Sam2Network::load(&checkpoint, *image_size, &device.open()?)
                .and_then(|network| network.with_memory_pooling(*pooling))
                .map_err(|source| PartError::Sam2 { path: weights.clone(), source: Box::new(source) })
        })
    }
}
