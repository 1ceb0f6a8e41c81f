//! FastSAM-Splat: a segmenter for single frames with a splat memory (`docs/PAPER.md`, "FastSAM-Splat").

use super::output::confidence;
use super::{FrameOutput, Hindsight, Method, ShownFrame, check_sizes};
use crate::matching::{decided_by_regions, match_possible, match_segments, painted_parts, visible_parts};
use crate::{TrackErrorCounts, TrackingError};
use splatseg_geometry::{
    FrameAnchor, MapCorrection, Mask, RemappedId, RgbdFrame, STAGE_TARGET, ScoredMask, SegmentId, SegmentMap,
    Segmentation,
};
use splatseg_memory::{FrameUpdate, MemorySettings, Recall, SegmentBelief, SplatMemory};
use splatseg_settings::{Allowed, settings};
use std::collections::{BTreeMap, BTreeSet};

settings! {
    /// Settings of [`FastSamSplat`].
    pub struct FastSamSplatSettings in "" {
        /// Predictions with fewer pixels are ignored, and segments with fewer pixels are not shown. Of a reduced frame, see
        /// `working_pixels`, a pixel stands for more, and this is divided by the factor of its width. The paper: 0.
        min_area: usize = 50, Allowed::between(0.0, 1e9);
        /// Match whole predictions where they overlap, instead of their visible parts. The paper: true.
        match_whole_masks: bool = false, Allowed::Switch;
        /// Show objects before they are predicted in a second frame. The paper shows all.
        show_tentative: bool = true, Allowed::Switch;
        /// A prediction and a remembered segment match only if their F-score is at least this, over the pixels with an
        /// expected segment and those of new surfaces in front of the map's.
        min_match_f_score: f64 = 0.1, Allowed::between(0.0, 1.0), only "memory.kind = evidence";
        /// A prediction is ignored if smaller ones leave less than this fraction of it visible: it is a rim around
        /// other predictions of the same object.
        min_visible_fraction: f32 = 0.3, Allowed::between(0.0, 1.0), only "memory.kind = evidence";
        /// The memory contradicts a prediction that it did not expect if fusion leaves less than this fraction of it.
        /// Contradicted predictions are not shown, and their votes weigh less (`memory.contradicted_weight`).
        min_new_fraction: f32 = 0.7, Allowed::between(0.0, 1.0), only "memory.kind = evidence";
        /// Each region of the segmenter's finer cut shows one id, that of most of its pixels, if the segmenter has such
        /// regions (`affinity`). The paper: false.
        regions_decide: bool = true, Allowed::Switch, only "memory.kind = evidence";
    }
    sections {
        /// The memory.
        memory: MemorySettings;
    }
}

/// Regions of larger frames are decided by a quarter of their pixels. Of smaller frames, all pixels are needed: with a
/// quarter of them, scores of rooms fell by 0.8.
const ENOUGH_PIXELS: usize = 320 * 240;

/// Confidence of a segment of an earlier frame whose surface is gone by now: nothing can be said about it.
const GONE_CONFIDENCE: f32 = 0.5;

/// The method. Where predictions overlap, smaller ones cover larger ones.
pub struct FastSamSplat {
    memory: SplatMemory,
    settings: FastSamSplatSettings,
    /// See [`Method::set_reduction`].
    reduction: f64,
}

/// The predictions of a frame with a large enough visible part.
#[derive(Default)]
struct Predictions<'a> {
    /// Visible part of each.
    parts: Vec<Mask>,
    wholes: Vec<&'a Mask>,
    scores: Vec<f32>,
}

/// The ids of a frame's predictions.
struct Identified {
    ids: Vec<SegmentId>,
    /// Ids that the memory did not expect.
    unexpected: BTreeSet<SegmentId>,
    /// Ids of things that are at the place of others, by their colours.
    replacing: BTreeSet<SegmentId>,
}

impl FastSamSplat {
    /// Creates the method with an empty memory. `seed` and `progress` are for the codebook of `memory.kind = features`;
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

    /// Creates the method with a memory from an earlier run, continuing its ids.
    ///
    /// # Errors
    /// If a setting is out of range.
    pub fn with_memory(mut settings: FastSamSplatSettings, memory: SplatMemory) -> Result<Self, TrackingError> {
        settings.validate()?;
        if !memory.rules().judges_predictions {
            settings.min_match_f_score = 0.0;
            settings.min_visible_fraction = 0.0;
            settings.min_new_fraction = 0.0;
            settings.regions_decide = false;
        }
        Ok(Self { memory, settings, reduction: 1.0 })
    }

    /// The smallest area that counts, in pixels of the frame as it is processed. Of 640×480 reduced to 320×240, whole areas
    /// lose small things (AR of small ones 4 and 0 in two synthetic rooms; 9 and 21 so), and a quarter shows more that are
    /// none (`kitchen-dev`: VSQ 47.2; 47.6 so).
    fn min_area(&self) -> usize {
        (self.settings.min_area as f64 / self.reduction) as usize
    }

    fn visible<'a>(&self, frame: &RgbdFrame, masks: &'a [ScoredMask]) -> Predictions<'a> {
        let least = self.min_area().max(1);
        let masks: Vec<&ScoredMask> = masks.iter().filter(|mask| mask.mask.area() >= least).collect();
        let wholes: Vec<&Mask> = masks.iter().map(|mask| &mask.mask).collect();
        let parts = visible_parts((frame.width(), frame.height()), &wholes);
        let mut visible = Predictions::default();
        for ((part, whole), mask) in parts.into_iter().zip(wholes).zip(masks) {
            let share = part.area() as f32 / whole.area() as f32;
            if part.area() >= least && share >= self.settings.min_visible_fraction {
                visible.parts.push(part);
                visible.wholes.push(whole);
                visible.scores.push(mask.score);
            }
        }
        visible
    }

    /// Gives each prediction the id of the expected segment that it matches. The others are matched with the memory's
    /// second opinion, which contains ids that earlier frames also predicted there, and get new ids if that fails. A
    /// prediction whose colours are not those of a segment cannot be that segment, but may be another that has been moved.
    fn identify(&mut self, recall: &mut Recall<'_>, found: &Predictions<'_>) -> Result<Identified, TrackingError> {
        let parts: Vec<&Mask> = found.parts.iter().collect();
        let masks = if self.settings.match_whole_masks { &found.wholes } else { &parts };
        let labels = painted_parts(recall.expected().segments.size(), (1..).zip(&found.parts));
        let replacements = self.memory.find_replacements(recall, &labels);
        let label = |index: usize| index as u32 + 1;
        let known = recall.known_pixels();
        let min_f_score = self.settings.min_match_f_score;
        let expected = &recall.expected().segments;
        let mut matched = match_possible(expected, masks, min_f_score, Some(&known), |segment, index| {
            !replacements.excludes(label(index), segment)
        });
        let unmatched: Vec<usize> = (0..masks.len()).filter(|index| matched[*index].is_none()).collect();
        if !unmatched.is_empty() {
            let mut second = self.memory.second_opinion(recall);
            let mut taken: BTreeSet<SegmentId> = matched.iter().flatten().copied().collect();
            for id in second.pixels_mut().iter_mut().filter(|id| taken.contains(id)) {
                *id = 0;
            }
            let rest: Vec<&Mask> = unmatched.iter().map(|index| masks[*index]).collect();
            let again = match_possible(&second, &rest, min_f_score, Some(&known), |segment, index| {
                !replacements.excludes(label(unmatched[index]), segment)
            });
            taken.extend(again.iter().flatten());
            for (index, id) in unmatched.iter().zip(again) {
                matched[*index] = id.or_else(|| replacements.moved_here(label(*index), &taken));
                taken.extend(matched[*index]);
            }
            self.keep_unplaced_ids(masks, &mut matched);
        }
        let ids = matched.into_iter().map(|id| id.map_or_else(|| self.memory.new_segment(), Ok));
        let ids: Vec<SegmentId> = ids.collect::<Result<_, _>>()?;
        let (replacing, unexpected): (Vec<usize>, Vec<usize>) =
            unmatched.into_iter().partition(|index| replacements.has_replaced(label(*index)));
        let ids_of = |indices: Vec<usize>| indices.into_iter().map(|index| ids[index]).collect();
        let (replacing, unexpected) = (ids_of(replacing), ids_of(unexpected));
        Ok(Identified { ids, unexpected, replacing })
    }

    /// Gives masks without an id that of the previous frame, if its pose was unknown.
    fn keep_unplaced_ids(&self, masks: &[&Mask], matched: &mut [Option<SegmentId>]) {
        let size = masks.first().map(|mask| (mask.width(), mask.height()));
        let Some(unplaced) = self.memory.ids_without_pose().filter(|ids| Some(ids.size()) == size) else { return };
        let taken: BTreeSet<SegmentId> = matched.iter().flatten().copied().collect();
        let unplaced = unplaced.clone().map(|id| if taken.contains(id) { 0 } else { *id });
        let unmatched: Vec<usize> = (0..masks.len()).filter(|index| matched[*index].is_none()).collect();
        let masks: Vec<&Mask> = unmatched.iter().map(|index| masks[*index]).collect();
        let linked = match_segments(&unplaced, &masks, self.settings.min_match_f_score);
        unmatched.into_iter().zip(linked).for_each(|(index, id)| matched[index] = id);
    }

    /// Returns the segments without tentative objects, if these are not to be shown.
    fn without_tentative(&self, segments: SegmentMap) -> SegmentMap {
        if self.settings.show_tentative {
            return segments;
        }
        let ids = segments.areas().into_keys();
        let tentative: BTreeSet<SegmentId> = ids.filter(|id| self.memory.map().is_tentative(*id)).collect();
        segments.map(|id| if tentative.contains(id) { 0 } else { *id })
    }

    /// Returns the unexpected predictions that fusion leaves too little of, because the memory is sure of another
    /// segment.
    fn contradicted(
        &self,
        unexpected: &BTreeSet<SegmentId>,
        predicted: &SegmentMap,
        fused: &SegmentMap,
    ) -> BTreeSet<SegmentId> {
        let (predicted, fused) = (predicted.areas(), fused.areas());
        let is_contradicted = |id: &&SegmentId| {
            let [all, left] = [&predicted, &fused].map(|areas| areas.get(*id).copied().unwrap_or(0));
            (left as f32) < self.settings.min_new_fraction * all as f32
        };
        unexpected.iter().filter(is_contradicted).copied().collect()
    }
}

/// Returns the fused segments, with the expected ones in place of contradicted predictions.
fn without_contradicted(
    mut fused: SegmentMap,
    expected: &SegmentMap,
    contradicted: &BTreeSet<SegmentId>,
) -> SegmentMap {
    for (id, expected) in fused.pixels_mut().iter_mut().zip(expected.pixels()) {
        if contradicted.contains(id) {
            *id = *expected;
        }
    }
    fused
}

/// The confidence of each segment of an earlier frame where the map does not show it: the mean where it does, and
/// [`GONE_CONFIDENCE`] if it shows it nowhere.
fn mean_confidences(belief: &SegmentBelief, segments: &SegmentMap) -> BTreeMap<SegmentId, f32> {
    let mut sums: BTreeMap<SegmentId, (f64, u32)> = BTreeMap::new();
    let pixels = segments.pixels().iter().zip(belief.segments.pixels()).zip(belief.confidence.pixels());
    for ((id, expected), confidence) in pixels {
        let (sum, count) = sums.entry(*id).or_default();
        if id == expected {
            *sum += f64::from(confidence.min(1.0));
            *count += 1;
        }
    }
    let mean = |(sum, count): (f64, u32)| if count == 0 { GONE_CONFIDENCE } else { (sum / f64::from(count)) as f32 };
    sums.into_iter().map(|(id, sums)| (id, mean(sums))).collect()
}

impl Hindsight for FastSamSplat {
    /// The pixels show what the map shows there, and what they showed at the time where it shows nothing, or where colours say
    /// that another thing was there: those are gone by now. Each region of the segmenter's finer cut then shows one id.
    fn look_again(&self, frame: &RgbdFrame, shown: &ShownFrame) -> Result<FrameOutput, TrackingError> {
        let size = (frame.width(), frame.height());
        let images = std::iter::once(&shown.segments).chain(&shown.regions);
        if let Some(found) = images.map(SegmentMap::size).find(|found| *found != size) {
            return Err(TrackingError::MaskSize { found, expected: size });
        }
        let regions = shown.regions.as_ref().filter(|_| self.settings.regions_decide);
        let belief = match regions {
            Some(_) if size.0 * size.1 > ENOUGH_PIXELS => {
                let half = frame.halved().at(*frame.world_from_camera());
                self.memory.look_again(&half, &shown.segments.halved()).doubled(size)
            }
            _ => self.memory.look_again(frame, &shown.segments),
        };
        let mut segments = belief.segments.without_small(self.min_area());
        let pixels = segments.pixels_mut().iter_mut().zip(shown.segments.pixels());
        pixels.filter(|(id, _)| **id == 0).for_each(|(id, shown)| *id = *shown);
        if let Some(regions) = regions {
            segments = decided_by_regions(&segments, regions);
        }
        let segments = self.without_tentative(segments.without_small(self.min_area()));
        let confidence = confidence(&segments, &mean_confidences(&belief, &segments), Some(&belief));
        Ok(FrameOutput { confidence, ..FrameOutput::from_segments(segments) })
    }
}

impl Method for FastSamSplat {
    fn name(&self) -> &str {
        "fastsam-splat"
    }

    fn set_reduction(&mut self, factor: f64) {
        self.reduction = factor.max(1.0);
    }

    fn process(&mut self, frame: &RgbdFrame, segmentation: &Segmentation) -> Result<FrameOutput, TrackingError> {
        check_sizes(frame, segmentation)?;
        let mut recall = self.memory.recall(frame);

        let stage = tracing::debug_span!(target: STAGE_TARGET, "match").entered();
        let found = self.visible(frame, &segmentation.masks);
        let Identified { ids, unexpected, replacing } = self.identify(&mut recall, &found)?;
        drop(stage);

        let stage = tracing::debug_span!(target: STAGE_TARGET, "fuse").entered();
        let expected = &recall.expected().segments;
        let mut predicted = painted_parts(expected.size(), ids.iter().copied().zip(&found.parts));
        let fused = self.memory.fuse(&recall, &predicted)?;
        let mut contradicted = self.contradicted(&unexpected, &predicted, &fused);
        let mut segments = without_contradicted(fused, expected, &contradicted);
        if !replacing.is_empty() {
            let pixels = segments.pixels_mut().iter_mut().zip(predicted.pixels());
            pixels.filter(|(_, predicted)| replacing.contains(predicted)).for_each(|(id, predicted)| *id = *predicted);
        }
        if let Some(regions) = segmentation.regions.as_ref().filter(|_| self.settings.regions_decide) {
            segments = decided_by_regions(&segments, regions);
        }
        segments = segments.without_small(self.min_area());
        let scores = ids.iter().copied().zip(found.scores).collect();
        let confidence = confidence(&segments, &scores, Some(recall.expected()));
        drop(stage);

        let remapped = self.memory.remap_recognised(&segments);
        for RemappedId { from, into } in &remapped {
            contradicted.remove(from);
            predicted.pixels_mut().iter_mut().filter(|id| *id == from).for_each(|id| *id = *into);
        }
        let update = FrameUpdate {
            remapped,
            ..self.memory.update_with_affinities(recall, &predicted, &contradicted, segmentation)?
        };
        self.memory.record_shown(&segments);
        let segments = self.without_tentative(segments);
        Ok(FrameOutput {
            segments,
            confidence,
            masks: Vec::new(),
            predictions: ids.len(),
            track_errors: TrackErrorCounts::default(),
            update,
        })
    }

    fn process_without_pose(
        &mut self,
        frame: &RgbdFrame,
        segmentation: &Segmentation,
    ) -> Result<FrameOutput, TrackingError> {
        check_sizes(frame, segmentation)?;
        let found = self.visible(frame, &segmentation.masks);
        let parts: Vec<&Mask> = found.parts.iter().collect();
        let size = (frame.width(), frame.height());
        let latest = self.memory.latest_ids().filter(|latest| latest.size() == size);
        let linked = match latest {
            Some(latest) => match_segments(latest, &parts, self.settings.min_match_f_score),
            None => vec![None; parts.len()],
        };
        let ids = linked.into_iter().map(|id| id.map_or_else(|| self.memory.new_segment(), Ok));
        let ids: Vec<SegmentId> = ids.collect::<Result<_, _>>()?;
        let predicted = painted_parts(size, ids.iter().copied().zip(&found.parts));
        let update = self.memory.record_without_pose(&predicted)?;
        let segments = predicted.without_small(self.min_area());
        self.memory.record_shown(&segments);
        let scores = ids.iter().copied().zip(found.scores).collect();
        let confidence = confidence(&segments, &scores, None);
        let (predictions, track_errors) = (ids.len(), TrackErrorCounts::default());
        Ok(FrameOutput { segments, confidence, masks: Vec::new(), predictions, track_errors, update })
    }

    fn set_anchor(&mut self, anchor: &FrameAnchor) {
        self.memory.set_anchor(anchor);
    }

    fn correct_map(&mut self, correction: &MapCorrection) -> Vec<RemappedId> {
        self.memory.correct(correction)
    }

    fn merge_objects(&mut self, remapped: &[RemappedId]) {
        self.memory.merge_objects(remapped);
    }

    /// Memories of features forget in every frame that does not confirm them: at the end they know less than before.
    fn settle(&mut self) -> bool {
        self.memory.settle()
    }

    fn decide_objects(&mut self, frames: u32) {
        self.memory.decide_objects(frames);
    }

    fn keep_verdicts(&mut self) {
        self.memory.keep_verdicts();
    }

    fn recount_sightings(&mut self, id: SegmentId, before: u32, after: u32) {
        self.memory.recount_sightings(id, before, after);
    }

    fn hindsight(&self) -> Option<&dyn Hindsight> {
        self.memory.rules().judges_predictions.then_some(self as &dyn Hindsight)
    }

    fn memory(&self) -> Option<&SplatMemory> {
        Some(&self.memory)
    }
}
