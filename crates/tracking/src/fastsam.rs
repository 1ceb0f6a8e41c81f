//! FastSAM on its own: no memory but the frame before (METHOD, "Baselines").

use crate::matching::{check_min_f_score, match_masks};
use crate::painting::painted;
use crate::segment_ids::SegmentIds;
use crate::{FrameOutput, Method, StageTimes, TrackErrorCounts, TrackingError, check_sizes};
use serde::{Deserialize, Serialize};
use splatseg_geometry::{Mask, RgbdFrame, ScoredMask, SegmentId};
use splatseg_memory::FrameUpdate;
use splatseg_segmenter::Segmenter;
use std::time::Instant;

/// Settings of [`FastSam`]. The defaults are those of the paper's evaluation.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FastSamSettings {
    /// Masks of fewer pixels are ignored. Default: 0.
    pub min_segment_area: usize,
    /// Masks of consecutive frames with a smaller F-score are not linked. Default: 0, any overlap links.
    pub min_match_f_score: f64,
}

/// The baseline without memory: every frame is segmented alone, and masks take the ids of those of the frame before
/// that they overlap.
///
/// The link is the one that the paper's evaluation makes for methods without ids (`get_tubes` in `evaluate_iVPQ.py`):
/// one-to-one, with the largest sum of F-scores, pairs without overlap undone. A mask without a partner is a new
/// segment, so whatever is missed in one frame has another id afterwards.
pub struct FastSam {
    segmenter: Box<dyn Segmenter>,
    settings: FastSamSettings,
    ids: SegmentIds,
    previous: Vec<(SegmentId, Mask)>,
}

impl FastSam {
    /// A method that has seen nothing yet.
    ///
    /// # Errors
    /// [`TrackingError::MinMatchFScore`] if that setting is out of range.
    pub fn new(segmenter: Box<dyn Segmenter>, settings: FastSamSettings) -> Result<Self, TrackingError> {
        check_min_f_score(settings.min_match_f_score)?;
        Ok(Self { segmenter, settings, ids: SegmentIds::default(), previous: Vec::new() })
    }
}

impl Method for FastSam {
    fn name(&self) -> &str {
        "fastsam"
    }

    fn segmenter(&mut self) -> &mut dyn Segmenter {
        self.segmenter.as_mut()
    }

    fn track(&mut self, frame: &RgbdFrame, masks: &[ScoredMask]) -> Result<FrameOutput, TrackingError> {
        check_sizes(frame, masks)?;
        let mut times = StageTimes::default();
        let size = (frame.width(), frame.height());

        let started = Instant::now();
        let least = self.settings.min_segment_area.max(1);
        let masks: Vec<&Mask> = masks.iter().map(|mask| &mask.mask).filter(|mask| mask.area() >= least).collect();
        // Where a video changes its size there is no overlap to speak of.
        let previous: Vec<&Mask> = self.previous.iter().map(|(_, mask)| mask).collect();
        let comparable = previous.iter().all(|mask| (mask.width(), mask.height()) == size);
        let previous = if comparable { previous } else { Vec::new() };
        let partners = match_masks(&previous, &masks, self.settings.min_match_f_score);
        times.match_segments = started.elapsed();

        let started = Instant::now();
        let mut identified = Vec::with_capacity(masks.len());
        for (mask, partner) in masks.into_iter().zip(partners) {
            let id = match partner {
                Some(partner) => self.previous[partner].0,
                None => self.ids.new_segment()?,
            };
            identified.push((id, mask.clone()));
        }
        let segments = painted(size, &identified);
        self.previous.clone_from(&identified);
        times.fuse = started.elapsed();
        let predictions = identified.len();
        Ok(FrameOutput {
            segments,
            masks: identified,
            predictions,
            track_errors: TrackErrorCounts::default(),
            update: FrameUpdate::default(),
            times,
        })
    }
}
