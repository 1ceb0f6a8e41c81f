//! FastSAM-Splat: a segmenter for single frames, and a splat that remembers (`docs/METHOD.md`, "FastSAM-Splat").

use super::explained::pixel_areas;
use super::merged::keep_apart;
use super::output::confidence;
use super::protrusion::lies_in_front;
use super::{ExplanationSettings, FrameOutput, Method, check_sizes};
use crate::matching::{match_segments, painted_parts, visible_parts};
use crate::{TrackErrorCounts, TrackingError};
use splatseg_geometry::{Mask, RgbdFrame, ScoredMask, SegmentId, SegmentMap};
use splatseg_memory::{ABSTAIN, MemoryKind, MemorySettings, Recall, SplatMemory};
use splatseg_settings::{Allowed, settings};
use std::collections::BTreeSet;

settings! {
    /// Settings of [`FastSamSplat`].
    pub struct FastSamSplatSettings in "" {
        /// Predictions of fewer pixels are ignored. The paper: 0.
        min_prediction_area: usize = 50, Allowed::between(0.0, 1e9);
        /// Segments of fewer pixels are not shown: they are what is left along borders after an id was overruled. They
        /// stay in the memory. The paper: 0.
        min_output_area: usize = 50, Allowed::between(0.0, 1e9);
        /// Whether whole predictions are matched where they overlap, not what is visible of each. The paper: true.
        match_whole_masks: bool = false, Allowed::Switch;
        /// Whether an object is shown before it is seen in a second frame. The paper shows all.
        show_tentative: bool = true, Allowed::Switch;
    }
    sections {
        /// Where the memory overrules a frame; used with [`MemoryKind::Evidence`] only.
        explanation: ExplanationSettings;
        /// The memory.
        memory: MemorySettings;
    }
}

/// The method. Where predictions overlap, smaller ones cover larger ones.
pub struct FastSamSplat {
    memory: SplatMemory,
    settings: FastSamSplatSettings,
}

/// A prediction of which enough is visible.
struct VisiblePrediction<'a> {
    part: Mask,
    whole: &'a Mask,
    score: f32,
}

/// The visible predictions of a frame and their ids.
struct Identified {
    parts: Vec<Mask>,
    ids: Vec<SegmentId>,
    scores: Vec<f32>,
    /// Ids and areas of the predictions without a matching segment.
    new: Vec<(SegmentId, usize)>,
}

impl FastSamSplat {
    /// A method with an empty memory. `seed` and `progress` are for the codebook of [`MemoryKind::Features`]:
    /// `progress` receives the fraction done.
    ///
    /// # Errors
    /// If a setting is out of range.
    pub fn new(
        settings: FastSamSplatSettings,
        seed: u64,
        progress: &mut dyn FnMut(f32),
    ) -> Result<Self, TrackingError> {
        let memory = SplatMemory::new(settings.memory.clone(), seed, progress)?;
        Self::with_memory(settings, memory)
    }

    /// A method that continues with a memory from an earlier run, and so with its ids.
    ///
    /// # Errors
    /// If a setting is out of range.
    pub fn with_memory(mut settings: FastSamSplatSettings, memory: SplatMemory) -> Result<Self, TrackingError> {
        settings.validate()?;
        if memory.settings().kind == MemoryKind::Features {
            settings.explanation = ExplanationSettings::NONE;
        }
        Ok(Self { memory, settings })
    }

    /// The predictions of which enough is visible.
    fn visible<'a>(&self, frame: &RgbdFrame, masks: &'a [ScoredMask]) -> Vec<VisiblePrediction<'a>> {
        let least = self.settings.min_prediction_area.max(1);
        let (masks, scores): (Vec<&Mask>, Vec<f32>) =
            masks.iter().filter(|mask| mask.mask.area() >= least).map(|mask| (&mask.mask, mask.score)).unzip();
        let parts = visible_parts((frame.width(), frame.height()), &masks);
        let is_kept =
            |part: &Mask, whole: &Mask| part.area() >= least && self.settings.explanation.is_visible(part, whole);
        let visible = parts.into_iter().zip(masks).zip(scores).filter(|((part, whole), _)| is_kept(part, whole));
        visible.map(|((part, whole), score)| VisiblePrediction { part, whole, score }).collect()
    }

    /// Matches predictions with expected segments. Each prediction takes the id of its match, or a new one.
    fn identify(&mut self, expected: &SegmentMap, found: Vec<VisiblePrediction>) -> Result<Identified, TrackingError> {
        let whole = self.settings.match_whole_masks;
        let predictions: Vec<&Mask> = found.iter().map(|found| if whole { found.whole } else { &found.part }).collect();
        let matched = match_segments(expected, &predictions, self.settings.explanation.min_match_f_score);
        let (mut ids, mut new) = (Vec::with_capacity(found.len()), Vec::new());
        for (prediction, matched) in found.iter().zip(matched) {
            ids.push(match matched {
                Some(id) => id,
                None => {
                    let id = self.memory.new_segment()?;
                    new.push((id, prediction.part.area()));
                    id
                }
            });
        }
        let (parts, scores) = found.into_iter().map(|found| (found.part, found.score)).unzip();
        Ok(Identified { parts, ids, scores, new })
    }

    /// Fuses memory and predictions. Returns the map to show, and the map of the predictions that the memory learns.
    fn fuse(&mut self, recall: &Recall<'_>, found: &Identified) -> Result<(SegmentMap, SegmentMap), TrackingError> {
        let size = recall.expected().segments.size();
        let mut seen = painted_parts(size, found.ids.iter().copied().zip(&found.parts));
        let merged_per_apart = self.settings.explanation.merged_per_apart;
        keep_apart(&mut self.memory, recall, merged_per_apart, &mut seen)?;
        let mut shown = self.memory.fuse(recall, &seen)?;
        let mut explained = self.settings.explanation.explained(&found.new, &shown);
        if self.settings.explanation.lets_recur() {
            let map = seen.map(|id| if explained.contains(id) { *id } else { 0 });
            let (rules, depth) = (self.settings.explanation, recall.frame().depth());
            let is_new = |id, times| rules.is_new_after(times, || lies_in_front(id, &seen, &shown, depth));
            for id in self.memory.note_explained(recall, &map, &is_new)? {
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
        let maps = [&recall.expected().segments, &seen];
        let overruled = self.memory.overruled_mut();
        self.settings.explanation.drop_leftovers(overruled, &mut shown, maps, || pixel_areas(recall));
        Ok((shown.without_small(self.settings.min_output_area), seen))
    }
}

impl Method for FastSamSplat {
    fn name(&self) -> &str {
        "fastsam-splat"
    }

    fn process(&mut self, frame: &RgbdFrame, masks: &[ScoredMask]) -> Result<FrameOutput, TrackingError> {
        check_sizes(frame, masks)?;
        let recall = self.memory.recall(frame);

        let stage = tracing::debug_span!(target: "splatseg::stage", "match").entered();
        let visible = self.visible(frame, masks);
        let identified = self.identify(&recall.expected().segments, visible)?;
        drop(stage);

        let stage = tracing::debug_span!(target: "splatseg::stage", "fuse").entered();
        let (mut segments, seen) = self.fuse(&recall, &identified)?;
        let scores = identified.ids.iter().copied().zip(identified.scores).collect();
        let confidence = confidence(&segments, &scores, Some(recall.expected()));
        drop(stage);

        let update = self.memory.update(recall, &seen)?;
        if !self.settings.show_tentative {
            let ids = segments.areas().into_keys();
            let tentative: BTreeSet<SegmentId> = ids.filter(|id| self.memory.is_tentative(*id)).collect();
            segments = segments.map(|id| if tentative.contains(id) { 0 } else { *id });
        }
        Ok(FrameOutput {
            segments,
            confidence,
            masks: Vec::new(),
            predictions: identified.ids.len(),
            track_errors: TrackErrorCounts::default(),
            update,
        })
    }

    fn memory(&self) -> Option<&SplatMemory> {
        Some(&self.memory)
    }
}
