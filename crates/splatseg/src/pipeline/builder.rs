//! Builds a pipeline from settings.

use super::kept_names::KeptNames;
use super::map_history::{MapHistory, take_history};
use super::named_map::take_names;
use super::predicted_depth::DepthStage;
use super::working_resolution::WorkingResolution;
use super::{Pipeline, PipelineError, PredictedDepthUse};
use crate::parts::{LoadedNetworks, MethodName, MethodParts, PartContext, TrackerSettings};
use crate::settings::Settings;
use splatseg_dataset::Scene;
use splatseg_depth::DepthPredictor;
use splatseg_geometry::SegmentId;
use splatseg_kernels::Instructions;
use splatseg_memory::{MemorySettings, SplatMemory};
use splatseg_objects::{KeptViews, ObjectLog};
use splatseg_odometry::{PoseSource, StateScope, TrackedPoses};
use splatseg_segmenter::Segmenter;
use splatseg_simulators::GroundTruthPrompts;
use splatseg_tracking::{Method, PromptSource, Tracker, TrackingError};
use std::path::PathBuf;
use std::sync::Arc;

/// Factor of `memory.depth_tolerance` where depth is predicted. Of 1, 1.5, 2 and 3 the last was best on dev-a and dev-b, and
/// as good as 2 on kitchen-dev (`docs/PREDICTED_DEPTH.md`).
const TOLERANCE_OF_PREDICTED: f32 = 3.0;

/// Builds a [`Pipeline`] from settings. Parts set on the builder replace the ones that the settings describe.
pub struct PipelineBuilder<'a> {
    settings: &'a Settings,
    scene: Option<Arc<dyn Scene>>,
    segmenter: Option<Box<dyn Segmenter>>,
    poses: Option<Box<dyn PoseSource>>,
    method: Option<Box<dyn Method>>,
    tracker: Option<Box<dyn Tracker>>,
    depth_predictor: Option<(Box<dyn DepthPredictor>, PredictedDepthUse)>,
    memory: Option<SplatMemory>,
    saved_memory: Option<PathBuf>,
    saved_poses: Option<Vec<u8>>,
    /// Keyframes of the saved memory, once loaded.
    keyframes: Option<Vec<u8>>,
    networks: Arc<LoadedNetworks>,
    objects: ObjectLog,
    earlier_ids: Option<SegmentId>,
    names: KeptNames,
    history: MapHistory,
    progress: Box<dyn FnMut(f32) + 'a>,
}

impl Pipeline {
    /// Returns a builder for the pipeline that `settings` describe. Its parts can be replaced by your own.
    pub fn builder(settings: &Settings) -> PipelineBuilder<'_> {
        PipelineBuilder::new(settings)
    }
}

impl<'a> PipelineBuilder<'a> {
    fn new(settings: &'a Settings) -> Self {
        Self {
            settings,
            scene: None,
            segmenter: None,
            poses: None,
            method: None,
            tracker: None,
            depth_predictor: None,
            memory: None,
            saved_memory: None,
            saved_poses: None,
            keyframes: None,
            networks: Arc::default(),
            objects: ObjectLog::default(),
            earlier_ids: None,
            names: KeptNames::default(),
            history: MapHistory::default(),
            progress: Box::new(|_| {}),
        }
    }

    /// Sets the scene whose ground truth is read by the oracle segmenter, the simulated tracker and ground-truth prompts,
    /// and whose world may have a known up.
    #[must_use]
    pub fn scene(mut self, scene: &Arc<dyn Scene>) -> Self {
        self.scene = Some(Arc::clone(scene));
        self
    }

    /// Sets your own segmenter.
    #[must_use]
    pub fn segmenter(mut self, segmenter: Box<dyn Segmenter>) -> Self {
        self.segmenter = Some(segmenter);
        self
    }

    /// Sets your own source of poses, in place of the one that the setting `poses` chooses.
    #[must_use]
    pub fn poses(mut self, poses: Box<dyn PoseSource>) -> Self {
        self.poses = Some(poses);
        self
    }

    /// Sets your own method, in place of the one that the setting `method` chooses.
    #[must_use]
    pub fn method(mut self, method: Box<dyn Method>) -> Self {
        self.method = Some(method);
        self
    }

    /// Sets your own tracker, which must not have processed a frame yet.
    #[must_use]
    pub fn tracker(mut self, tracker: Box<dyn Tracker>) -> Self {
        self.tracker = Some(tracker);
        self
    }

    /// Sets your own depth predictor, and where its depth is used, in place of what the settings choose.
    #[must_use]
    pub fn depth_predictor(mut self, predictor: Box<dyn DepthPredictor>, used: PredictedDepthUse) -> Self {
        self.depth_predictor = Some((predictor, used));
        self
    }

    /// Sets a memory to continue with.
    #[must_use]
    pub fn memory(mut self, memory: SplatMemory) -> Self {
        self.memory = Some(memory);
        self
    }

    /// Sets the file of a saved memory to continue with.
    #[must_use]
    pub fn saved_memory(mut self, path: impl Into<PathBuf>) -> Self {
        self.saved_memory = Some(path.into());
        self
    }

    /// Sets the state of the source of poses to continue with, from [`Pipeline::saved_poses`] for a
    /// [run](StateScope::Run).
    #[must_use]
    pub fn saved_poses(mut self, state: Vec<u8>) -> Self {
        self.saved_poses = Some(state);
        self
    }

    /// Sets the networks to share with earlier and later pipelines.
    #[must_use]
    pub fn networks(mut self, networks: &Arc<LoadedNetworks>) -> Self {
        self.networks = Arc::clone(networks);
        self
    }

    /// Sets the object log of an earlier run to continue with.
    #[must_use]
    pub fn objects(mut self, objects: ObjectLog) -> Self {
        self.objects = objects;
        self
    }

    /// The largest id in use before the first frame of the run that this one resumes: [`Pipeline::earlier_ids`].
    #[must_use]
    pub fn earlier_ids(mut self, highest: SegmentId) -> Self {
        self.earlier_ids = Some(highest);
        self
    }

    /// Keeps up to four views of each object, for [`Pipeline::name_objects`]: at most 224 × 224 pixels each, and 64 MiB in
    /// all.
    #[must_use]
    pub fn keep_views(mut self) -> Self {
        self.names.views = Some(KeptViews::default());
        self
    }

    /// Sets a callback for the fraction done while a codebook is computed, which takes up to a few seconds. Only a
    /// feature memory has a codebook.
    #[must_use]
    pub fn progress(mut self, progress: impl FnMut(f32) + 'a) -> Self {
        self.progress = Box::new(progress);
        self
    }

    /// Poses as the settings choose them.
    fn tracked_poses(&self) -> TrackedPoses {
        let poses = TrackedPoses::new(self.settings.run.poses).with_pose_format(self.settings.dataset.pose_format());
        match self.scene.as_ref().and_then(|scene| scene.world_up()) {
            Some(up) => poses.with_world_up(up),
            None => poses,
        }
    }

    /// Builds the pipeline.
    ///
    /// # Errors
    /// If a setting is out of range, a file cannot be read, or the scene has no ground truth where it is needed.
    pub fn build(mut self) -> Result<Pipeline, PipelineError> {
        self.check()?;
        let segmenter = match self.segmenter.take() {
            Some(segmenter) => segmenter,
            None => self.make_segmenter()?,
        };
        let mut resolution = self.working_resolution();
        let method = match self.method.take() {
            Some(method) => {
                resolution = WorkingResolution::default();
                method
            }
            None => self.make_method()?,
        };
        if let Some(namer) = &self.settings.namer {
            let namer = namer.build(&self.context())?;
            self.names.set_namer(namer);
            self = self.keep_views();
        }
        let poses = self.settings.run.poses;
        let depth = match (self.depth_predictor.take(), &self.settings.depth_predictor) {
            (Some((predictor, used)), _) => Some(DepthStage::new(predictor, used, poses)),
            (None, Some(predictor)) => {
                Some(DepthStage::new(predictor.build(&self.context())?, self.settings.run.predicted_depth, poses))
            }
            (None, None) => None,
        };
        let mut poses = self.poses.take().unwrap_or_else(|| Box::new(self.tracked_poses()));
        if let Some(keyframes) = &self.keyframes {
            poses.restore(StateScope::Map, keyframes)?;
        }
        if let Some(state) = &self.saved_poses {
            poses.restore(StateScope::Run, state)?;
        }
        let mut pipeline = Pipeline::new(segmenter, method);
        pipeline.poses = poses;
        pipeline.segment_ahead = self.settings.run.segment_ahead;
        pipeline.rotate = self.settings.run.rotate;
        pipeline.resolution = resolution;
        pipeline.depth = depth;
        // Until a frame has been placed, nothing but the settings tells how the camera is held.
        if pipeline.segmenter.prefers_upright() {
            pipeline.turn = pipeline.rotate.turn().unwrap_or_else(|| pipeline.poses.turn());
        }
        pipeline.objects = self.objects;
        let highest = pipeline.memory().map_or(0, SplatMemory::highest_id);
        pipeline.earlier_ids = self.earlier_ids.unwrap_or(highest);
        pipeline.names = self.names;
        pipeline.history = self.history;
        Ok(pipeline)
    }

    /// Builds only the segmenter.
    ///
    /// # Errors
    /// As [`Self::build`].
    pub fn build_segmenter(self) -> Result<Box<dyn Segmenter>, PipelineError> {
        self.check()?;
        self.make_segmenter()
    }

    /// Builds only the tracker. Returns `None` if the method has none.
    ///
    /// # Errors
    /// As [`Self::build`].
    pub fn build_tracker(mut self) -> Result<Option<Box<dyn Tracker>>, PipelineError> {
        self.check()?;
        self.settings.method.tracker().map(|tracker| self.make_tracker(tracker)).transpose()
    }

    /// Checks that the depth predictor of the settings can be built, if one is chosen: so that a wrong checkpoint is told
    /// before frames are decoded. A network that is loaded here is kept in [`Self::networks`]. Only with [`Self::scene`] are
    /// the frames of that scene compared with those of `true_depth`.
    ///
    /// # Errors
    /// As [`Self::build`].
    pub fn check_depth_predictor(&self) -> Result<(), PipelineError> {
        self.check()?;
        if let (None, Some(predictor)) = (&self.depth_predictor, &self.settings.depth_predictor) {
            predictor.build(&self.context())?;
        }
        Ok(())
    }

    fn check(&self) -> Result<(), PipelineError> {
        Instructions::check_choice()?;
        Ok(self.settings.validate()?)
    }

    /// Methods of your own see whole frames, as do trackers and the baselines.
    fn working_resolution(&self) -> WorkingResolution {
        let is_reduced = self.settings.method.name() == MethodName::FastsamSplat;
        WorkingResolution { max_pixels: is_reduced.then_some(self.settings.run.working_pixels) }
    }

    /// Predicted depth is not as exact as measured depth, also after it was fitted to the map.
    fn memory_settings(&self, settings: &MemorySettings) -> MemorySettings {
        let mut settings = settings.clone();
        if self.predicts_all() {
            settings.depth_tolerance *= TOLERANCE_OF_PREDICTED;
        }
        settings
    }

    /// True if no measured depth is used.
    fn predicts_all(&self) -> bool {
        let chosen = self.settings.depth_predictor.as_ref().map(|_| self.settings.run.predicted_depth);
        self.depth_predictor.as_ref().map(|(_, used)| *used).or(chosen) == Some(PredictedDepthUse::All)
    }

    fn context(&self) -> PartContext<'_> {
        PartContext {
            device: self.settings.run.device,
            seed: self.settings.run.seed,
            framing: self.settings.dataset.framing(),
            dataset: &self.settings.dataset,
            prompts_lost_objects: self.settings.method.prompts_lost_objects(),
            networks: &self.networks,
            scene: self.scene.as_ref(),
        }
    }

    fn make_segmenter(&self) -> Result<Box<dyn Segmenter>, PipelineError> {
        let context = self.context();
        if let Some((PromptSource::GroundTruth, min_area)) = self.settings.method.prompts() {
            let truth = context.ground_truth("prompts = ground-truth")?;
            return Ok(Box::new(GroundTruthPrompts::new(truth, min_area)));
        }
        let mut segmenter = self.settings.segmenter.build(&context)?;
        segmenter.set_detail(self.settings.run.detail);
        Ok(segmenter)
    }

    fn make_method(&mut self) -> Result<Box<dyn Method>, PipelineError> {
        let settings = self.settings;
        let has_memory = self.settings.method.memory().is_some();
        if let (false, Some(path)) = (has_memory, self.saved_memory.take_if(|_| !has_memory)) {
            return Err(PipelineError::NoMemory { path, method: self.settings.method.name().name() });
        }
        settings.method.build(settings.run.seed, self)
    }
}

impl MethodParts for PipelineBuilder<'_> {
    type Error = PipelineError;

    fn make_memory(&mut self, settings: &MemorySettings) -> Result<SplatMemory, PipelineError> {
        let settings = &self.memory_settings(settings);
        if let Some(memory) = self.memory.take() {
            return Ok(memory);
        }
        Ok(match &self.saved_memory {
            Some(path) => {
                let mut memory = SplatMemory::load(path, settings.clone())?;
                self.keyframes = memory.take_keyframes();
                self.names.names = take_names(&mut memory, path)?;
                self.history = take_history(&mut memory, path)?;
                if self.saved_poses.is_none() {
                    memory.start_session();
                }
                memory
            }
            None => SplatMemory::new(settings.clone(), self.settings.run.seed, &mut self.progress)
                .map_err(TrackingError::from)?,
        })
    }

    fn make_tracker(&mut self, settings: &TrackerSettings) -> Result<Box<dyn Tracker>, PipelineError> {
        if let Some(tracker) = self.tracker.take() {
            return Ok(tracker);
        }
        Ok(settings.build(&self.context())?)
    }
}
