//! The memory itself: what it holds and the three things that are asked of it.

use crate::backend::{MapBackend, MapContent, MapDevice, MapUpdate, RememberedSegments};
use crate::depthless::DepthlessSegments;
use crate::evidence::EvidenceStore;
use crate::features::{FeatureStore, SegmentCodes};
use crate::host_map::HostMap;
use crate::map::SplatMap;
use crate::recent::RecentFrames;
use crate::recurring::RecurringPredictions;
use crate::segment_store::SegmentStore;
use crate::segments::{Segments, Settled};
use crate::short_term::Appearances;
use crate::{Codebook, CodebookError, GrowthRule, LearningExtent, MemoryKind, MemorySettings, Recall};
use crate::{MAX_SEGMENT_ID, SplatContentView};
use glam::DVec3;
use splatseg_geometry::{RgbdFrame, SegmentId, SegmentMap};
use splatseg_render::{Balls, Camera, RasterLimits};
use splatseg_settings::SettingError;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use thiserror::Error;

/// Stands for an id where a prediction is seen that has no say: it neither votes nor is it "no segment".
pub const ABSTAIN: SegmentId = SegmentId::MAX;

/// Frames between two looks at which ids are still carried, unless Gaussians were removed: features take long to decode.
const FRAMES_PER_CENSUS: u32 = 16;

/// An online 3D Gaussian splat whose Gaussians remember segments.
///
/// For every frame: [`SplatMemory::recall`] says which segments should be seen, [`SplatMemory::fuse`] brings that
/// together with what is seen, and [`SplatMemory::update`] takes in what was seen. What Gaussians remember of segments is
/// one of two [`MemoryKind`]s; the map is the same for both.
#[derive(Debug)]
pub struct SplatMemory {
    pub(crate) settings: MemorySettings,
    /// Origin of the map's coordinates: world coordinates, metres.
    pub(crate) origin: DVec3,
    /// The map, and what its Gaussians remember.
    pub(crate) backend: Box<dyn MapBackend>,
    pub(crate) segments: Segments,
    /// What no Gaussian can carry.
    pub(crate) depthless: DepthlessSegments,
    /// Predictions that were explained by what is remembered.
    pub(crate) recurring: RecurringPredictions,
    pub(crate) overruled: BTreeMap<SegmentId, f32>,
    pub(crate) appearances: BTreeMap<SegmentId, Appearances>,
    /// The last frames, which decide what happens when one contradicts the map.
    pub(crate) recent: RecentFrames,
    /// Frames taken in.
    pub(crate) frames: u32,
    warned_of_limit: bool,
}

/// What a device reports when it fails.
pub type DeviceFailure = Arc<dyn std::error::Error + Send + Sync>;

/// What keeps a memory from being made or used.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum MemoryError {
    /// A setting is out of range.
    #[error(transparent)]
    Setting(#[from] SettingError),
    /// The codebook cannot be made.
    #[error(transparent)]
    Codebook(#[from] CodebookError),
    /// A store that is defined elsewhere failed.
    #[error("{name}: {source}")]
    Other {
        /// Name of the store.
        name: String,
        /// What it reports.
        source: Box<dyn std::error::Error + Send + Sync>,
    },
    /// The device that holds the map failed, or has no room for it.
    #[error("the map's device: {0}")]
    Device(DeviceFailure),
    /// A store that is defined elsewhere cannot be kept on a device.
    #[error("a memory with a store of its own runs on the CPU only")]
    HostOnly,
    /// The predictions are not of the frame's size; both are `(width, height)`.
    #[error("the predictions have {}x{} pixels, expected the frame's {}x{}", found.0, found.1, expected.0, expected.1)]
    PredictionSize {
        /// Size of the predictions.
        found: (usize, usize),
        /// Size of the frame.
        expected: (usize, usize),
    },
    /// A prediction has an id that [`SplatMemory::new_segment`] never gave.
    #[error("a prediction has the id {found}, but only 1 to {known} exist")]
    UnknownSegment {
        /// The id.
        found: SegmentId,
        /// The largest id given so far.
        known: SegmentId,
    },
}

/// What taking in a frame did.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct FrameUpdate {
    /// Gaussians added.
    pub grown: usize,
    /// Gaussians removed.
    pub removed: usize,
    /// Ids that nothing in the memory shows any more.
    pub forgotten: Vec<SegmentId>,
    /// Ids of predictions that nothing was seen under since they were given. One that an earlier thing had stands for
    /// another thing from this frame on.
    pub new_segments: Vec<SegmentId>,
    /// Extent of the learning.
    pub learning: LearningExtent,
}

impl MemoryError {
    /// The error as a device reports it.
    fn into_failure(self) -> DeviceFailure {
        match self {
            Self::Device(failure) => failure,
            other => Arc::new(other),
        }
    }
}

/// What a device returned; a failure is logged. For those who cannot report it: the next frame will.
pub(crate) fn or_none<T>(found: Result<T, MemoryError>) -> Option<T> {
    found.inspect_err(|error| tracing::error!("{error}")).ok()
}

impl SplatMemory {
    /// An empty memory. A codebook, which only [`MemoryKind::Features`] needs, takes up to a few seconds; `progress` is
    /// told the fraction done.
    ///
    /// # Errors
    /// If a setting is out of range.
    pub fn new(settings: MemorySettings, seed: u64, progress: &mut dyn FnMut(f32)) -> Result<Self, MemoryError> {
        settings.validate()?;
        let store: Box<dyn SegmentStore> = match settings.kind {
            MemoryKind::Evidence => Box::new(EvidenceStore::new(settings.clone())),
            MemoryKind::Features => Box::new(FeatureStore::new(settings.clone(), seed, progress)?),
        };
        let segments = Segments::new(largest_id(&settings));
        Ok(Self::with_parts(settings, SplatMap::default(), store, segments))
    }

    /// An empty memory that remembers segments in a way of its own; `memory.kind` means nothing then. It can be saved only
    /// if the store has a [`SegmentStore::content`].
    ///
    /// # Errors
    /// If a setting is out of range.
    pub fn with_store(settings: MemorySettings, store: Box<dyn SegmentStore>) -> Result<Self, MemoryError> {
        settings.validate()?;
        let segments = Segments::new(MAX_SEGMENT_ID);
        Ok(Self::with_parts(settings, SplatMap::default(), store, segments))
    }

    pub(crate) fn with_parts(
        settings: MemorySettings,
        map: SplatMap,
        store: Box<dyn SegmentStore>,
        segments: Segments,
    ) -> Self {
        let backend = Box::new(HostMap { settings: settings.clone(), map, store });
        Self {
            settings,
            origin: DVec3::ZERO,
            backend,
            segments,
            depthless: DepthlessSegments::default(),
            recurring: RecurringPredictions::default(),
            overruled: BTreeMap::new(),
            appearances: BTreeMap::new(),
            recent: RecentFrames::default(),
            frames: 0,
            warned_of_limit: false,
        }
    }

    /// Moves the map and what its Gaussians remember to a device, which does from then on what is done with them.
    ///
    /// # Errors
    /// [`MemoryError::HostOnly`] for a memory with a store of its own, or what the device reports.
    pub fn on_device(mut self, device: &dyn MapDevice) -> Result<Self, MemoryError> {
        let MapContent { map, content } = self.backend.content()?;
        let remembered = match content.ok_or(MemoryError::HostOnly)? {
            SplatContentView::Evidence { votes } => RememberedSegments::Votes(votes.to_vec()),
            SplatContentView::Features { features, codebook } => RememberedSegments::Features {
                features: features.to_vec(),
                codes: SegmentCodes::of_user(&self.settings, codebook.clone(), self.segments.highest() as usize),
            },
        };
        self.backend = device.take_over(&self.settings, map.clone(), remembered)?;
        Ok(self)
    }

    /// What the memory expects `frame` to show. If a device fails at that, [`Self::fuse`] and [`Self::update`] report it.
    pub fn recall<'f>(&self, frame: &'f RgbdFrame<'_>) -> Recall<'f> {
        let _stage = tracing::debug_span!(target: "splatseg::stage", "decode").entered();
        let jump = if self.follows_jumps() { self.recent.jump(frame, self.origin, &self.settings) } else { None };
        let reported = frame.world_from_camera();
        let before_jump = jump.map_or(*reported, |jump| jump.inverse() * *reported);
        let (pose, map_from_camera) = (before_jump.relative_to(self.origin), reported.relative_to(self.origin));
        let trust = self.recent.trust(frame, &pose, &self.settings);
        let mut camera = Camera::new(*frame.intrinsics(), &pose);
        if self.settings.kind == MemoryKind::Evidence {
            let (min_alpha, min_transmittance) = (self.settings.min_alpha, self.settings.min_transmittance);
            // The Gaussian that finishes a pixel is not blended: one alone must not finish it.
            let max_alpha = camera.limits.max_alpha.min(1.0 - 2.0 * min_transmittance);
            camera.limits = RasterLimits { min_alpha, max_alpha, min_transmittance, ..camera.limits };
        }
        let mut recall = match self.backend.recall(frame, &camera, trust) {
            Ok(recall) => recall,
            Err(error) => return Recall::failed(frame, &camera, error.into_failure()),
        };
        (recall.map_from_camera, recall.viewed_from, recall.jump) = (map_from_camera, pose, jump);
        if self.settings.links_depthless() {
            self.depthless.expect(&mut recall, self.settings.growth_silhouette);
        }
        if self.settings.kind == MemoryKind::Evidence {
            self.recent.expect(&mut recall, &self.settings);
        }
        recall
    }

    /// An id for a new thing, which a prediction of the frame at hand is to have.
    ///
    /// Ids count up from 1. Once all are given that fit a 16-bit image, ids are given again that were seen in one frame
    /// only and of which the memory has nothing any more. Further ids come only if there are none of these; they end at
    /// [`MAX_SEGMENT_ID`], then come all that the memory has nothing of.
    ///
    /// # Errors
    /// If the device fails, or a store that is defined elsewhere refuses the id.
    pub fn new_segment(&mut self) -> Result<SegmentId, MemoryError> {
        let id = self.segments.add();
        self.backend.new_segment(id)?;
        Ok(id)
    }

    /// Takes an id back that [`Self::new_segment`] gave and no prediction has after all; it is given again.
    pub fn take_back(&mut self, id: SegmentId) {
        self.segments.take_back(id);
    }

    /// The frame's segments, `[height, width]`: what the memory expects and the frame's predictions `seen` together.
    ///
    /// `seen` has the id of the prediction that is visible at each pixel, 0 where there is none and [`ABSTAIN`] where the
    /// prediction has no say.
    ///
    /// # Errors
    /// If `seen` has another size than the frame or an id that does not exist.
    pub fn fuse(&self, recall: &Recall<'_>, seen: &SegmentMap) -> Result<SegmentMap, MemoryError> {
        self.check_predictions(recall, seen)?;
        self.backend.fuse(recall, seen)
    }

    /// Takes note of the frame's predictions that remembered segments explain, which have no say: `explained` has their
    /// ids, 0 elsewhere. To be called for every frame between [`Self::recall`] and [`Self::update`].
    ///
    /// `is_new(id, times)` tells whether the prediction with an id is new after all, given how many times it has come: the
    /// frames that had it in the same place, less those that showed its place without it. Returns the ids of those that
    /// are. They are objects of their own: from this frame on they have a say, and their Gaussians have more votes for them
    /// than for what explained them.
    ///
    /// # Errors
    /// As [`Self::fuse`].
    pub fn note_explained(
        &mut self,
        recall: &Recall<'_>,
        explained: &SegmentMap,
        is_new: &dyn Fn(SegmentId, usize) -> bool,
    ) -> Result<Vec<SegmentId>, MemoryError> {
        self.check_predictions(recall, explained)?;
        if self.recurring.is_empty() && explained.pixels().iter().all(|id| *id == 0 || *id == ABSTAIN) {
            return Ok(Vec::new());
        }
        let visible = self.backend.visible_gaussians(recall)?;
        let recurring = self.recurring.note(&visible, explained, is_new);
        for (id, gaussians) in &recurring {
            self.segments.keep(*id);
            self.backend.favour(gaussians, *id)?;
        }
        Ok(recurring.into_keys().collect())
    }

    /// Takes in what the frame shows: learns from its predictions `seen`, grows by the surfaces that the map lacks, and
    /// forgets those that are gone.
    ///
    /// # Errors
    /// As [`Self::fuse`].
    pub fn update(&mut self, mut recall: Recall<'_>, seen: &SegmentMap) -> Result<FrameUpdate, MemoryError> {
        self.check_predictions(&recall, seen)?;
        let new_segments = self.segments.note_sightings(seen);
        if self.is_astray(&recall) {
            return Ok(self.without_a_map(&recall, seen, new_segments));
        }
        self.follow(&mut recall)?;
        let before = self.gaussian_count();
        let update = self.backend.update(&mut recall, seen, self.frames, &mut self.segments.live())?;
        if self.settings.links_depthless() {
            let _stage = tracing::debug_span!(target: "splatseg::stage", "learn").entered();
            self.depthless.take_in(&recall, seen, self.settings.growth_silhouette, self.frames);
        }

        self.recent.record(&recall, seen, &self.settings);
        let _stage = tracing::debug_span!(target: "splatseg::stage", "grow").entered();
        let removed = before + update.grown - self.gaussian_count();
        let (grown, learning) = (update.grown, update.learning);
        let Settled { forgotten, lost } = self.note_removed(removed, update);
        for id in forgotten.iter().chain(&lost) {
            self.appearances.remove(id);
        }
        for id in &lost {
            self.overruled.remove(id);
        }
        self.frames = self.frames.saturating_add(1);
        Ok(FrameUpdate { grown, removed, forgotten, new_segments, learning })
    }

    /// Takes a frame in that changes nothing in the map.
    fn without_a_map(&mut self, recall: &Recall<'_>, seen: &SegmentMap, new_segments: Vec<SegmentId>) -> FrameUpdate {
        self.recent.record(recall, seen, &self.settings);
        self.frames = self.frames.saturating_add(1);
        FrameUpdate { new_segments, ..FrameUpdate::default() }
    }

    /// Takes note of which Gaussians were `removed`; returns the ids that the memory has lost.
    fn note_removed(&mut self, removed: usize, update: MapUpdate) -> Settled {
        if update.was_full && !self.warned_of_limit {
            let max = self.settings.max_gaussians;
            tracing::warn!("the map has reached memory.max_gaussians = {max}: what was not seen for longest goes");
            self.warned_of_limit = true;
        }
        if let Some(keep) = &update.keep {
            self.recurring.retain(keep);
        }
        if let Some(holds) = &update.holds {
            self.segments.note_holds(holds);
        }
        let is_cheap = self.settings.kind == MemoryKind::Evidence;
        let is_due = is_cheap || self.frames.is_multiple_of(FRAMES_PER_CENSUS);
        // Ids that are to be given again must be found, whatever the rule.
        let is_needed = self.settings.growth_rule() != GrowthRule::Paper || self.segments.are_short_ids_given();
        if removed == 0 && !(is_due && is_needed) {
            return Settled::default();
        }
        if update.holds.is_none() {
            let shown: BTreeSet<SegmentId> = distinct(&self.segment_ids());
            self.segments.note_shown(&shown);
        }
        self.segments.note_regions(self.depthless.ids().chain(self.recent.held_ids()).collect());
        self.segments.settle()
    }

    /// Whether the map moves along when the poses jump. The paper's does not.
    fn follows_jumps(&self) -> bool {
        self.settings.growth_rule() != GrowthRule::Paper && self.gaussian_count() > 0
    }

    fn check_predictions(&self, recall: &Recall<'_>, seen: &SegmentMap) -> Result<(), MemoryError> {
        let frame = recall.frame;
        if let Some(failure) = &recall.failure {
            return Err(MemoryError::Device(failure.clone()));
        }
        let (found, expected) = (seen.size(), (frame.width(), frame.height()));
        if found != expected {
            return Err(MemoryError::PredictionSize { found, expected });
        }
        let largest = seen.pixels().iter().map(|id| if *id == ABSTAIN { 0 } else { *id }).max().unwrap_or(0);
        let known = self.segments.highest();
        if largest > known {
            return Err(MemoryError::UnknownSegment { found: largest, known });
        }
        Ok(())
    }

    /// The settings it was made with.
    pub fn settings(&self) -> &MemorySettings {
        &self.settings
    }

    /// Number of Gaussians.
    pub fn gaussian_count(&self) -> usize {
        self.backend.gaussian_count()
    }

    /// Number of different ids given so far: ids are 1 to this.
    pub fn segment_count(&self) -> usize {
        self.segments.highest() as usize
    }

    /// Whether an id is tentative: its thing was seen in one frame only. It is given for good once it was seen in two.
    pub fn is_tentative(&self, id: SegmentId) -> bool {
        self.segments.is_tentative(id)
    }

    /// Whether something carried an id after the last frame, as in [`Self::carried_ids`].
    pub fn is_carried(&self, id: SegmentId) -> bool {
        self.segments.is_carried(id)
    }

    /// The ids that something in the memory carries: Gaussians, or a remembered region without depth. All others that
    /// were given are forgotten.
    pub fn carried_ids(&self) -> BTreeSet<SegmentId> {
        let mut carried = distinct(&self.segment_ids());
        carried.extend(self.depthless.ids().chain(self.recent.held_ids()));
        carried
    }

    /// Numbers that the Gaussians hold: position 3, radius 1, colour 3, and for segments 8 (votes) or D (features).
    pub fn parameter_count(&self) -> usize {
        self.gaussian_count() * (SplatMap::NUMBERS + self.backend.numbers_per_gaussian())
    }

    /// Where the Gaussians are, metres, relative to [`Self::origin`].
    pub fn balls(&self) -> &Balls {
        self.backend.balls()
    }

    /// Colours of the Gaussians, sRGB.
    pub fn colors(&self) -> &[[u8; 3]] {
        self.backend.colors()
    }

    /// The segment that each Gaussian shows by itself, 0 for none (and for all if a device fails, which is logged).
    pub fn segment_ids(&self) -> Vec<SegmentId> {
        or_none(self.backend.segment_ids()).unwrap_or_else(|| vec![0; self.gaussian_count()])
    }

    /// The share, 0 to 1, that the segment of [`segment_ids`](Self::segment_ids) has of all that each Gaussian was seen
    /// as; 1 in a memory that keeps no second opinion.
    pub fn segment_shares(&self) -> Vec<f32> {
        or_none(self.backend.segment_shares()).flatten().unwrap_or_else(|| vec![1.0; self.gaussian_count()])
    }
}

/// The largest id of a memory with these settings: features need a code for each id.
pub(crate) fn largest_id(settings: &MemorySettings) -> SegmentId {
    match settings.kind {
        MemoryKind::Evidence => MAX_SEGMENT_ID,
        MemoryKind::Features => {
            let codes = Codebook::max_len(settings.feature_dim) / settings.num_codes.max(1) * settings.num_codes;
            codes.min(MAX_SEGMENT_ID as usize) as SegmentId
        }
    }
}

/// The ids in a list, 0 left out.
fn distinct(ids: &[SegmentId]) -> BTreeSet<SegmentId> {
    // Neighbours mostly have the same one.
    ids.chunk_by(|one, other| one == other).map(|run| run[0]).filter(|id| *id != 0).collect()
}
