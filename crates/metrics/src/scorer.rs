//! Scoring a video frame by frame.

use crate::by_size::SizeAccumulator;
use crate::overlap::FrameOverlaps;
use crate::prediction::{Labels, Linkage};
use crate::stq::StqAccumulator;
use crate::tubes::TubeOfLabel;
use crate::vsq::VsqAccumulator;
use crate::{FramePrediction, MetricsError, Protocol, RawCounts, ScoreSettings, VideoScore, WindowLength};
use splatseg_geometry::{MaskLinker, MaskRuns, SegmentMap};

/// Scores one video, a frame at a time. Frames are counted, not kept: memory grows with the number of overlapping
/// tubes, not with the number of frames.
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
}

impl VideoScorer {
    /// A video without frames yet.
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
        }
    }

    /// Scores the next frame. `ground_truth` is `[height, width]` of true ids, 0 where unlabelled; ids stay with their
    /// objects through the video. The prediction has the same size.
    ///
    /// # Errors
    /// If sizes differ, predicted ids are invalid (see [`MetricsError`]), or predictions with and without ids are mixed.
    /// Then nothing of the frame is counted.
    pub fn push(&mut self, ground_truth: &SegmentMap, prediction: &FramePrediction) -> Result<(), MetricsError> {
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
            // The paper's `collect_rle_window` replaces no masks with one empty mask, which is a false positive.
            masks.push((1, MaskRuns::default()));
        }
        let overlaps = FrameOverlaps::count(ground_truth, &labels, &self.settings);
        // Linking is part of the prediction: it uses the whole masks, unlabelled pixels included.
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
        (self.size, self.linkage) = (Some(size), Some(linkage));
        self.frames += 1;
        Ok(())
    }

    /// The number of frames scored so far.
    pub fn frames(&self) -> usize {
        self.frames
    }

    /// Ends the video.
    pub fn finish(self) -> VideoScore {
        let counts = RawCounts {
            vsq_k: WindowLength::ALL.into_iter().zip(self.vsq.finish()).collect(),
            by_size: self.by_size.finish(&self.stq.associations()),
            stq: self.stq.finish(),
            frames: self.frames as u64,
        };
        VideoScore::new(self.settings, counts)
    }
}
