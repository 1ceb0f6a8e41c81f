//! FastSAM on its own: no memory but the frame before (METHOD, "Baselines").

use crate::matching::check_min_f_score;
use crate::painting::painted;
use crate::{FrameOutput, Method, StageTimes, TrackErrorCounts, TrackingError, check_sizes};
use serde::{Deserialize, Serialize};
use splatseg_geometry::{Mask, MaskLinker, MaskRuns, RgbdFrame, ScoredMask, SegmentId};
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
/// Masks are linked by [`MaskLinker`], as the paper's evaluation does for methods without ids. A mask without a partner
/// is a new segment, so an object that is missed in one frame has another id afterwards.
pub struct FastSam {
    segmenter: Box<dyn Segmenter>,
    settings: FastSamSettings,
    linker: MaskLinker,
}

impl FastSam {
    /// A method that has seen nothing yet.
    ///
    /// # Errors
    /// [`TrackingError::MinMatchFScore`] if that setting is out of range.
    pub fn new(segmenter: Box<dyn Segmenter>, settings: FastSamSettings) -> Result<Self, TrackingError> {
        check_min_f_score(settings.min_match_f_score)?;
        let linker = MaskLinker::new(settings.min_match_f_score);
        Ok(Self { segmenter, settings, linker })
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
        let tubes = self.linker.link(masks.iter().map(|mask| MaskRuns::from_mask(mask)).collect());
        let id = |tube: &u64| SegmentId::try_from(*tube).map_err(|_| TrackingError::OutOfIds);
        let ids: Vec<SegmentId> = tubes.iter().map(id).collect::<Result<_, _>>()?;
        times.match_segments = started.elapsed();

        let started = Instant::now();
        let identified: Vec<(SegmentId, Mask)> = ids.into_iter().zip(masks.into_iter().cloned()).collect();
        let segments = painted(size, &identified);
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
