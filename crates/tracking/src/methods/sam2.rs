//! SAM2 on its own: a tracker with detections as prompts (`docs/PAPER.md`, "Baselines").

use super::output::confidence;
use super::{FrameOutput, Method, SegmentIds, check_comparable};
use crate::matching::painted;
use crate::trackers::{NewObjects, PromptSource, Tracker, add_tracks, visible};
use crate::{TrackErrorCounts, TrackingError};
use splatseg_geometry::{RgbdFrame, STAGE_TARGET, SegmentId, Segmentation};
use splatseg_memory::FrameUpdate;
use splatseg_settings::{Allowed, Choice, settings};
use std::collections::BTreeSet;

settings! {
    /// Settings of [`Sam2Baseline`].
    pub struct Sam2BaselineSettings in "" {
        /// Source of the mask prompts of new objects.
        prompts: PromptSource = PromptSource::Detections, Allowed::Names(PromptSource::NAMES);
        /// A detection is a new object only if its IoU with every track, and with every better detection of the frame,
        /// is at most this. The paper: 0.1.
        max_detection_iou: f64 = 0.1, Allowed::between(0.0, 1.0);
        /// Detections with fewer pixels are ignored.
        min_area: usize = 50, Allowed::between(0.0, 1e9);
    }
}

/// The baseline whose only memory is the tracker's. Detections of the first frame are mask prompts, and so are later
/// detections that no track covers. Ids are the tracks' ids.
pub struct Sam2Baseline {
    tracker: Box<dyn Tracker>,
    new_objects: NewObjects,
    ids: SegmentIds,
}

impl Sam2Baseline {
    /// Creates the method from a tracker before its first frame.
    ///
    /// # Errors
    /// If a setting is out of range.
    pub fn new(tracker: Box<dyn Tracker>, settings: Sam2BaselineSettings) -> Result<Self, TrackingError> {
        settings.validate()?;
        let Sam2BaselineSettings { prompts, max_detection_iou, min_area } = settings;
        let new_objects = NewObjects { prompts, max_detection_iou, min_area };
        Ok(Self { tracker, new_objects, ids: SegmentIds::default() })
    }
}

impl Method for Sam2Baseline {
    fn name(&self) -> &str {
        "sam2"
    }

    fn process(&mut self, frame: &RgbdFrame, found: &Segmentation) -> Result<FrameOutput, TrackingError> {
        check_comparable(frame, found)?;
        let stage = tracing::debug_span!(target: STAGE_TARGET, "track").entered();
        let mut tracks = self.tracker.track(frame)?;
        let new_objects = self.new_objects.among(&tracks, &found.masks);
        let live: BTreeSet<SegmentId> = tracks.iter().map(|(id, _)| *id).collect();
        let ids: Vec<SegmentId> = new_objects.iter().map(|_| self.ids.new_segment(|id| live.contains(&id))).collect();
        let unused = add_tracks(self.tracker.as_mut(), &mut tracks, &new_objects, &ids)?;
        self.ids.release(&unused);
        drop(stage);

        let _stage = tracing::debug_span!(target: STAGE_TARGET, "fuse").entered();
        let masks = visible(tracks);
        let segments = painted((frame.width(), frame.height()), &masks);
        let scores = masks.iter().map(|(id, _)| (*id, 1.0)).collect();
        Ok(FrameOutput {
            confidence: confidence(&segments, &scores, None),
            segments,
            predictions: masks.len(),
            masks,
            track_errors: TrackErrorCounts::default(),
            update: FrameUpdate::default(),
        })
    }
}
