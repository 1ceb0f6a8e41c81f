//! SAM2-Splat: a tracker with a splat memory that corrects it (`docs/PAPER.md`, "SAM2-Splat").
//!
//! Tracks and remembered segments share ids, so no matching is needed. The tracker receives a frame, then all prompts
//! for that frame in one batch. `reprompting/track_errors.rs` compares tracks with the segments that the memory
//! expects, `reprompting/clicks.rs` chooses the points of corrections, and `trackers/new_objects.rs` selects detections
//! that no track covers.

use super::output::confidence;
use super::{FrameOutput, Method, check_comparable};
use crate::TrackingError;
use crate::matching::painted;
use crate::reprompting::{RepromptSettings, TrackErrorCounts, corrections, find_track_errors, repeated_answers};
use crate::trackers::{NewObjects, PromptSource, Tracker, add_tracks, prompt_tracks, remove_tracks, visible};
use splatseg_geometry::{
    FrameAnchor, Image, MapCorrection, Mask, RemappedId, RgbdFrame, STAGE_TARGET, ScoredMask, SegmentId, SegmentMap,
    Segmentation,
};
use splatseg_memory::{FrameUpdate, MemoryError, MemorySettings, SegmentBelief, SplatMemory};
use splatseg_settings::{Allowed, Choice, settings};
use std::collections::BTreeSet;

settings! {
    /// Settings of [`Sam2Splat`].
    pub struct Sam2SplatSettings in "" {
        /// Source of the mask prompts of new objects.
        prompts: PromptSource = PromptSource::Detections, Allowed::Names(PromptSource::NAMES);
        /// A detection is a new object only if its IoU with every track, and with every better detection of the frame,
        /// is at most this. The paper: 0.1.
        max_detection_iou: f64 = 0.1, Allowed::between(0.0, 1.0);
        /// Detections with fewer pixels are ignored. The paper: 0.
        min_area: usize = 50, Allowed::between(0.0, 1e9);
    }
    sections {
        /// Correction of the tracker's errors.
        reprompt: RepromptSettings;
        /// The memory.
        memory: MemorySettings;
    }
}

/// The method: tracks and remembered segments share ids, so a track that goes astray is detected and prompted again.
///
/// Its output is the tracker's masks after re-prompting and additions, without expected segments that no track shows.
/// After `with_memory`, the first frame prompts all segments that the memory expects in it.
pub struct Sam2Splat {
    tracker: Box<dyn Tracker>,
    memory: SplatMemory,
    new_objects: NewObjects,
    reprompt: RepromptSettings,
    /// Ids that the memory has forgotten and the tracker still follows.
    forgotten: BTreeSet<SegmentId>,
}

impl Sam2Splat {
    /// Creates the method with an empty memory and a tracker before its first frame. `seed` and `progress` are for the
    /// codebook of a memory of features; `progress` receives the fraction done.
    ///
    /// # Errors
    /// If a setting is out of range.
    pub fn new(
        tracker: Box<dyn Tracker>,
        settings: Sam2SplatSettings,
        seed: u64,
        progress: &mut dyn FnMut(f32),
    ) -> Result<Self, TrackingError> {
        let memory = SplatMemory::new(settings.memory.clone(), seed, progress)?;
        Self::with_memory(tracker, settings, memory)
    }

    /// Creates the method with a memory from an earlier run, continuing its ids.
    ///
    /// # Errors
    /// If a setting is out of range.
    pub fn with_memory(
        tracker: Box<dyn Tracker>,
        settings: Sam2SplatSettings,
        memory: SplatMemory,
    ) -> Result<Self, TrackingError> {
        settings.validate()?;
        let Sam2SplatSettings { prompts, max_detection_iou, min_area, reprompt, memory: _ } = settings;
        let new_objects = NewObjects { prompts, max_detection_iou, min_area };
        Ok(Self { tracker, memory, new_objects, reprompt, forgotten: BTreeSet::new() })
    }

    /// Removes tracks that the memory has forgotten, once they are out of view. Otherwise tracks of objects that were
    /// taken away, or of places that the map has lost, would accumulate.
    fn drop_forgotten(&mut self, forgotten: &[SegmentId], visible: &[(SegmentId, Mask)]) {
        self.forgotten.extend(forgotten);
        let memory = &self.memory;
        self.forgotten.retain(|id| !memory.map().is_carried(*id));
        let is_visible = |id: &SegmentId| visible.binary_search_by_key(id, |(id, _)| *id).is_ok();
        let tracker = self.tracker.as_mut();
        self.forgotten.retain(|id| {
            let is_visible = is_visible(id);
            if !is_visible {
                tracker.remove(*id);
            }
            is_visible
        });
    }

    fn tracks(&mut self, frame: &RgbdFrame) -> Result<Vec<(SegmentId, Mask)>, TrackingError> {
        let _stage = tracing::debug_span!(target: STAGE_TARGET, "track").entered();
        Ok(self.tracker.track(frame)?)
    }

    /// Adds tracks for the masks that no track covers.
    fn track_new_objects(
        &mut self,
        tracks: &mut Vec<(SegmentId, Mask)>,
        masks: &[ScoredMask],
    ) -> Result<(), TrackingError> {
        let _stage = tracing::debug_span!(target: STAGE_TARGET, "track").entered();
        let new_objects = self.new_objects.among(tracks, masks);
        let ids = self.new_ids(new_objects.len())?;
        // A reused id stands for another object from now on.
        let reused = tracks.iter().map(|(id, _)| *id).filter(|id| ids.contains(id)).collect();
        remove_tracks(self.tracker.as_mut(), tracks, &reused);
        add_tracks(self.tracker.as_mut(), tracks, &new_objects, &ids)?;
        Ok(())
    }

    fn new_ids(&mut self, count: usize) -> Result<Vec<SegmentId>, MemoryError> {
        (0..count).map(|_| self.memory.new_segment()).collect()
    }
}

/// The result of a frame: masks, the id of each pixel, and its confidence.
struct Shown {
    masks: Vec<(SegmentId, Mask)>,
    segments: SegmentMap,
    confidence: Image<f32>,
}

impl Shown {
    fn new(frame: &RgbdFrame, tracks: Vec<(SegmentId, Mask)>, expected: Option<&SegmentBelief>) -> Self {
        let _stage = tracing::debug_span!(target: STAGE_TARGET, "fuse").entered();
        let masks = visible(tracks);
        let segments = painted((frame.width(), frame.height()), &masks);
        let scores = masks.iter().map(|(id, _)| (*id, 1.0)).collect();
        let confidence = confidence(&segments, &scores, expected);
        Self { masks, segments, confidence }
    }

    fn output(self, track_errors: TrackErrorCounts, update: FrameUpdate) -> FrameOutput {
        let Self { masks, segments, confidence } = self;
        FrameOutput { segments, confidence, predictions: masks.len(), masks, track_errors, update }
    }
}

impl Method for Sam2Splat {
    fn name(&self) -> &str {
        "sam2-splat"
    }

    fn process(&mut self, frame: &RgbdFrame, found: &Segmentation) -> Result<FrameOutput, TrackingError> {
        check_comparable(frame, found)?;
        let mut tracks = self.tracks(frame)?;
        let recall = self.memory.recall(frame);

        let stage = tracing::debug_span!(target: STAGE_TARGET, "match").entered();
        let errors = find_track_errors(recall.expected(), &tracks, &self.reprompt);
        drop(stage);

        let stage = tracing::debug_span!(target: STAGE_TARGET, "reprompt").entered();
        let (prompts, removed) = corrections(&errors, &self.reprompt);
        remove_tracks(self.tracker.as_mut(), &mut tracks, &removed);
        prompt_tracks(self.tracker.as_mut(), &mut tracks, &prompts)?;
        let repeated = repeated_answers(&errors, &tracks, &self.reprompt);
        remove_tracks(self.tracker.as_mut(), &mut tracks, &repeated);
        drop(stage);

        self.track_new_objects(&mut tracks, &found.masks)?;
        let shown = Shown::new(frame, tracks, Some(recall.expected()));
        let remapped = self.memory.remap_recognised(&shown.segments);
        // As in `correct_map`: otherwise the track would bring back an id that stands for no object any more.
        remapped.iter().for_each(|ids| self.tracker.remove(ids.from));
        let update = self.memory.update(recall, &shown.segments, &BTreeSet::new())?;
        let update = FrameUpdate { remapped, ..update };
        self.memory.record_shown(&shown.segments);
        self.drop_forgotten(&update.forgotten, &shown.masks);
        Ok(shown.output(TrackErrorCounts::of(&errors), update))
    }

    fn process_without_pose(&mut self, frame: &RgbdFrame, found: &Segmentation) -> Result<FrameOutput, TrackingError> {
        check_comparable(frame, found)?;
        let mut tracks = self.tracks(frame)?;
        self.track_new_objects(&mut tracks, &found.masks)?;
        let shown = Shown::new(frame, tracks, None);
        let update = self.memory.record_without_pose(&shown.segments)?;
        self.memory.record_shown(&shown.segments);
        self.drop_forgotten(&update.forgotten, &shown.masks);
        Ok(shown.output(TrackErrorCounts::default(), update))
    }

    fn set_anchor(&mut self, anchor: &FrameAnchor) {
        self.memory.set_anchor(anchor);
    }

    fn correct_map(&mut self, correction: &MapCorrection) -> Vec<RemappedId> {
        let remapped = self.memory.correct(correction);
        // If the older id has no track, the memory prompts one.
        remapped.iter().for_each(|ids| self.tracker.remove(ids.from));
        remapped
    }

    fn merge_objects(&mut self, remapped: &[RemappedId]) {
        self.memory.merge_objects(remapped);
        remapped.iter().for_each(|ids| self.tracker.remove(ids.from));
    }

    fn memory(&self) -> Option<&SplatMemory> {
        Some(&self.memory)
    }
}
