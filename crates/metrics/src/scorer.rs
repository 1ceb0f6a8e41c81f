//! Scores a video frame by frame.

use crate::by_size::SizeAccumulator;
use crate::overlap::{FrameOverlaps, composited};
use crate::prediction::{Labels, Linkage};
use crate::stq::StqAccumulator;
use crate::tubes::TubeOfLabel;
use crate::vsq::VsqAccumulator;
use crate::{BoundaryCounts, FramePrediction, MetricsError, Protocol, RawCounts, ScoreSettings, SingleFrameCounts};
use crate::{VideoScore, WindowLength};
use splatseg_geometry::{MaskLinker, MaskRuns, SegmentId, SegmentMap};
use std::borrow::Cow;
use std::collections::BTreeMap;

/// Scores one video, a frame at a time. Only counts are kept, so memory grows with the number of overlapping tubes, not
/// with the number of frames.
#[derive(Clone, Debug)]
pub struct VideoScorer {
    settings: ScoreSettings,
    frames: usize,
    size: Option<(usize, usize)>,
    linkage: Option<Linkage>,
    linker: MaskLinker,
    vsq: VsqAccumulator,
    stq: StqAccumulator,
    by_size: SizeAccumulator,
    single_frames: SingleFrameCounts,
}

impl VideoScorer {
    /// Creates a scorer without frames.
    pub fn new(settings: ScoreSettings) -> Self {
        Self {
            settings,
            frames: 0,
            size: None,
            linkage: None,
            linker: MaskLinker::default(),
            vsq: VsqAccumulator::new(settings.protocol),
            stq: StqAccumulator::new(settings.protocol),
            by_size: SizeAccumulator::default(),
            single_frames: SingleFrameCounts::default(),
        }
    }

    /// Scores the next frame. `ground_truth` contains true ids, `[height, width]`, 0 where unlabelled. Each object
    /// keeps its id through the video. The prediction must have the same size.
    ///
    /// # Errors
    /// If sizes differ, predicted ids are invalid (see [`MetricsError`]), or predictions with and without ids are
    /// mixed. The frame is not counted then.
    pub fn push(&mut self, ground_truth: &SegmentMap, prediction: &FramePrediction) -> Result<(), MetricsError> {
        self.push_with_confidences(ground_truth, prediction, None)
    }

    /// Scores the next frame like [`Self::push`]. `confidences` contains the confidence of each segment by id, or by
    /// index plus 1 for masks without ids; the default is 0. Average precision requires confidences.
    ///
    /// # Errors
    /// As [`Self::push`].
    pub fn push_with_confidences(
        &mut self,
        ground_truth: &SegmentMap,
        prediction: &FramePrediction,
        confidences: Option<&BTreeMap<SegmentId, f32>>,
    ) -> Result<(), MetricsError> {
        let size = ground_truth.size();
        let expected = self.size.unwrap_or(size);
        if size != expected {
            return Err(MetricsError::SizeChanged { frame: self.frames, found: size, expected });
        }
        let linkage = prediction.linkage();
        if self.linkage.is_some_and(|before| before != linkage) {
            return Err(MetricsError::MixedPredictions { frame: self.frames });
        }
        let mut labels = prediction.labels(self.frames, size)?;

        if let (Linkage::Unlinked, Protocol::Paper, Labels::Masks(masks)) =
            (linkage, self.settings.protocol, &mut labels)
            && masks.is_empty()
        {
            // The paper's `collect_rle_window` replaces an empty list by one empty mask, which is a false positive.
            masks.push((1, MaskRuns::default()));
        }
        let overlaps = FrameOverlaps::count(ground_truth, &labels, &self.settings);
        self.single_frames.push(&overlaps, boundaries(ground_truth, &labels, &overlaps, &self.settings), confidences);
        // Linking is part of the prediction, so it uses the whole masks, including unlabelled pixels.
        let tube_of_label = match (linkage, labels) {
            (Linkage::Unlinked, Labels::Masks(masks)) => {
                let masks = masks.into_iter().map(|(_, runs)| runs).collect();
                TubeOfLabel::Linked(self.linker.link(masks))
            }
            _ => TubeOfLabel::Id,
        };
        self.vsq.push(&overlaps, tube_of_label);
        self.stq.push(&overlaps, tube_of_label);
        self.by_size.push(&overlaps, tube_of_label);
        self.size = Some(size);
        self.linkage = Some(linkage);
        self.frames += 1;
        Ok(())
    }

    /// Number of frames scored so far.
    pub fn frames(&self) -> usize {
        self.frames
    }

    /// Returns the score of the video.
    pub fn finish(self) -> VideoScore {
        let counts = RawCounts {
            vsq_k: WindowLength::ALL.into_iter().zip(self.vsq.finish()).collect(),
            by_size: self.by_size.finish(&self.stq.associations()),
            stq: self.stq.finish(),
            single_frames: self.single_frames,
            frames: self.frames as u64,
        };
        VideoScore::new(self.settings, counts)
    }
}

/// Counts the boundaries of a frame. True segments below the minimum area count as unlabelled.
fn boundaries(
    truth: &SegmentMap,
    labels: &Labels,
    overlaps: &FrameOverlaps,
    settings: &ScoreSettings,
) -> BoundaryCounts {
    let predicted = match labels {
        Labels::Map(map) => Cow::Borrowed(map.pixels()),
        Labels::Masks(masks) => Cow::Owned(composited(masks, truth.pixels().len())),
    };
    let truth_ids = truth.map(|id| if overlaps.truth_areas.contains_key(id) { *id } else { 0 });
    BoundaryCounts::count(truth.size().0, truth_ids.pixels(), &predicted, settings.void)
}
