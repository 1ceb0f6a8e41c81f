//! The memory itself: its state, and the steps of each frame.

use crate::co_visible::CoVisibleIds;
use crate::correction::{AFTER_LOOP, motions, move_anchored, recognised};
use crate::growth::new_gaussians;
use crate::map::SplatMap;
use crate::origin::{MIN_FAR_FRAMES, change_of_origin, is_far, origin_for};
use crate::patches::{PatchGraph, Scope};
use crate::recall::{FramePlace, Recall, UseOfWeights, expected_depth};
use crate::recent::RecentFrames;
use crate::removal::{FrameTrust, Visibility, longest_unseen, record_visibility, visibilities};
use crate::segment_store::SegmentStore;
use crate::segments::{LostIds, Segments};
use crate::tile_surface::TileSurface;
use crate::{
    Attached, JoinedIds, LearningStats, LoadMemoryError, MemoryError, MemoryRules, MemorySettings, NewStore,
    Replacements, SegmentBelief, SplatFileError, joining, persistence, replaced,
};
use glam::DVec3;
use rayon::prelude::*;
use splatseg_geometry::{
    Affinities, FrameAnchor, Image, Intrinsics, KeyframeId, MapCorrection, MapSegments, MapView, Pose, RemappedId,
    RgbdFrame, STAGE_TARGET, SegmentId, SegmentMap, Segmentation,
};
use splatseg_render::{Camera, TileWeights};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Frames between two counts of the ids that Gaussians show, where they are not counted after every frame.
const FRAMES_PER_CENSUS: u32 = 16;

/// An online 3D Gaussian splat whose Gaussians remember segments.
///
/// For every frame: [`SplatMemory::recall`] renders the segments that the memory expects, [`SplatMemory::fuse`]
/// combines them with the frame's predictions, and [`SplatMemory::update`] learns from the predictions.
/// [`MemoryKind`](crate::MemoryKind) selects how Gaussians remember segments; the map is the same for both kinds.
#[derive(Debug)]
pub struct SplatMemory {
    pub(crate) settings: MemorySettings,
    /// Origin of the map's coordinates: world coordinates, metres.
    pub(crate) origin: DVec3,
    /// The Gaussians.
    pub(crate) map: SplatMap,
    /// Segments that the Gaussians remember.
    pub(crate) store: Box<dyn SegmentStore>,
    /// The rules of the store, with the growth rule of the settings.
    pub(crate) rules: MemoryRules,
    pub(crate) segments: Segments,
    /// Evidence about which Gaussians are one object.
    pub(crate) patches: PatchGraph,
    /// The last frames. They decide between a frame and the map when the two contradict each other.
    pub(crate) recent: RecentFrames,
    /// Frames learnt.
    pub(crate) frames: u32,
    /// Where the present frame's surfaces are attached.
    pub(crate) anchor: FrameAnchor,
    pub(crate) co_visible: CoVisibleIds,
    /// Ids that turned out to be older ones' objects, with those.
    pub(crate) remapped: BTreeMap<SegmentId, SegmentId>,
    /// The keyframes that a loaded file contains.
    pub(crate) keyframes: Option<Vec<u8>>,
    /// The names of objects that a loaded file contains.
    pub(crate) names: Option<Vec<u8>>,
    /// When objects were seen, and the rooms so far, that a loaded file contains.
    pub(crate) history: Option<Vec<u8>>,
    warned_of_limit: bool,
}

/// Changes made by learning a frame.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct FrameUpdate {
    /// Gaussians added.
    pub grown: usize,
    /// Gaussians removed.
    pub removed: usize,
    /// Ids that are not carried any more; see [`MapView::carried_ids`].
    pub forgotten: Vec<SegmentId>,
    /// Ids predicted for the first time. An id that belonged to another object before stands for the new object from
    /// this frame on.
    pub new_segments: Vec<SegmentId>,
    /// Ids of the frames before this one, whose poses were unknown, that turned out to be ids of the map: see
    /// [`SplatMemory::remap_recognised`].
    pub remapped: Vec<RemappedId>,
    /// Extent of the learning.
    pub learning: LearningStats,
}

impl SplatMemory {
    /// Creates an empty memory. Generating the codebook of [`MemoryKind::Features`](crate::MemoryKind::Features) takes
    /// up to a few seconds; `progress` receives the fraction done.
    ///
    /// # Errors
    /// If a setting is out of range.
    pub fn new(settings: MemorySettings, seed: u64, progress: &mut dyn FnMut(f32)) -> Result<Self, MemoryError> {
        settings.validate()?;
        let store = (settings.kind.definition().create)(&settings, NewStore { seed, progress })?;
        let segments = Segments::new(store.rules().largest_id);
        Ok(Self::with_parts(settings, SplatMap::default(), store, segments))
    }

    /// Creates an empty memory whose Gaussians remember segments in your own `store`; `memory.kind` is ignored. The
    /// memory behaves as [`SegmentStore::rules`] says, and can be saved only if the store has a [`SegmentStore::content`].
    ///
    /// # Errors
    /// If a setting is out of range.
    pub fn with_store(settings: MemorySettings, store: Box<dyn SegmentStore>) -> Result<Self, MemoryError> {
        settings.validate()?;
        let segments = Segments::new(store.rules().largest_id);
        Ok(Self::with_parts(settings, SplatMap::default(), store, segments))
    }

    pub(crate) fn with_parts(
        settings: MemorySettings,
        map: SplatMap,
        store: Box<dyn SegmentStore>,
        segments: Segments,
    ) -> Self {
        Self {
            rules: store.rules().with_settings(&settings),
            settings,
            origin: DVec3::ZERO,
            map,
            store,
            segments,
            patches: PatchGraph::default(),
            recent: RecentFrames::default(),
            frames: 0,
            anchor: FrameAnchor::default(),
            co_visible: CoVisibleIds::default(),
            remapped: BTreeMap::new(),
            keyframes: None,
            names: None,
            history: None,
            warned_of_limit: false,
        }
    }

    /// Returns an id for a new segment, to be used by a prediction of the current frame.
    ///
    /// Ids count up from 1. Once all ids that fit a 16-bit image have been given out, ids are reused that were
    /// predicted in one frame at most and that no Gaussian has votes for. Only if there are none does counting
    /// continue, up to [`MAX_SEGMENT_ID`](splatseg_geometry::MAX_SEGMENT_ID), and then again from 1, skipping ids that are in use.
    ///
    /// # Errors
    /// If the store refuses the id.
    pub fn new_segment(&mut self) -> Result<SegmentId, MemoryError> {
        let id = self.segments.add();
        self.store.new_segment(id)?;
        Ok(id)
    }

    /// Sets the keyframe to which new Gaussians are attached.
    pub fn set_anchor(&mut self, anchor: &FrameAnchor) {
        self.anchor = anchor.clone();
    }

    /// Renders the segments that the memory expects `frame` to show.
    pub fn recall<'f>(&self, frame: &'f RgbdFrame<'_>) -> Recall<'f> {
        let _stage = tracing::debug_span!(target: STAGE_TARGET, "decode").entered();
        let jump = if self.follows_jumps() { self.recent.jump(frame, self.origin, &self.settings) } else { None };
        let reported = frame.world_from_camera();
        let before_jump = jump.map_or(*reported, |jump| jump.inverse() * *reported);
        let place = FramePlace {
            map_from_camera: reported.relative_to(self.origin),
            viewed_from: before_jump.relative_to(self.origin),
            jump,
        };
        let trust = self.recent.trust(frame, &place.viewed_from, &self.settings);
        let read_tile = |tile: &TileWeights, surface: &TileSurface| self.store.read_tile(tile, surface);
        let rules = (&self.settings, &self.rules);
        let recall = Recall::new(&self.map.balls, read_tile, frame, &place, trust, UseOfWeights::Learning, rules);
        if !self.rules.expects_previous_ids {
            return recall;
        }
        match self.recent.expected_ids(&recall, &self.settings) {
            Some(ids) => recall.expecting_previous(&ids),
            None => recall,
        }
    }

    /// Renders the depth that the map shows to a camera: z-depth, metres, `[height, width]`, 0 where it shows no surface whose
    /// distance is known.
    pub fn expected_depth(&self, intrinsics: &Intrinsics, world_from_camera: &Pose) -> Image<f32> {
        let place = world_from_camera.relative_to(self.origin);
        let camera = Camera { limits: self.rules.limits, ..Camera::new(*intrinsics, &place) };
        expected_depth(&self.map.balls, &camera, &self.settings)
    }

    /// Renders the segments that the map, as it is now, shows at the pose of an earlier frame, which showed the ids `shown`,
    /// `[height, width]`. Where its colours say that another thing was there, the result has no segment.
    pub fn look_again(&self, frame: &RgbdFrame<'_>, shown: &SegmentMap) -> SegmentBelief {
        let pose = frame.world_from_camera().relative_to(self.origin);
        let place = FramePlace { map_from_camera: pose, viewed_from: pose, jump: None };
        let verdicts = self.patches.verdicts();
        let read_tile = |tile: &TileWeights, surface: &TileSurface| self.store.read_tile_with(tile, surface, &verdicts);
        let rules = (&self.settings, &self.rules);
        let (trust, weights) = (FrameTrust::Alone, UseOfWeights::Reading);
        let recall = Recall::new(&self.map.balls, read_tile, frame, &place, trust, weights, rules);
        let replacements = replaced::compared_colors(self, &recall, shown, |_| true).replacements;
        let mut belief = recall.belief;
        if !replacements.is_empty() {
            let pixels = belief.segments.pixels_mut().iter_mut().zip(belief.confidence.pixels_mut());
            for ((id, confidence), shown) in pixels.zip(shown.pixels()) {
                if replacements.excludes(*shown, *id) {
                    (*id, *confidence) = (0, 0.0);
                }
            }
        }
        belief
    }

    /// Combines the expected segments with the frame's predictions. `predicted` contains the predicted id visible at
    /// each pixel, 0 for none. Returns the frame's segments, `[height, width]`.
    ///
    /// # Errors
    /// If `predicted` differs from the frame in size or contains an id that does not exist.
    pub fn fuse(&self, recall: &Recall<'_>, predicted: &SegmentMap) -> Result<SegmentMap, MemoryError> {
        self.check_predictions(recall, predicted)?;
        Ok(self.store.fuse(recall, predicted))
    }

    /// Returns the most likely segment after the expected one at each pixel, `[height, width]`; 0 for none. Always 0
    /// for a memory without a second opinion.
    pub fn second_opinion(&self, recall: &Recall<'_>) -> SegmentMap {
        self.store.second_opinion(recall)
    }

    /// Finds predictions that are not the segments expected at their place, because colours differ. `labels` contains a
    /// number for the prediction visible at each pixel, `[height, width]`, 0 for none. Nothing is found without
    /// `memory.compare_colors`, or where frames remove nothing.
    pub fn find_replacements(&self, recall: &mut Recall<'_>, labels: &SegmentMap) -> Replacements {
        replaced::find(self, recall, labels)
    }

    /// Learns a frame: its predictions `predicted`, as in [`Self::fuse`], and the surfaces that the map lacks. Removes
    /// Gaussians of surfaces that are gone. Votes for the ids in `contradicted` weigh `memory.contradicted_weight`.
    ///
    /// # Errors
    /// As [`Self::fuse`].
    pub fn update(
        &mut self,
        recall: Recall<'_>,
        predicted: &SegmentMap,
        contradicted: &BTreeSet<SegmentId>,
    ) -> Result<FrameUpdate, MemoryError> {
        self.update_with_affinities(recall, predicted, contradicted, &Segmentation::default())
    }

    /// As [`Self::update`], and learns the affinities of `found`, what the segmenter found in the frame, for
    /// [`Self::settle`].
    ///
    /// # Errors
    /// As [`Self::fuse`], and [`MemoryError::Affinities`] if the affinities or regions do not fit the frame.
    pub fn update_with_affinities(
        &mut self,
        mut recall: Recall<'_>,
        predicted: &SegmentMap,
        contradicted: &BTreeSet<SegmentId>,
        found: &Segmentation,
    ) -> Result<FrameUpdate, MemoryError> {
        let evidence = self.fitting_affinities(&recall, found)?;
        self.check_predictions(&recall, predicted)?;
        let mut update =
            FrameUpdate { new_segments: self.segments.record_sightings(predicted), ..FrameUpdate::default() };
        if self.register_distance(&recall) {
            self.recent.record(&recall, predicted, &self.settings);
            self.frames = self.frames.saturating_add(1);
            return Ok(update);
        }
        self.follow(&mut recall);
        let stage = tracing::debug_span!(target: STAGE_TARGET, "grow").entered();
        let added = new_gaussians(&recall, predicted, &self.map.surfaces, (&self.settings, &self.rules));
        self.map.add(&added, self.frames, self.anchor.keyframe);
        self.store.grow(&added, &recall, predicted, contradicted);
        update.grown = added.len();
        drop(stage);

        let stage = tracing::debug_span!(target: STAGE_TARGET, "learn").entered();
        replaced::replace(self, &mut recall, predicted);
        let Self { store, patches, map, settings, .. } = self;
        patches.add_unknown(map.len() - added.len());
        let learn_evidence = || {
            if let Some(evidence) = evidence {
                patches.learn(&recall, &added, predicted, evidence, settings);
            }
            patches.add_unknown(map.len());
        };
        let learn = || store.learn(&recall, &map.balls, predicted, contradicted);
        (update.learning, ()) = rayon::join(learn, learn_evidence);
        self.recent.record(&recall, predicted, &self.settings);
        drop(stage);

        let _stage = tracing::debug_span!(target: STAGE_TARGET, "grow").entered();
        update.removed = self.remove_gone(&recall);
        update.forgotten = self.release_ids(update.removed > 0).forgotten;
        self.frames = self.frames.saturating_add(1);
        Ok(update)
    }

    /// The regions and affinities of a frame if there are any and the store can use them.
    fn fitting_affinities<'a>(
        &self,
        recall: &Recall<'_>,
        found: &'a Segmentation,
    ) -> Result<Option<(&'a SegmentMap, &'a Affinities)>, MemoryError> {
        let evidence = found.regions.as_ref().zip(found.affinities.as_ref());
        let Some((regions, affinities)) = evidence.filter(|_| self.store.can_remap()) else { return Ok(None) };
        let expected = (recall.frame.width(), recall.frame.height());
        if regions.size() != expected || !affinities.fits(expected) {
            return Err(MemoryError::Affinities { regions: regions.size(), expected });
        }
        Ok(Some((regions, affinities)))
    }

    /// Decides from the affinities of all frames so far which Gaussians are one object, and counts that as votes: one for eight
    /// frames that saw them. Every object has the id that most frames gave it. Where another object has more of that, and for
    /// Gaussians of frames without affinities, votes stay as they are. Returns false if the memory has learnt no affinities:
    /// then nothing changes.
    pub fn settle(&mut self) -> bool {
        if self.patches.is_empty() {
            return false;
        }
        // Ids are those that frames gave, whatever was decided in between.
        self.patches.forget_verdicts();
        self.patches.decide(Scope::All);
        self.keep_verdicts();
        true
    }

    /// Decides the same about what the last `frames` frames have seen. Votes stay as they are: the verdicts only count in what
    /// [`Self::look_again`] and [`Self::map`] show, until the next call. Objects keep the ids of the last call.
    pub fn decide_objects(&mut self, frames: u32) {
        if !self.patches.is_empty() {
            self.patches.decide(Scope::Frames(frames));
        }
    }

    /// Counts the verdicts of [`Self::decide_objects`] as votes for good.
    pub fn keep_verdicts(&mut self) {
        self.store.count_verdicts(&self.patches.verdicts());
        self.patches.forget_verdicts();
        // Ids that are forgotten now are not reported: no frame has just lost them.
        self.release_ids(false);
    }

    /// Records a frame whose pose is unknown: its ids count as seen, but the map does not change. `predicted` contains the
    /// id of each pixel, `[height, width]`, 0 for none.
    ///
    /// # Errors
    /// If `predicted` contains an id that does not exist.
    pub fn record_without_pose(&mut self, predicted: &SegmentMap) -> Result<FrameUpdate, MemoryError> {
        self.check_ids(predicted)?;
        let new_segments = self.segments.record_sightings(predicted);
        self.recent.record_without_pose(predicted);
        let forgotten = self.release_ids(false).forgotten;
        self.frames = self.frames.saturating_add(1);
        Ok(FrameUpdate { new_segments, forgotten, ..FrameUpdate::default() })
    }

    /// The largest id given out so far.
    pub fn highest_id(&self) -> SegmentId {
        self.segments.highest()
    }

    /// Counts the frames that show an id again, after earlier frames were decided again: of its sightings, `before` were
    /// in these frames, and now it is `after`. So [`MapView::is_tentative`] refers to what the frames show in the end.
    pub fn recount_sightings(&mut self, id: SegmentId, before: u32, after: u32) {
        self.segments.recount(id, before, after);
    }

    /// Records the ids that a frame shows, `[height, width]`, 0 for none. Ids that were shown side by side never become
    /// one.
    pub fn record_shown(&mut self, segments: &SegmentMap) {
        self.co_visible.record(segments);
    }

    /// Moves the Gaussians with their keyframes, and joins the surfaces and ids that are there twice. Returns the ids that
    /// turned out to be older ones' objects.
    pub fn correct(&mut self, correction: &MapCorrection) -> Vec<RemappedId> {
        let before = self.map.balls.means.clone();
        let motions = motions(correction, self.origin);
        move_anchored(&mut self.map, &motions);
        if let Some(motion) = motions.get(&self.anchor.keyframe) {
            self.recent.transform(motion);
        }
        if correction.joined.is_empty() || !self.store.can_remap() {
            return Vec::new();
        }
        joining::join_surfaces(self, &before, AFTER_LOOP)
    }

    /// Gives the ids of the latest frame, if its pose was unknown, to those that a frame whose pose is known shows
    /// instead. `segments` contains its id of each pixel, `[height, width]`, 0 for none. Must be called before
    /// [`Self::update`]. Only ids without Gaussians change: the map knows nothing about them yet. Returns the changed ids.
    pub fn remap_recognised(&mut self, segments: &SegmentMap) -> Vec<RemappedId> {
        let Some(without_pose) = self.recent.ids_without_pose().filter(|ids| ids.size() == segments.size()) else {
            return Vec::new();
        };
        let mapped: BTreeSet<SegmentId> = self.store.segment_ids().into_iter().collect();
        let remapped = recognised(without_pose, segments, &mapped, &self.co_visible);
        self.remap(&remapped);
        remapped
    }

    /// The ids that turned out to be older ones' objects, since the memory was created: the id and the older one.
    pub fn remapped_ids(&self) -> &BTreeMap<SegmentId, SegmentId> {
        &self.remapped
    }

    /// True if [`Self::merge_objects`] can be used: the store's ids can change.
    pub fn can_merge_objects(&self) -> bool {
        self.store.can_remap()
    }

    /// Makes the first of each of these ids' objects part of the second's, as a person says. Does nothing if
    /// [`Self::can_merge_objects`] is false.
    pub fn merge_objects(&mut self, remapped: &[RemappedId]) {
        if self.can_merge_objects() {
            self.remap(remapped);
        }
    }

    /// True if this kind of memory can be joined with another one: it remembers votes.
    pub fn can_join(&self) -> bool {
        self.store.can_remap()
    }

    /// Adds the Gaussians and ids of a later map of the same place, whose world coordinates must be those of this map: see
    /// [`Self::correct`]. `first_keyframe` is added to the numbers of its keyframes.
    ///
    /// Surfaces that both maps have become one, as after a loop: Gaussians of the later map add their votes to those of
    /// this one. Ids of the two maps that overlap there become this map's ids, and so do those in `same` (`from` is an id
    /// of the later map, `into` one of this map). The others get new ids.
    ///
    /// # Errors
    /// [`MemoryError::CannotJoin`] if one of the maps does not remember votes.
    pub fn join(
        &mut self,
        later: Self,
        first_keyframe: KeyframeId,
        same: &[RemappedId],
    ) -> Result<JoinedIds, MemoryError> {
        joining::join(self, later, first_keyframe, same)
    }

    /// Removes the Gaussians for which `keep` is false.
    pub fn keep_gaussians(&mut self, keep: &[bool]) {
        self.retain(keep);
        self.release_ids(true);
    }

    pub(crate) fn remap(&mut self, remapped: &[RemappedId]) {
        if remapped.is_empty() {
            return;
        }
        let new_from_old: BTreeMap<SegmentId, SegmentId> = remapped.iter().map(|ids| (ids.from, ids.into)).collect();
        self.store.remap(&new_from_old);
        self.patches.remap(&new_from_old);
        self.recent.remap(&new_from_old);
        for ids in remapped {
            self.co_visible.remap(*ids);
            self.segments.remap(*ids);
            self.remapped.values_mut().filter(|into| **into == ids.from).for_each(|into| *into = ids.into);
            self.remapped.insert(ids.from, ids.into);
        }
    }

    /// The ids of the latest frame, `[height, width]`, 0 for none: its predictions, not what was shown. `None` before the
    /// first frame.
    pub fn latest_ids(&self) -> Option<&SegmentMap> {
        self.recent.latest_ids()
    }

    /// The ids of the latest frame if its pose was unknown, `[height, width]`, 0 for none: its predictions.
    pub fn ids_without_pose(&self) -> Option<&SegmentMap> {
        self.recent.ids_without_pose()
    }

    /// Says that the next frame was taken at another time than the latest one, as in a later run with the same map. If
    /// its pose is unknown, its masks do not get the ids of the latest frame's masks at the same pixels.
    pub fn start_session(&mut self) {
        self.recent.start_session();
    }

    /// True if the pose of a frame is so far off that it must be wrong. Counts such frames: several in a row are believed.
    fn register_distance(&mut self, recall: &Recall<'_>) -> bool {
        let is_far = recall.jump.is_none()
            && self.map.len() > 0
            && is_far(recall.frame.world_from_camera().translation(), self.origin);
        self.recent.count_far_frame(is_far) < MIN_FAR_FRAMES && is_far
    }

    /// Moves the map's coordinates to an origin near the frame's camera, and moves the map with a jump of the poses.
    fn follow(&mut self, recall: &mut Recall<'_>) {
        if recall.jump.is_some() {
            tracing::warn!("frame {}: the poses have jumped; the map moves with them", recall.frame.name());
        }
        let pose = recall.frame.world_from_camera();
        let origin = origin_for(pose.translation(), self.origin);
        if recall.jump.is_none() && origin == self.origin {
            return;
        }
        let moved = change_of_origin(&recall.jump.unwrap_or(Pose::IDENTITY), self.origin, origin);
        recall.moved_to(pose.relative_to(origin));
        self.map.balls.means.par_iter_mut().for_each(|mean| *mean = moved.to_world(*mean));
        self.recent.transform(&moved);
        self.origin = origin;
    }

    /// Removes the Gaussians of surfaces that are gone, and the ones unseen for longest if there are too many. Returns
    /// the number removed.
    fn remove_gone(&mut self, recall: &Recall<'_>) -> usize {
        let before = self.map.len();
        if self.rules.is_papers_map() {
            // Only Gaussians beyond the limit are removed, those out of view for longest first.
            for splat in recall.view.projected() {
                self.map.last_seen[splat.gaussian as usize] = self.frames;
            }
        } else {
            let found;
            let visibility: &[Visibility] = if recall.visibility.is_empty() {
                let camera = recall.view.camera();
                found = visibilities(&self.map.balls, recall.frame, camera, FrameTrust::Alone, &self.settings).0;
                &found
            } else {
                &recall.visibility
            };
            let certain = self.without_uncertain_anchors(visibility);
            let visibility = certain.as_deref().unwrap_or(visibility);
            if let Some(keep) = record_visibility(&mut self.map, visibility, self.settings.removal_frames, self.frames)
            {
                self.retain(&keep);
            }
        }
        if let Some(keep) = longest_unseen(&self.map.last_seen, self.settings.max_gaussians) {
            self.retain(&keep);
            if !self.warned_of_limit {
                let max = self.settings.max_gaussians;
                tracing::warn!(
                    "the map has reached memory.max_gaussians = {max}: removing Gaussians unseen for longest"
                );
                self.warned_of_limit = true;
            }
        }
        before - self.map.len()
    }

    /// The visibility without those through surfaces whose pose relative to the camera is uncertain: they may only look gone.
    /// `None` if there are no such surfaces.
    fn without_uncertain_anchors(&self, visibility: &[Visibility]) -> Option<Vec<Visibility>> {
        let uncertain = &self.anchor.uncertain;
        let certain = |(seen, anchor): (&Visibility, &KeyframeId)| match seen {
            Visibility::SeenThrough if uncertain.contains(anchor) => Visibility::Unknown,
            seen => *seen,
        };
        (!uncertain.is_empty()).then(|| visibility.par_iter().zip(&self.map.anchors).map(certain).collect())
    }

    pub(crate) fn retain(&mut self, keep: &[bool]) {
        self.map.retain(keep);
        self.store.retain(keep);
        self.patches.retain(keep);
    }

    /// Finds the ids that the memory has lost. `has_removed` is true if Gaussians were removed in this frame.
    pub(crate) fn release_ids(&mut self, has_removed: bool) -> LostIds {
        let holds = self.store.changed_holds();
        if let Some(holds) = &holds {
            self.segments.set_holds(holds);
        }
        let is_due = self.rules.counts_ids_per_frame || self.frames.is_multiple_of(FRAMES_PER_CENSUS);
        // Under any rule, ids must be released once they are to be reused.
        let is_needed = !self.rules.is_papers_map() || self.segments.are_short_ids_given();
        let may_have_changed = has_removed || (is_due && is_needed);
        if !may_have_changed {
            return LostIds::default();
        }
        if holds.is_none() {
            self.segments.set_shown(&distinct(&self.store.segment_ids()));
        }
        self.segments.set_held(self.recent.held_ids());
        let lost_ids = self.segments.release_ids();
        self.co_visible.remove(&lost_ids.lost);
        lost_ids
    }

    /// True if the map follows when the poses jump. The paper's does not, and tracked poses only jump with a correction.
    pub(crate) fn follows_jumps(&self) -> bool {
        !self.rules.is_papers_map() && self.gaussian_count() > 0 && !self.anchor.is_tracked
    }

    fn check_predictions(&self, recall: &Recall<'_>, predicted: &SegmentMap) -> Result<(), MemoryError> {
        let (found, expected) = (predicted.size(), (recall.frame.width(), recall.frame.height()));
        if found != expected {
            return Err(MemoryError::PredictionSize { found, expected });
        }
        self.check_ids(predicted)
    }

    fn check_ids(&self, predicted: &SegmentMap) -> Result<(), MemoryError> {
        let largest = predicted.pixels().iter().copied().max().unwrap_or(0);
        let known = self.segments.highest();
        if largest > known {
            return Err(MemoryError::UnknownSegment { found: largest, known });
        }
        Ok(())
    }

    /// Settings of the memory.
    pub fn settings(&self) -> &MemorySettings {
        &self.settings
    }

    /// The rules of this kind of memory, with the growth rule in force.
    pub fn rules(&self) -> &MemoryRules {
        &self.rules
    }

    /// Number of frames that the map was made from, of all runs together.
    pub fn frame_count(&self) -> u32 {
        self.frames
    }

    /// The last frame that saw each object with Gaussians, counted from 0 over all runs of the map.
    pub fn last_seen(&self) -> BTreeMap<SegmentId, u32> {
        let mut found = BTreeMap::new();
        let seen = self.map().segment_ids().into_iter().zip(&self.map.last_seen);
        for (id, frame) in seen.filter(|(id, _)| *id != 0) {
            let last = found.entry(id).or_default();
            *last = (*frame).max(*last);
        }
        found
    }

    /// Number of Gaussians.
    pub fn gaussian_count(&self) -> usize {
        self.map.len()
    }

    /// Number of different ids given out so far: they are 1 to this number.
    pub fn segment_count(&self) -> usize {
        self.segments.highest() as usize
    }

    /// The map: its Gaussians, and the segments that they show.
    pub fn map(&self) -> MapView<'_> {
        MapView {
            origin: self.origin,
            means: &self.map.balls.means,
            radii: &self.map.balls.radii,
            colors: &self.map.colors,
            surfaces: &self.map.surfaces,
            patch: self.rules.patch_size(&self.settings),
            segments: self,
        }
    }

    /// Writes the memory to a PLY file that splat viewers open, replacing any file at `path`.
    ///
    /// Besides the usual 3DGS properties, each Gaussian has its votes or feature and the `segment_id` that it shows by
    /// itself.
    ///
    /// # Errors
    /// If the file cannot be written, the kind of memory has no file format, a part is larger than [`Self::load`] reads, or
    /// something attached is no [`StateBlock`](splatseg_files::StateBlock). No partial file is left.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<(), SplatFileError> {
        self.save_with(path, Attached::default())
    }

    /// As [`Self::save`], with what other parts of a pipeline know about the map.
    ///
    /// # Errors
    /// As [`Self::save`].
    pub fn save_with(&self, path: impl AsRef<Path>, attached: Attached<'_>) -> Result<(), SplatFileError> {
        persistence::save(self, path.as_ref(), attached)
    }

    /// Loads a saved memory, to continue as if the run had not ended. Ids keep their meaning. `settings` are the
    /// settings of the new run.
    ///
    /// # Errors
    /// If the file is damaged or not a splatseg memory, or its kind or feature dimension differs from the settings.
    pub fn load(path: impl AsRef<Path>, settings: MemorySettings) -> Result<Self, LoadMemoryError> {
        persistence::load(path.as_ref(), settings)
    }

    /// The camera's keyframes that a loaded file contains, bytes of a [`StateBlock`](splatseg_files::StateBlock). `None` if
    /// there are none, or they were taken already.
    pub fn take_keyframes(&mut self) -> Option<Vec<u8>> {
        self.keyframes.take()
    }

    /// The names of objects that a loaded file contains, bytes of a [`StateBlock`](splatseg_files::StateBlock). `None` if
    /// there are none, or they were taken already.
    pub fn take_names(&mut self) -> Option<Vec<u8>> {
        self.names.take()
    }

    /// When objects were seen, and the rooms so far, that a loaded file contains: bytes of a
    /// [`StateBlock`](splatseg_files::StateBlock). `None` if there are none, or they were taken already.
    pub fn take_history(&mut self) -> Option<Vec<u8>> {
        self.history.take()
    }
}

impl MapSegments for SplatMemory {
    fn segment_ids(&self) -> Vec<SegmentId> {
        self.store.segment_ids_with(&self.patches.verdicts())
    }

    fn segment_shares(&self) -> Option<Vec<f32>> {
        self.store.segment_shares(&self.patches.verdicts())
    }

    fn segment_votes(&self) -> Option<Vec<f32>> {
        self.store.segment_votes(&self.patches.verdicts())
    }

    fn segment_confidences(&self) -> Option<Vec<f32>> {
        self.store.segment_confidences(&self.patches.verdicts())
    }

    fn is_tentative(&self, id: SegmentId) -> bool {
        self.segments.is_tentative(id)
    }

    fn is_carried(&self, id: SegmentId) -> bool {
        match self.patches.is_decided() {
            true => self.carried_ids().contains(&id),
            false => self.segments.is_carried(id),
        }
    }

    fn carried_of(&self, mut ids: Vec<SegmentId>) -> Vec<SegmentId> {
        if self.patches.is_decided() {
            // Once for all of them: it takes a time proportional to the map.
            let carried = self.carried_ids();
            ids.retain(|id| carried.contains(id));
        } else {
            ids.retain(|id| self.is_carried(*id));
        }
        ids
    }

    fn carried_ids(&self) -> BTreeSet<SegmentId> {
        let mut carried = distinct(&self.segment_ids());
        carried.extend(self.recent.held_ids());
        carried
    }

    /// Each Gaussian has 3 for position, 1 for radius, 3 for colour, and 8 (votes) or D (features) for segments.
    fn parameter_count(&self) -> usize {
        self.map.len() * (SplatMap::NUMBERS + self.store.numbers_per_gaussian())
    }
}

/// Returns the distinct ids in a list, except 0.
fn distinct(ids: &[SegmentId]) -> BTreeSet<SegmentId> {
    // Neighbours mostly have the same id.
    ids.chunk_by(|one, other| one == other).map(|run| run[0]).filter(|id| *id != 0).collect()
}
