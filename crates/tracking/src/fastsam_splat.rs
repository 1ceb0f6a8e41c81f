//! FastSAM-Splat: a segmenter without memory, and a splat that remembers (METHOD, "FastSAM-Splat, one frame").

use crate::explained::OverruledSegments;
use crate::matching::check_min_f_score;
use crate::painting::{painted_parts, visible_parts};
use crate::{
    ExplanationSettings, FrameOutput, Method, StageTimes, TrackErrorCounts, TrackingError, check_sizes, match_segments,
};
use serde::{Deserialize, Serialize};
use splatseg_geometry::{Mask, RgbdFrame, ScoredMask, SegmentId, SegmentMap};
use splatseg_memory::{ABSTAIN, MemoryKind, MemorySettings, Recall, SplatMemory};
use splatseg_segmenter::Segmenter;
use std::time::Instant;

/// Settings of [`FastSamSplat`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FastSamSplatSettings {
    /// Settings of the memory.
    pub memory: MemorySettings,
    /// Predicted segments of fewer pixels are ignored, and so are remembered ones in the output: what is left along
    /// borders after an id has been overruled. (They stay in the memory. Not in the paper.)
    pub min_segment_area: usize,
    /// Expected and predicted segments with a smaller F-score are no match. The paper names no minimum.
    pub min_match_f_score: f64,
    /// Whether a segment is shown before its thing was seen in a second frame. Not in the paper, which shows all.
    pub show_tentative: bool,
    /// What the memory knows better than a frame; used with [`MemoryKind::Evidence`] only.
    pub explanation: ExplanationSettings,
    /// Seed of the codebook.
    pub seed: u64,
}

impl Default for FastSamSplatSettings {
    fn default() -> Self {
        Self {
            memory: MemorySettings::default(),
            min_segment_area: 50,
            min_match_f_score: 0.0,
            show_tentative: true,
            explanation: ExplanationSettings::default(),
            seed: 0,
        }
    }
}

/// The method: feed it frames in order ([`Method::process`]), get a segment map for each.
///
/// Where predictions overlap, the smaller lie over the larger, and the visible part of each is what is matched.
///
/// It is online: the map of a frame depends on that frame and earlier ones only.
pub struct FastSamSplat {
    segmenter: Box<dyn Segmenter>,
    memory: SplatMemory,
    settings: FastSamSplatSettings,
    overruled: OverruledSegments,
}

/// The visible predictions of a frame and the ids they got.
struct Identified {
    parts: Vec<Mask>,
    ids: Vec<SegmentId>,
    /// Ids and areas of those that no remembered segment matches.
    new: Vec<(SegmentId, usize)>,
}

impl FastSamSplat {
    /// A method with an empty memory. `progress` is told the fraction of the codebook that is made, for a memory that
    /// has one.
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
        mut settings: FastSamSplatSettings,
        memory: SplatMemory,
    ) -> Result<Self, TrackingError> {
        check_min_f_score(settings.min_match_f_score)?;
        settings.explanation.validated()?;
        if memory.settings().kind == MemoryKind::Features {
            settings.explanation = ExplanationSettings::NONE;
        }
        Ok(Self { segmenter, memory, settings, overruled: OverruledSegments::default() })
    }

    /// What is visible of each prediction, where that is enough.
    fn visible(&self, frame: &RgbdFrame, masks: &[ScoredMask]) -> Vec<Mask> {
        let least = self.settings.min_segment_area.max(1);
        let masks: Vec<&Mask> = masks.iter().map(|mask| &mask.mask).filter(|mask| mask.area() >= least).collect();
        let parts = visible_parts((frame.width(), frame.height()), &masks);
        let is_kept =
            |part: &Mask, whole: &Mask| part.area() >= least && self.settings.explanation.is_visible(part, whole);
        parts.into_iter().zip(masks).filter(|(part, whole)| is_kept(part, whole)).map(|(part, _)| part).collect()
    }

    /// Matches predictions with expected segments. Each takes the matched segment's id, or a new one.
    fn identify(&mut self, expected: &SegmentMap, parts: Vec<Mask>) -> Result<Identified, TrackingError> {
        let predictions: Vec<&Mask> = parts.iter().collect();
        let matched = match_segments(expected, &predictions, self.settings.min_match_f_score);
        let (mut ids, mut new) = (Vec::with_capacity(parts.len()), Vec::new());
        for (part, matched) in parts.iter().zip(matched) {
            ids.push(match matched {
                Some(id) => id,
                None => {
                    let id = self.memory.new_segment()?;
                    new.push((id, part.area()));
                    id
                }
            });
        }
        Ok(Identified { parts, ids, new })
    }

    /// Brings memory and predictions together: the frame's output, and the ids that have a say in what is learnt.
    fn fuse(&mut self, recall: &Recall<'_>, found: &Identified) -> Result<(SegmentMap, SegmentMap), TrackingError> {
        let size = recall.expected().segments.size();
        let mut seen = painted_parts(size, found.ids.iter().copied().zip(&found.parts));
        let mut shown = self.memory.fuse(recall, &seen)?;
        let mut explained = self.settings.explanation.explained(&found.new, &shown);
        if self.settings.explanation.recurrences > 0 {
            let map = seen.map(|id| if explained.contains(id) { *id } else { 0 });
            for id in self.memory.note_explained(recall, &map, self.settings.explanation.recurrences)? {
                explained.remove(&id);
            }
        }
        if !explained.is_empty() {
            for id in seen.pixels_mut().iter_mut().filter(|id| explained.contains(id)) {
                *id = ABSTAIN;
            }
            explained.iter().for_each(|id| self.memory.take_back(*id));
            shown = self.memory.fuse(recall, &seen)?;
        }
        self.settings.explanation.drop_leftovers(&mut self.overruled, &mut shown, &recall.expected().segments, &seen);
        Ok((shown.without_small(self.settings.min_segment_area), seen))
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

        let started = Instant::now();
        let recall = self.memory.recall(frame);
        times.decode = started.elapsed().saturating_sub(recall.view_timing().total());

        let started = Instant::now();
        let parts = self.visible(frame, masks);
        let identified = self.identify(&recall.expected().segments, parts)?;
        times.match_segments = started.elapsed();

        let started = Instant::now();
        let (mut segments, seen) = self.fuse(&recall, &identified)?;
        times.fuse = started.elapsed();

        let update = self.memory.update(recall, &seen)?;
        times.take_update(&update);
        if !self.settings.show_tentative {
            segments = segments.map(|id| if self.memory.is_tentative(*id) { 0 } else { *id });
        }
        Ok(FrameOutput {
            segments,
            masks: Vec::new(),
            predictions: identified.ids.len(),
            track_errors: TrackErrorCounts::default(),
            update,
            times,
        })
    }

    fn memory(&self) -> Option<&SplatMemory> {
        Some(&self.memory)
    }
}
