//! From settings to a pipeline.

use super::{LoadedNetworks, Pipeline, PipelineError, StageClock};
use crate::settings::{MemoryDevice, MethodSettings, SegmenterSettings, Settings, TrackerSettings};
use splatseg_dataset::Scene;
use splatseg_memory::{MemorySettings, SplatMemory};
use splatseg_models::device::{DeviceError, DeviceName};
use splatseg_objects::ObjectLog;
#[cfg(feature = "gpu")]
use splatseg_render_gpu::GpuDevice;
use splatseg_segmenter::{AffinitySegmenter, FastSamSegmenter, GraphSegmenter, MaskFolder, Segmenter};
use splatseg_simulators::{GroundTruthPrompts, OracleSegmenter, SceneGroundTruth, SimTracker};
use splatseg_tracking::{
    FastSamBaseline, FastSamSplat, FastSpamBaseline, Method, PromptSource, Sam2Baseline, Sam2Splat, Sam2Tracker,
    Tracker, TrackingError,
};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Builds a [`Pipeline`] from settings. Parts that are given here replace those that the settings describe.
pub struct PipelineBuilder<'a> {
    settings: &'a Settings,
    scene: Option<Arc<dyn Scene>>,
    segmenter: Option<Box<dyn Segmenter>>,
    tracker: Option<Box<dyn Tracker>>,
    memory: Option<SplatMemory>,
    saved_memory: Option<PathBuf>,
    networks: Arc<LoadedNetworks>,
    objects: ObjectLog,
    progress: Box<dyn FnMut(f32) + 'a>,
}

impl<'a> PipelineBuilder<'a> {
    pub(super) fn new(settings: &'a Settings) -> Self {
        Self {
            settings,
            scene: None,
            segmenter: None,
            tracker: None,
            memory: None,
            saved_memory: None,
            networks: Arc::default(),
            objects: ObjectLog::default(),
            progress: Box::new(|_| {}),
        }
    }

    /// The scene whose ground truth the oracle segmenter, the simulated tracker and ground-truth prompts read.
    #[must_use]
    pub fn scene(mut self, scene: &Arc<dyn Scene>) -> Self {
        self.scene = Some(Arc::clone(scene));
        self
    }

    /// Your own segmenter.
    #[must_use]
    pub fn segmenter(mut self, segmenter: Box<dyn Segmenter>) -> Self {
        self.segmenter = Some(segmenter);
        self
    }

    /// Your own tracker, before its first frame.
    #[must_use]
    pub fn tracker(mut self, tracker: Box<dyn Tracker>) -> Self {
        self.tracker = Some(tracker);
        self
    }

    /// A memory to continue with.
    #[must_use]
    pub fn memory(mut self, memory: SplatMemory) -> Self {
        self.memory = Some(memory);
        self
    }

    /// The file of a memory that an earlier run saved, to continue with.
    #[must_use]
    pub fn saved_memory(mut self, path: impl Into<PathBuf>) -> Self {
        self.saved_memory = Some(path.into());
        self
    }

    /// Networks that earlier pipelines have loaded, and that later ones may use.
    #[must_use]
    pub fn networks(mut self, networks: &Arc<LoadedNetworks>) -> Self {
        self.networks = Arc::clone(networks);
        self
    }

    /// The objects that an earlier run saw, which this one goes on with.
    #[must_use]
    pub fn objects(mut self, objects: ObjectLog) -> Self {
        self.objects = objects;
        self
    }

    /// Receives the fraction done while a codebook is made, which takes up to a few seconds. Only a memory of features
    /// has one.
    #[must_use]
    pub fn progress(mut self, progress: impl FnMut(f32) + 'a) -> Self {
        self.progress = Box::new(progress);
        self
    }

    /// The pipeline.
    ///
    /// # Errors
    /// If a setting is out of range, a file cannot be read, or the scene has no ground truth where it is needed.
    pub fn build(mut self) -> Result<Pipeline, PipelineError> {
        self.settings.validate()?;
        let segmenter = match self.segmenter.take() {
            Some(segmenter) => segmenter,
            None => self.make_segmenter()?,
        };
        let method = self.make_method()?;
        let segment_ahead = self.settings.run.segment_ahead;
        Ok(Pipeline { segmenter, method, segment_ahead, clock: StageClock::new(), objects: self.objects })
    }

    /// The segmenter alone.
    ///
    /// # Errors
    /// As [`Self::build`].
    pub fn build_segmenter(self) -> Result<Box<dyn Segmenter>, PipelineError> {
        self.settings.validate()?;
        self.make_segmenter()
    }

    /// The tracker alone, before its first frame; `None` if the method has none.
    ///
    /// # Errors
    /// As [`Self::build`].
    pub fn build_tracker(mut self) -> Result<Option<Box<dyn Tracker>>, PipelineError> {
        self.settings.validate()?;
        self.settings.method.tracker().map(|tracker| self.make_tracker(tracker)).transpose()
    }

    fn make_segmenter(&self) -> Result<Box<dyn Segmenter>, PipelineError> {
        if let Some((PromptSource::GroundTruth, min_area)) = self.settings.method.prompts() {
            return Ok(Box::new(GroundTruthPrompts::new(self.ground_truth("prompts = ground-truth")?, min_area)));
        }
        Ok(match &self.settings.segmenter {
            SegmenterSettings::Graph { graph } => Box::new(GraphSegmenter::new(graph.clone())?),
            SegmenterSettings::Affinity { weights, affinity } => {
                let network = self.networks.affinity(weights.as_deref(), self.settings.run.device)?;
                Box::new(AffinitySegmenter::new(network, affinity.clone())?)
            }
            SegmenterSettings::Fastsam { weights, fastsam } => {
                let weights = weights.as_deref().unwrap_or(Path::new(""));
                let predictor = self.networks.fastsam(weights, fastsam, self.settings.run.device)?;
                Box::new(FastSamSegmenter::new(predictor))
            }
            SegmenterSettings::Masks { masks } => {
                let masks = masks.as_deref().unwrap_or(Path::new(""));
                Box::new(MaskFolder::open(masks, self.settings.dataset.framing())?)
            }
            SegmenterSettings::Oracle { oracle } => {
                let truth = self.ground_truth("segmenter = oracle")?;
                Box::new(OracleSegmenter::new(truth, oracle, self.settings.run.seed)?)
            }
        })
    }

    fn make_method(&mut self) -> Result<Box<dyn Method>, PipelineError> {
        let seed = self.settings.run.seed;
        let has_memory = self.settings.method.memory().is_some();
        if let (false, Some(path)) = (has_memory, self.saved_memory.take_if(|_| !has_memory)) {
            return Err(PipelineError::NoMemory { path, method: self.settings.method.name().name() });
        }
        Ok(match &self.settings.method {
            MethodSettings::FastsamSplat(settings) => {
                let memory = self.make_memory(&settings.memory)?;
                Box::new(FastSamSplat::with_memory(settings.clone(), memory)?)
            }
            MethodSettings::Fastsam(settings) => Box::new(FastSamBaseline::new(settings.clone())?),
            MethodSettings::Fastspam(settings) => Box::new(FastSpamBaseline::new(settings.clone(), seed)?),
            MethodSettings::Sam2 { settings, tracker } => {
                Box::new(Sam2Baseline::new(self.make_tracker(tracker)?, settings.clone())?)
            }
            MethodSettings::Sam2Splat { settings, tracker } => {
                let tracker = self.make_tracker(tracker)?;
                let memory = self.make_memory(&settings.memory)?;
                Box::new(Sam2Splat::with_memory(tracker, (**settings).clone(), memory)?)
            }
        })
    }

    fn make_memory(&mut self, settings: &MemorySettings) -> Result<SplatMemory, PipelineError> {
        if let Some(memory) = self.memory.take() {
            return Ok(memory);
        }
        let memory = match &self.saved_memory {
            Some(path) => SplatMemory::load(path, settings.clone())?,
            None => SplatMemory::new(settings.clone(), self.settings.run.seed, &mut self.progress)
                .map_err(TrackingError::from)?,
        };
        match self.settings.run.memory_device {
            MemoryDevice::Cpu => Ok(memory),
            MemoryDevice::Gpu => on_gpu(memory),
        }
    }

    fn make_tracker(&mut self, settings: &TrackerSettings) -> Result<Box<dyn Tracker>, PipelineError> {
        if let Some(tracker) = self.tracker.take() {
            return Ok(tracker);
        }
        match settings {
            TrackerSettings::Sam2 { tracker_weights, sam2 } => {
                let path = tracker_weights.as_deref().unwrap_or(Path::new(""));
                let network = self.networks.sam2(path, sam2.image_size, self.settings.run.device)?;
                let sam2 = sam2.resolved(self.settings.method.prompts_lost_objects());
                Ok(Box::new(Sam2Tracker::new(network, sam2)?))
            }
            TrackerSettings::Sim { sim_tracker } => {
                let truth = self.ground_truth("tracker = sim")?;
                Ok(Box::new(SimTracker::new(truth, *sim_tracker, self.settings.run.seed)?))
            }
        }
    }

    fn ground_truth(&self, needed_by: &'static str) -> Result<SceneGroundTruth, PipelineError> {
        let scene = self.scene.as_ref().ok_or(PipelineError::NoScene(needed_by))?;
        Ok(SceneGroundTruth::new(Arc::clone(scene), self.settings.dataset.framing())?)
    }
}

/// Moves a memory to the GPU.
#[cfg(feature = "gpu")]
fn on_gpu(memory: SplatMemory) -> Result<SplatMemory, PipelineError> {
    let unusable = |message: String| DeviceError::Unusable { name: DeviceName::Gpu.name(), message };
    let device = GpuDevice::open().map_err(|error| unusable(error.to_string()))?;
    Ok(memory.on_device(&device).map_err(TrackingError::from)?)
}

/// Settings are checked before: the program has no GPU.
#[cfg(not(feature = "gpu"))]
fn on_gpu(_: SplatMemory) -> Result<SplatMemory, PipelineError> {
    Err(DeviceError::NotBuilt(DeviceName::Gpu.name()).into())
}
