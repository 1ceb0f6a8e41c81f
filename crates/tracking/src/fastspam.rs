//! FastSPAM: a point for every segment is the memory (METHOD, "Baselines"; `opipari/FastSPAM`,
//! `evaluate_selfprompting_fix.py`).

use crate::painting::painted;
use crate::segment_ids::SegmentIds;
use crate::{FrameOutput, Method, StageTimes, TrackErrorCounts, TrackingError, check_sizes};
use glam::{Vec2, Vec3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use splatseg_geometry::{Mask, RgbdFrame, ScoredMask, SegmentId};
use splatseg_memory::FrameUpdate;
use splatseg_models::fastsam::masks_at;
use splatseg_segmenter::Segmenter;
use std::cmp::Reverse;
use std::time::Instant;

/// Settings of [`FastSpam`]. The defaults are the authors'.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FastSpamSettings {
    /// Masks of fewer pixels are ignored. Default: 0.
    pub min_segment_area: usize,
    /// A prompted mask with at least this IoU with an earlier one is united with it. In (0, 1]. Default: 0.9.
    pub agreement_iou: f64,
    /// Masks of which at least this share is covered by prompted ones are nothing new. In (0, 1]. Default: 0.9.
    pub covered_share: f64,
    /// Seed of the choice of pixels of masks whose centroid lies outside them.
    pub seed: u64,
}

impl Default for FastSpamSettings {
    fn default() -> Self {
        Self { min_segment_area: 0, agreement_iou: 0.9, covered_share: 0.9, seed: 0 }
    }
}

/// The baseline that remembers one point of every segment and prompts the next frame's masks with it.
///
/// - **Point**: the pixel at the mask's centroid, or a random pixel of the mask if that one is not in it. It is lifted
///   to the world with its own frame's depth and pose. A point without depth cannot be lifted and is dropped (the
///   authors' data is complete).
/// - **Next frame**: the point is projected; outside the image or behind the camera it is dropped. Whether something
///   hides it is not checked, as in the authors' code.
/// - **Prompt**: a point stands for the **union of all masks that contain it** (`FastSAMPrompt.point_prompt` of
///   CASIA-IVA-Lab/FastSAM, which the authors call; Ultralytics' predictor returns the same masks, not united). A
///   point on no mask gives an empty one; with it the segment is forgotten.
/// - **Frames without points** (the first, or all are dropped): every mask is a segment.
/// - **Ids**: the authors' program stores masks without ids and leaves their linking to the evaluation. Here a point's
///   segment keeps its id; a prompted mask that is united with an earlier one takes the earlier id; new ones are new.
pub struct FastSpam {
    segmenter: Box<dyn Segmenter>,
    settings: FastSpamSettings,
    random: ChaCha8Rng,
    ids: SegmentIds,
    /// A point of each segment of the frame before, world coordinates in metres; larger segments first.
    points_world: Vec<(SegmentId, Vec3)>,
}

impl FastSpam {
    /// A method that has seen nothing yet.
    ///
    /// # Errors
    /// [`TrackingError::Share`] names a setting that is out of range.
    pub fn new(segmenter: Box<dyn Segmenter>, settings: FastSpamSettings) -> Result<Self, TrackingError> {
        for (field, found) in [("agreement_iou", settings.agreement_iou), ("covered_share", settings.covered_share)] {
            if !(found > 0.0 && found <= 1.0) {
                return Err(TrackingError::Share { field, found });
            }
        }
        let random = ChaCha8Rng::seed_from_u64(settings.seed);
        Ok(Self { segmenter, settings, random, ids: SegmentIds::default(), points_world: Vec::new() })
    }

    /// Where the remembered points appear in `frame`, as (column, row); without those outside.
    fn projected_points(&self, frame: &RgbdFrame) -> Vec<(SegmentId, (usize, usize))> {
        let project = |point_world: Vec3| {
            let pixel = frame.intrinsics().project(frame.world_from_camera().to_camera(point_world))?.round();
            let last = Vec2::new(frame.width() as f32 - 1.0, frame.height() as f32 - 1.0);
            let inside = pixel.cmpge(Vec2::ZERO).all() && pixel.cmple(last).all();
            inside.then_some((pixel.x as usize, pixel.y as usize))
        };
        self.points_world.iter().filter_map(|(id, point)| Some((*id, project(*point)?))).collect()
    }

    /// The segments that points pick among `masks` (larger ones first), and what they leave over.
    fn prompted(
        &mut self,
        masks: &[&Mask],
        points: &[(SegmentId, (usize, usize))],
    ) -> Result<Vec<(SegmentId, Mask)>, TrackingError> {
        let mut segments: Vec<(SegmentId, Mask)> = Vec::new();
        for (id, point) in points {
            if let Some(mask) = self.unless_united(&mut segments, point_prompt(masks, *point)) {
                segments.push((*id, mask));
            }
        }
        let Some(mut covered) = masks.first().map(|mask| Mask::empty(mask.width(), mask.height())) else {
            return Ok(segments);
        };
        segments.iter().for_each(|(_, mask)| covered.unite(mask));
        let is_new = |mask: &&&Mask| {
            (mask.intersection_area(&covered) as f64) < self.settings.covered_share * mask.area() as f64
        };
        let new_masks: Vec<&Mask> = masks.iter().filter(is_new).copied().collect();
        for new_mask in new_masks {
            let Some(point) = self.point_of(new_mask) else { continue };
            if let Some(mask) = self.unless_united(&mut segments, point_prompt(masks, point)) {
                segments.push((self.ids.new_segment()?, mask));
            }
        }
        Ok(segments)
    }

    /// The prompted mask back if it is a segment of its own: if it agrees with an earlier one they are united, and if
    /// the point was on no mask there is none.
    fn unless_united(&self, segments: &mut [(SegmentId, Mask)], prompted: Option<Mask>) -> Option<Mask> {
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

    /// The pixel (column, row) that stands for a mask; `None` if it is empty.
    fn point_of(&mut self, mask: &Mask) -> Option<(usize, usize)> {
        let (column, row) = mask.centroid()?;
        // The mean of pixels of the image, rounded, is a pixel of the image.
        let pixel = (column.round() as usize, row.round() as usize);
        if mask.contains(pixel.0, pixel.1) {
            return Some(pixel);
        }
        let chosen = self.random.random_range(0..mask.area());
        mask.pixel_indices().nth(chosen).map(|index| (index % mask.width(), index / mask.width()))
    }
}

impl Method for FastSpam {
    fn name(&self) -> &str {
        "fastspam"
    }

    fn segmenter(&mut self) -> &mut dyn Segmenter {
        self.segmenter.as_mut()
    }

    fn track(&mut self, frame: &RgbdFrame, masks: &[ScoredMask]) -> Result<FrameOutput, TrackingError> {
        check_sizes(frame, masks)?;
        let mut times = StageTimes::default();

        let started = Instant::now();
        let least = self.settings.min_segment_area.max(1);
        let mut masks: Vec<&Mask> = masks.iter().map(|mask| &mask.mask).filter(|mask| mask.area() >= least).collect();
        masks.sort_by_key(|mask| Reverse(mask.area()));
        let points = self.projected_points(frame);
        let mut segments = if points.is_empty() {
            let mut all = Vec::with_capacity(masks.len());
            for mask in masks {
                all.push((self.ids.new_segment()?, mask.clone()));
            }
            all
        } else {
            self.prompted(&masks, &points)?
        };
        segments.retain(|(_, mask)| !mask.is_empty());
        segments.sort_by_key(|(_, mask)| Reverse(mask.area()));
        self.points_world =
            segments.iter().filter_map(|(id, mask)| Some((*id, lifted(frame, self.point_of(mask)?)?))).collect();
        times.match_segments = started.elapsed();

        let started = Instant::now();
        let map = painted((frame.width(), frame.height()), &segments);
        times.fuse = started.elapsed();
        let predictions = segments.len();
        Ok(FrameOutput {
            segments: map,
            masks: segments,
            predictions,
            track_errors: TrackErrorCounts::default(),
            update: FrameUpdate::default(),
            times,
        })
    }
}

/// All masks that contain the pixel, united; `None` if there are none.
fn point_prompt(masks: &[&Mask], pixel: (usize, usize)) -> Option<Mask> {
    let mut containing = masks_at(masks, pixel);
    let mut union = masks[containing.next()?].clone();
    containing.for_each(|index| union.unite(masks[index]));
    Some(union)
}

/// What the frame sees at a pixel, world coordinates in metres; `None` where depth is missing.
fn lifted(frame: &RgbdFrame, (column, row): (usize, usize)) -> Option<Vec3> {
    let depth = frame.depth()[(column, row)];
    let pixel = Vec2::new(column as f32, row as f32);
    (depth > 0.0).then(|| frame.world_from_camera().to_world(frame.intrinsics().unproject(pixel, depth)))
}
