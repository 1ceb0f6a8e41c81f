//! FastSPAM: the memory is one point per segment (`docs/PAPER.md`, "Baselines"; `evaluate_selfprompting_fix.py` of
//! `opipari/FastSPAM`).

use super::output::confidence;
use super::{FrameOutput, Method, SegmentIds, check_comparable};
use crate::matching::painted;
use crate::{TrackErrorCounts, TrackingError};
use glam::{DVec3, Vec2};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use splatseg_geometry::{Mask, RgbdFrame, STAGE_TARGET, ScoredMask, SegmentId, Segmentation};
use splatseg_memory::FrameUpdate;
use splatseg_models::fastsam::masks_at;
use splatseg_settings::{Allowed, settings};
use std::cmp::Reverse;

settings! {
    /// Settings of [`FastSpamBaseline`].
    pub struct FastSpamBaselineSettings in "" {
        /// Predicted segments with fewer pixels are ignored. The authors' code: 0.
        min_area: usize = 50, Allowed::between(0.0, 1e9);
        /// A prompted mask whose IoU with an earlier one is at least this is merged with it. The authors' code: 0.9.
        agreement_iou: f64 = 0.9, Allowed::above_up_to(0.0, 1.0);
        /// A mask is new only if prompted masks cover less than this fraction of it. The authors' code: 0.9.
        covered_fraction: f64 = 0.9, Allowed::above_up_to(0.0, 1.0);
    }
}

/// The baseline that remembers a point of every segment and prompts the next frame's masks with it.
///
/// - **Point**: the pixel at the mask's centroid, or a random pixel of the mask if the centroid is outside it. It is
///   unprojected to world coordinates with the depth and pose of its own frame. A point without depth is dropped (the
///   authors' data has depth everywhere).
/// - **Next frame**: the point is projected into it, and dropped if it is outside the image or behind the camera.
///   Occlusion is not checked, as in the authors' code.
/// - **Prompt**: a point stands for the **union of all masks that contain it** (`FastSAMPrompt.point_prompt` of
///   CASIA-IVA-Lab/FastSAM, which the authors call; Ultralytics' predictor returns the same masks separately). If no
///   mask contains the point, the segment is forgotten.
/// - **Frames without points** (the first one, or all points were dropped): every mask is a segment.
/// - **Ids**: the authors' program stores masks without ids and leaves linking to the evaluation. Here the segment of a
///   point keeps its id; a prompted mask that is merged with an earlier one takes the earlier id; new masks get new
///   ids.
pub struct FastSpamBaseline {
    settings: FastSpamBaselineSettings,
    random: ChaCha8Rng,
    ids: SegmentIds,
    /// A point of each segment of the previous frame, world coordinates in metres; larger segments first.
    points_world: Vec<(SegmentId, DVec3)>,
}

impl FastSpamBaseline {
    /// Creates the method. `seed` is for the random pixels of masks whose centroid lies outside them.
    ///
    /// # Errors
    /// If a setting is out of range.
    pub fn new(settings: FastSpamBaselineSettings, seed: u64) -> Result<Self, TrackingError> {
        let random = ChaCha8Rng::seed_from_u64(seed);
        Ok(Self { settings: settings.validated()?, random, ids: SegmentIds::default(), points_world: Vec::new() })
    }

    /// Returns the pixels (column, row) at which the remembered points appear in `frame`, except points outside the
    /// image.
    fn projected_points(&self, frame: &RgbdFrame) -> Vec<(SegmentId, (usize, usize))> {
        let project = |point_world: DVec3| {
            let pixel = frame.intrinsics().project(frame.world_from_camera().to_camera(point_world))?.round();
            let last = Vec2::new(frame.width() as f32 - 1.0, frame.height() as f32 - 1.0);
            let inside = pixel.cmpge(Vec2::ZERO).all() && pixel.cmple(last).all();
            inside.then_some((pixel.x as usize, pixel.y as usize))
        };
        self.points_world.iter().filter_map(|(id, point)| Some((*id, project(*point)?))).collect()
    }

    /// Returns the segments that points select from `masks` (larger ones first), and new segments from the remaining
    /// masks.
    fn prompted(&mut self, masks: &[&Mask], points: &[(SegmentId, (usize, usize))]) -> Vec<(SegmentId, Mask)> {
        let mut segments: Vec<(SegmentId, Mask)> = Vec::new();
        for (id, point) in points {
            if let Some(mask) = self.merge_if_agreeing(&mut segments, point_prompt(masks, *point)) {
                segments.push((*id, mask));
            }
        }
        let Some(mut covered) = masks.first().map(|mask| Mask::empty(mask.width(), mask.height())) else {
            return segments;
        };
        segments.iter().for_each(|(_, mask)| covered.unite(mask));
        let is_new = |mask: &&&Mask| {
            (mask.intersection_area(&covered) as f64) < self.settings.covered_fraction * mask.area() as f64
        };
        let new_masks: Vec<&Mask> = masks.iter().filter(is_new).copied().collect();
        for new_mask in new_masks {
            let Some(point) = self.point_of(new_mask) else { continue };
            if let Some(mask) = self.merge_if_agreeing(&mut segments, point_prompt(masks, point)) {
                let id = self.ids.new_segment(|id| is_live(&segments, id));
                segments.push((id, mask));
            }
        }
        segments
    }

    /// Merges a prompted mask into the segment with which it agrees and returns `None`, also if there is no mask.
    /// Returns the mask if it agrees with no segment.
    fn merge_if_agreeing(&self, segments: &mut [(SegmentId, Mask)], prompted: Option<Mask>) -> Option<Mask> {
        let prompted = prompted?;
        let mut closest: Option<(f64, &mut Mask)> = None;
        for (_, mask) in segments {
            let iou = mask.iou(&prompted);
            if closest.as_ref().is_none_or(|(highest, _)| iou > *highest) {
                closest = Some((iou, mask));
            }
        }
        match closest {
            Some((iou, mask)) if iou >= self.settings.agreement_iou => {
                mask.unite(&prompted);
                None
            }
            _ => Some(prompted),
        }
    }

    /// Returns the pixel (column, row) that represents a mask; `None` for an empty mask.
    fn point_of(&mut self, mask: &Mask) -> Option<(usize, usize)> {
        let (column, row) = mask.centroid()?;
        // The rounded mean of pixels of the image is a pixel of the image.
        let pixel = (column.round() as usize, row.round() as usize);
        if mask.contains(pixel.0, pixel.1) {
            return Some(pixel);
        }
        let chosen = self.random.random_range(0..mask.area());
        mask.pixel_indices().nth(chosen).map(|index| (index % mask.width(), index / mask.width()))
    }
}

impl Method for FastSpamBaseline {
    fn name(&self) -> &str {
        "fastspam"
    }

    fn process(&mut self, frame: &RgbdFrame, found: &Segmentation) -> Result<FrameOutput, TrackingError> {
        check_comparable(frame, found)?;
        let scored = &found.masks;
        let stage = tracing::debug_span!(target: STAGE_TARGET, "match").entered();
        let least = self.settings.min_area.max(1);
        let mut masks: Vec<&Mask> = scored.iter().map(|mask| &mask.mask).filter(|mask| mask.area() >= least).collect();
        masks.sort_by_key(|mask| Reverse(mask.area()));
        let points = self.projected_points(frame);
        let mut segments = if points.is_empty() {
            let mut all = Vec::with_capacity(masks.len());
            for mask in masks {
                let id = self.ids.new_segment(|id| is_live(&all, id));
                all.push((id, mask.clone()));
            }
            all
        } else {
            self.prompted(&masks, &points)
        };
        segments.retain(|(_, mask)| !mask.is_empty());
        segments.sort_by_key(|(_, mask)| Reverse(mask.area()));
        self.points_world =
            segments.iter().filter_map(|(id, mask)| Some((*id, unprojected(frame, self.point_of(mask)?)?))).collect();
        drop(stage);

        let _stage = tracing::debug_span!(target: STAGE_TARGET, "fuse").entered();
        let map = painted((frame.width(), frame.height()), &segments);
        let scores = segments.iter().map(|(id, mask)| (*id, score_of(mask, scored))).collect();
        Ok(FrameOutput {
            confidence: confidence(&map, &scores, None),
            segments: map,
            predictions: segments.len(),
            masks: segments,
            track_errors: TrackErrorCounts::default(),
            update: FrameUpdate::default(),
        })
    }
}

/// True if a segment of the frame has this id. Other ids are not remembered.
fn is_live(segments: &[(SegmentId, Mask)], id: SegmentId) -> bool {
    segments.iter().any(|(live, _)| *live == id)
}

/// Returns the score of the prediction with the largest overlap with a segment.
fn score_of(segment: &Mask, predictions: &[ScoredMask]) -> f32 {
    let overlap = |found: &&ScoredMask| found.mask.intersection_area(segment);
    predictions.iter().max_by_key(overlap).map_or(0.0, |found| found.score)
}

/// Returns the union of all masks that contain the pixel; `None` if there are none.
fn point_prompt(masks: &[&Mask], pixel: (usize, usize)) -> Option<Mask> {
    let mut containing = masks_at(masks, pixel);
    let mut union = masks[containing.next()?].clone();
    containing.for_each(|index| union.unite(masks[index]));
    Some(union)
}

/// Returns the point that the frame shows at a pixel, world coordinates in metres; `None` where depth is missing.
fn unprojected(frame: &RgbdFrame, (column, row): (usize, usize)) -> Option<DVec3> {
    let depth = frame.depth()[(column, row)];
    let pixel = Vec2::new(column as f32, row as f32);
    (depth > 0.0).then(|| frame.world_from_camera().to_world(frame.intrinsics().unproject(pixel, depth)))
}
