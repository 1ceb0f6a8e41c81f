//! FastSAM on its own: the only memory is the previous frame (`docs/PAPER.md`, "Baselines").

use super::output::confidence;
use super::{FrameOutput, Method, check_comparable};
use crate::matching::painted;
use crate::{TrackErrorCounts, TrackingError};
use splatseg_geometry::{MAX_SEGMENT_ID, Mask, MaskLinker, MaskRuns, RgbdFrame, STAGE_TARGET, SegmentId, Segmentation};
use splatseg_memory::FrameUpdate;
use splatseg_settings::{Allowed, settings};

settings! {
    /// Settings of [`FastSamBaseline`].
    pub struct FastSamBaselineSettings in "" {
        /// Predicted segments with fewer pixels are ignored. The paper: 0.
        min_area: usize = 50, Allowed::between(0.0, 1e9);
        /// Masks of consecutive frames with a smaller F-score are not linked. The paper: 0, so any overlap links.
        min_match_f_score: f64 = 0.0, Allowed::between(0.0, 1.0);
    }
}

/// The baseline without memory: every frame is segmented alone, and a mask gets the id of the mask in the previous
/// frame that it overlaps.
///
/// Masks are linked by [`MaskLinker`], as the paper's evaluation does for methods without ids. A mask without a partner
/// is a new segment, so an object that is missed in one frame gets another id afterwards.
pub struct FastSamBaseline {
    settings: FastSamBaselineSettings,
    linker: MaskLinker,
}

impl FastSamBaseline {
    /// Creates the method.
    ///
    /// # Errors
    /// If a setting is out of range.
    pub fn new(settings: FastSamBaselineSettings) -> Result<Self, TrackingError> {
        let settings = settings.validated()?;
        let linker = MaskLinker::new(settings.min_match_f_score);
        Ok(Self { settings, linker })
    }
}

impl Method for FastSamBaseline {
    fn name(&self) -> &str {
        "fastsam"
    }

    fn process(&mut self, frame: &RgbdFrame, found: &Segmentation) -> Result<FrameOutput, TrackingError> {
        check_comparable(frame, found)?;
        let size = (frame.width(), frame.height());
        let least = self.settings.min_area.max(1);
        let (masks, scores): (Vec<&Mask>, Vec<f32>) =
            found.masks.iter().filter(|mask| mask.mask.area() >= least).map(|mask| (&mask.mask, mask.score)).unzip();

        let stage = tracing::debug_span!(target: STAGE_TARGET, "match").entered();
        let tubes = self.linker.link(masks.iter().map(|mask| MaskRuns::from_mask(mask)).collect());
        // Ids restart from 1 after the largest. No tube is expected to last until then.
        let id = |tube: &u64| (tube.saturating_sub(1) % u64::from(MAX_SEGMENT_ID)) as SegmentId + 1;
        let ids: Vec<SegmentId> = tubes.iter().map(id).collect();
        drop(stage);

        let _stage = tracing::debug_span!(target: STAGE_TARGET, "fuse").entered();
        let identified: Vec<(SegmentId, Mask)> = ids.into_iter().zip(masks.into_iter().cloned()).collect();
        let segments = painted(size, &identified);
        let scores = identified.iter().map(|(id, _)| *id).zip(scores).collect();
        Ok(FrameOutput {
            confidence: confidence(&segments, &scores, None),
            segments,
            predictions: identified.len(),
            masks: identified,
            track_errors: TrackErrorCounts::default(),
            update: FrameUpdate::default(),
        })
    }
}
