//! SAM 2.1, EdgeTAM and EfficientTAM as trackers.

use crate::{Tracker, TrackerError};
use rayon::prelude::*;
use splatseg_geometry::{CameraFrame, Mask, Prompt, SegmentId};
use splatseg_models::sam2::{MemoryPooling, ObjectMask, Sam2Network, Sam2Predictor, Sam2PredictorSettings};
use splatseg_settings::{Allowed, Choice, settings};
use std::collections::BTreeMap;
use std::sync::Arc;

settings! {
    /// Settings of SAM 2.1, EdgeTAM and EfficientTAM, and of [`Sam2Tracker`].
    #[derive(Copy)]
    pub struct Sam2TrackerSettings in "sam2" {
        /// Side of the square to which frames are resized, pixels. If left out: 1024, as published. EdgeTAM needs a
        /// multiple of 256.
        image_size: Option<usize> = None, Allowed::Multiple { of: 32, min: 32, max: 2048 };
        /// How EfficientTAM was trained to pool its memories, which its checkpoint does not tell: `weighted` for
        /// `efficienttam_*_1.pt`, `shifted` for `efficienttam_*_2.pt`.
        memory_pooling: MemoryPooling = MemoryPooling::None, Allowed::Names(MemoryPooling::NAMES);
        /// Number of objects processed by the network together. More objects need more memory; results are the same.
        objects_per_chunk: usize = 4, Allowed::between(1.0, 256.0);
        /// Holes of at most this many pixels are filled, counted in masks at a quarter of `image_size`. 0: none.
        fill_hole_area: usize = 8, Allowed::between(0.0, 1e6);
        /// Make the frame of a correction a conditioning frame, which is not forgotten. Otherwise the corrected mask is
        /// remembered as long as the masks of other frames.
        add_all_frames_to_correct_as_cond: bool = false, Allowed::Switch;
        /// Number of an object's latest conditioning frames that the network attends to. 0: all of them (-1 in the
        /// official code). An object has more than one only if corrections condition or it has rested.
        max_cond_frames_in_attn: usize = 4, Allowed::between(0.0, 1000.0);
        /// An object absent from this many frames in a row rests: it costs nothing until it is prompted again. 0:
        /// never, as in the official code. If left out: 16 for `sam2-splat` with `reprompt.not_tracked`, which prompts
        /// an object where the memory expects it, and 0 for others.
        max_absent_frames: Option<usize> = None, Allowed::between(0.0, 1e9);
        /// Resting objects are re-checked every this many frames, and followed again if found. 0: never.
        absent_check_interval: usize = 0, Allowed::between(0.0, 1e9);
        /// Maximum number of resting objects. Beyond it, those that have rested for longest are forgotten, since each
        /// takes up to a megabyte. If prompted again, such an object is followed as a new one with its old id. 0: none
        /// is forgotten.
        max_resting_objects: usize = 256, Allowed::between(0.0, 1e9);
    }
}

/// Default of `max_absent_frames` if lost objects are prompted again: the network uses at most the object pointers of
/// the 15 previous frames, so after 16 absent frames only the conditioning frames still show the object, and resting
/// keeps these.
const MAX_ABSENT_FRAMES: usize = 16;

impl Sam2TrackerSettings {
    /// Returns the settings with a value for `max_absent_frames`; its default depends on whether lost objects are
    /// prompted again.
    #[must_use]
    pub fn resolved(self, prompts_lost_objects: bool) -> Self {
        let default = if prompts_lost_objects { MAX_ABSENT_FRAMES } else { 0 };
        Self { max_absent_frames: self.max_absent_frames.or(Some(default)), ..self }
    }

    fn predictor(self) -> Sam2PredictorSettings {
        Sam2PredictorSettings {
            objects_per_chunk: self.objects_per_chunk,
            max_cond_frames_in_attn: (self.max_cond_frames_in_attn > 0).then_some(self.max_cond_frames_in_attn),
            add_all_frames_to_correct_as_cond: self.add_all_frames_to_correct_as_cond,
            fill_hole_area: self.fill_hole_area,
            max_absent_frames: self.max_absent_frames.unwrap_or(0),
            absent_check_interval: self.absent_check_interval,
            max_resting_objects: self.max_resting_objects,
            ..Sam2PredictorSettings::default()
        }
    }
}

/// SAM 2.1, EdgeTAM or EfficientTAM on the frames' colour images; depth is not used.
///
/// A mask prompt that is too thin for the network's resolution is skipped; its result is an empty mask.
#[derive(Debug)]
pub struct Sam2Tracker {
    predictor: Sam2Predictor,
    /// `(width, height)` of the current frame.
    size: (usize, usize),
}

impl Sam2Tracker {
    /// Creates a tracker. The network, created with [`Sam2TrackerSettings::image_size`] and [`Sam2TrackerSettings::memory_pooling`], may be
    /// shared.
    ///
    /// # Errors
    /// [`TrackerError::Sam2`] if a setting is out of range.
    pub fn new(network: impl Into<Arc<Sam2Network>>, settings: Sam2TrackerSettings) -> Result<Self, TrackerError> {
        Ok(Self { predictor: Sam2Predictor::new(network, settings.predictor())?, size: (0, 0) })
    }
}

impl Tracker for Sam2Tracker {
    fn name(&self) -> &str {
        "sam2"
    }

    fn track(&mut self, frame: &CameraFrame) -> Result<Vec<(SegmentId, Mask)>, TrackerError> {
        let tracked = self.predictor.track(frame.color())?;
        self.size = (frame.width(), frame.height());
        let (width, height) = self.size;
        // Resting objects are not among the tracked ones.
        let mut masks: BTreeMap<SegmentId, Mask> =
            self.predictor.state().objects().map(|id| (id as SegmentId, Mask::empty(width, height))).collect();
        masks.par_extend(tracked.par_iter().map(|found| (found.object as SegmentId, shown(found))));
        tracing::debug!(objects = masks.len(), followed = tracked.len(), "tracked");
        Ok(masks.into_iter().collect())
    }

    fn prompt(&mut self, prompts: &[(SegmentId, Prompt)]) -> Result<Vec<(SegmentId, Mask)>, TrackerError> {
        let (width, height) = self.size;
        let given: Vec<(u64, Prompt)> = prompts.iter().map(|(id, prompt)| (u64::from(*id), prompt.clone())).collect();
        let prompted = self.predictor.prompt_unless_empty(&given)?;
        let mask = |found: &Option<ObjectMask>| found.as_ref().map_or_else(|| Mask::empty(width, height), shown);
        let masks: Vec<Mask> = prompted.par_iter().map(mask).collect();
        Ok(prompts.iter().map(|(id, _)| *id).zip(masks).collect())
    }

    fn remove(&mut self, track: SegmentId) {
        // An unknown track is not an error here.
        let _ = self.predictor.remove(u64::from(track));
    }
}

/// Returns the object's pixels; none if it is not in the frame according to the network.
fn shown(found: &ObjectMask) -> Mask {
    if found.is_present() { found.mask() } else { Mask::empty(found.frame_size.0, found.frame_size.1) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_predictor_gets_the_settings() {
        let settings = Sam2TrackerSettings::default().with(|settings| {
            settings.objects_per_chunk = 7;
            settings.fill_hole_area = 5;
            settings.add_all_frames_to_correct_as_cond = true;
            settings.absent_check_interval = 9;
            settings.max_cond_frames_in_attn = 3;
        });
        let expected = Sam2PredictorSettings {
            objects_per_chunk: 7,
            max_cond_frames_in_attn: Some(3),
            add_all_frames_to_correct_as_cond: true,
            fill_hole_area: 5,
            max_absent_frames: 16,
            absent_check_interval: 9,
            max_resting_objects: 256,
            ..Sam2PredictorSettings::default()
        };
        assert_eq!(settings.resolved(true).predictor(), expected);
        assert_eq!(settings.resolved(false).predictor().max_absent_frames, 0);
        let all =
            settings.with(|settings| (settings.max_cond_frames_in_attn, settings.max_absent_frames) = (0, Some(4)));
        let found = all.resolved(true).predictor();
        assert_eq!((found.max_cond_frames_in_attn, found.max_absent_frames), (None, 4));
    }
}
