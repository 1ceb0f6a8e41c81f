//! SAM2-Splat: a tracker, and a splat that remembers what it should be tracking (METHOD, "SAM2-Splat, one frame").

use crate::painting::painted;
use crate::reprompt::corrections;
use crate::track_masks::{add_tracks, prompt_tracks, visible};
use crate::{
    FrameOutput, Method, NewObjectSettings, RepromptSettings, StageTimes, TrackErrorCounts, Tracker, TrackingError,
    check_sizes, find_track_errors,
};
use serde::{Deserialize, Serialize};
use splatseg_geometry::{RgbdFrame, ScoredMask};
use splatseg_memory::{MemorySettings, SplatMemory};
use splatseg_segmenter::Segmenter;
use std::time::Instant;

/// Settings of [`Sam2Splat`].
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Sam2SplatSettings {
    /// Settings of the memory.
    pub memory: MemorySettings,
    /// Which detections become tracks.
    pub new_objects: NewObjectSettings,
    /// Which errors of the tracker are put right, and how.
    pub reprompt: RepromptSettings,
    /// Seed of the codebook.
    pub seed: u64,
}

/// The method: tracks and remembered segments share ids, so a track that goes astray is seen and prompted anew.
///
/// Its output are the tracker's masks after re-prompting and additions; what the memory expects and no track shows is
/// not part of it. After `with_memory` the first frame prompts everything that the memory knows to be in view.
pub struct Sam2Splat {
    segmenter: Box<dyn Segmenter>,
    tracker: Box<dyn Tracker>,
    memory: SplatMemory,
    settings: Sam2SplatSettings,
}

impl Sam2Splat {
    /// A method with an empty memory, over a tracker before its first frame. `progress` is told the fraction of the
    /// codebook that is made (up to seconds).
    ///
    /// # Errors
    /// If a setting is out of range.
    pub fn new(
        segmenter: Box<dyn Segmenter>,
        tracker: Box<dyn Tracker>,
        settings: Sam2SplatSettings,
        progress: &mut dyn FnMut(f32),
    ) -> Result<Self, TrackingError> {
        let memory = SplatMemory::new(settings.memory.clone(), settings.seed, progress)?;
        Self::with_memory(segmenter, tracker, settings, memory)
    }

    /// A method that continues with a memory from an earlier run, and so with its ids.
    ///
    /// # Errors
    /// If a setting is out of range.
    pub fn with_memory(
        segmenter: Box<dyn Segmenter>,
        tracker: Box<dyn Tracker>,
        settings: Sam2SplatSettings,
        memory: SplatMemory,
    ) -> Result<Self, TrackingError> {
        settings.new_objects.validated()?;
        settings.reprompt.validated()?;
        Ok(Self { segmenter, tracker, memory, settings })
    }
}

impl Method for Sam2Splat {
    fn name(&self) -> &str {
        "sam2-splat"
    }

    fn segmenter(&mut self) -> &mut dyn Segmenter {
        self.segmenter.as_mut()
    }

    fn track(&mut self, frame: &RgbdFrame, masks: &[ScoredMask]) -> Result<FrameOutput, TrackingError> {
        check_sizes(frame, masks)?;
        let mut times = StageTimes::default();

        let started = Instant::now();
        let mut tracks = self.tracker.track(frame)?;
        times.track = started.elapsed();

        let started = Instant::now();
        let recall = self.memory.recall(frame);
        times.decode = started.elapsed().saturating_sub(recall.view_timing().total());

        let started = Instant::now();
        let errors = find_track_errors(recall.expected(), &tracks, &self.settings.reprompt);
        times.match_segments = started.elapsed();

        let started = Instant::now();
        let (prompts, removed) = corrections(&errors, self.settings.reprompt.clicks);
        removed.iter().for_each(|track| self.tracker.remove(*track));
        tracks.retain(|(id, _)| !removed.contains(id));
        prompt_tracks(self.tracker.as_mut(), &mut tracks, &prompts)?;
        times.reprompt = started.elapsed();

        let started = Instant::now();
        let new_objects = self.settings.new_objects.new_objects(&tracks, masks);
        add_tracks(self.tracker.as_mut(), &mut tracks, &new_objects, || Ok(self.memory.new_segment()?))?;
        times.track += started.elapsed();

        let started = Instant::now();
        let masks = visible(tracks);
        let segments = painted((frame.width(), frame.height()), &masks);
        times.fuse = started.elapsed();

        let update = self.memory.update(recall, &segments)?;
        times.take_update(&update);
        let (predictions, track_errors) = (masks.len(), TrackErrorCounts::of(&errors));
        Ok(FrameOutput { segments, masks, predictions, track_errors, update, times })
    }

    fn memory(&self) -> Option<&SplatMemory> {
        Some(&self.memory)
    }
}
