//! FastSAM-Splat: a segmenter without memory, and a splat that remembers (METHOD, "FastSAM-Splat, one frame").

use crate::matching::check_min_f_score;
use crate::painting::visible_parts;
use crate::{FrameOutput, Method, StageTimes, TrackErrorCounts, TrackingError, check_sizes, fuse, match_segments};
use serde::{Deserialize, Serialize};
use splatseg_geometry::{Mask, RgbdFrame, ScoredMask, SegmentId};
use splatseg_memory::{MemorySettings, SplatMemory};
use splatseg_segmenter::Segmenter;
use std::time::Instant;

/// Settings of [`FastSamSplat`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FastSamSplatSettings {
    /// Settings of the memory.
    pub memory: MemorySettings,
    /// Predicted segments of fewer pixels are ignored, and so are remembered ones in the output: the rests that remain
    /// along borders after an id has been overruled. (They stay in the memory. Not in the paper.)
    pub min_segment_area: usize,
    /// Expected and predicted segments with a smaller F-score are no match. The paper names no minimum.
    pub min_match_f_score: f64,
    /// Seed of the codebook.
    pub seed: u64,
}

impl Default for FastSamSplatSettings {
    fn default() -> Self {
        Self { memory: MemorySettings::default(), min_segment_area: 50, min_match_f_score: 0.0, seed: 0 }
    }
}

/// The method: feed it frames in order ([`Method::process`]), get a segment map for each.
///
/// Where predictions overlap, the smaller lie over the larger, and what is to be seen of each is what is matched.
///
/// It is online: the map of a frame depends on that frame and earlier ones only.
pub struct FastSamSplat {
    segmenter: Box<dyn Segmenter>,
    memory: SplatMemory,
    settings: FastSamSplatSettings,
}

impl FastSamSplat {
    /// A method with an empty memory. `progress` is told the fraction of the codebook that is made (up to seconds).
    ///
    /// # Errors
    /// If a setting is out of range.
    pub fn new(
        segmenter: Box<dyn Segmenter>,
        settings: FastSamSplatSettings,
        progress: &mut dyn FnMut(f32),
    ) -> Result<Self, TrackingError> {
        let memory = SplatMemory::new(settings.memory.clone(), settings.seed, progress)?;
        Self::with_memory(segmenter, settings, memory)
    }

    /// A method that continues with a memory from an earlier run, and so with its ids.
    ///
    /// # Errors
    /// If a setting is out of range.
    pub fn with_memory(
        segmenter: Box<dyn Segmenter>,
        settings: FastSamSplatSettings,
        memory: SplatMemory,
    ) -> Result<Self, TrackingError> {
        check_min_f_score(settings.min_match_f_score)?;
        Ok(Self { segmenter, memory, settings })
    }

    /// The matched segment's id for each prediction, or a new one.
    fn identify(&mut self, matched: &[Option<SegmentId>]) -> Result<Vec<SegmentId>, TrackingError> {
        matched
            .iter()
            .map(|segment| match segment {
                Some(segment) => Ok(*segment),
                None => Ok(self.memory.new_segment()?),
            })
            .collect()
    }
}

impl Method for FastSamSplat {
    fn name(&self) -> &str {
        "fastsam-splat"
    }

    fn segmenter(&mut self) -> &mut dyn Segmenter {
        self.segmenter.as_mut()
    }

    fn track(&mut self, frame: &RgbdFrame, masks: &[ScoredMask]) -> Result<FrameOutput, TrackingError> {
        check_sizes(frame, masks)?;
        let mut times = StageTimes::default();

        let view = self.memory.view(frame);
        let started = Instant::now();
        let expected = self.memory.expect(&view);
        times.decode = started.elapsed();

        let started = Instant::now();
        // Copies of a mask would otherwise take the remembered id from each other and then hide each other.
        let least = self.settings.min_segment_area.max(1);
        let masks: Vec<&Mask> = masks.iter().map(|mask| &mask.mask).filter(|mask| mask.area() >= least).collect();
        let mut parts = visible_parts((frame.width(), frame.height()), &masks);
        parts.retain(|part| part.area() >= least);
        let predictions: Vec<&Mask> = parts.iter().collect();
        let matched = match_segments(&expected.belief.segments, &predictions, self.settings.min_match_f_score);
        times.match_segments = started.elapsed();

        let started = Instant::now();
        let ids = self.identify(&matched)?;
        let identified: Vec<(SegmentId, &Mask)> = ids.into_iter().zip(predictions).collect();
        let fused = fuse(&expected.belief, &identified, self.settings.memory.confidence_decay);
        let decoded = fused.decoded(self.settings.memory.decode_threshold);
        let segments = decoded.without_small(self.settings.min_segment_area);
        times.fuse = started.elapsed();

        let update = self.memory.learn_frame(frame, view, &expected, &fused)?;
        times.project_and_bin = update.view_time.project;
        times.rasterise = update.view_time.rasterise;
        times.grow = update.grow_time;
        times.learn = update.learn_time;
        Ok(FrameOutput {
            segments,
            masks: Vec::new(),
            predictions: identified.len(),
            track_errors: TrackErrorCounts::default(),
            update,
            times,
        })
    }

    fn memory(&self) -> Option<&SplatMemory> {
        Some(&self.memory)
    }
}
