//! SAM2 on its own: a tracker, and detections that become its tracks (METHOD, "Baselines").

use crate::painting::painted;
use crate::segment_ids::SegmentIds;
use crate::track_masks::{add_tracks, visible};
use crate::{
    FrameOutput, Method, NewObjectSettings, StageTimes, TrackErrorCounts, Tracker, TrackingError, check_sizes,
};
use splatseg_geometry::{RgbdFrame, ScoredMask};
use splatseg_memory::FrameUpdate;
use splatseg_segmenter::Segmenter;
use std::time::Instant;

/// The baseline whose only memory is the tracker's: detections of the first frame are mask prompts, and so are later
/// ones that lie on no track ([`NewObjectSettings`]). Ids are those of the tracks.
pub struct Sam2Baseline {
    segmenter: Box<dyn Segmenter>,
    tracker: Box<dyn Tracker>,
    settings: NewObjectSettings,
    ids: SegmentIds,
}

impl Sam2Baseline {
    /// A method before its first frame, over a tracker before its first frame.
    ///
    /// # Errors
    /// [`TrackingError::Setting`] if a setting is out of range.
    pub fn new(
        segmenter: Box<dyn Segmenter>,
        tracker: Box<dyn Tracker>,
        settings: NewObjectSettings,
    ) -> Result<Self, TrackingError> {
        Ok(Self { segmenter, tracker, settings: settings.validated()?, ids: SegmentIds::default() })
    }
}

impl Method for Sam2Baseline {
    fn name(&self) -> &str {
        "sam2"
    }

    fn segmenter(&mut self) -> &mut dyn Segmenter {
        self.segmenter.as_mut()
    }

    fn track(&mut self, frame: &RgbdFrame, masks: &[ScoredMask]) -> Result<FrameOutput, TrackingError> {
        check_sizes(frame, masks)?;
        let mut times = StageTimes::default();

        let started = Instant::now();
        let mut tracks = self.tracker.track(frame)?;
        let new_objects = self.settings.new_objects(&tracks, masks);
        add_tracks(self.tracker.as_mut(), &mut tracks, &new_objects, || self.ids.new_segment())?;
        times.track = started.elapsed();

        let started = Instant::now();
        let masks = visible(tracks);
        let segments = painted((frame.width(), frame.height()), &masks);
        times.fuse = started.elapsed();
        let predictions = masks.len();
        let update = FrameUpdate::default();
        Ok(FrameOutput { segments, masks, predictions, track_errors: TrackErrorCounts::default(), update, times })
    }
}
