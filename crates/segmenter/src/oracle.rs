//! The segmenter that knows the answer: true segments with errors of known kinds and rates.
//!
//! One frame, in order: objects that are never found or too small are left out ([`OracleErrorModel`]); neighbours
//! become one mask ([`merge`]); masks fall into pieces ([`split`]); some are missed; outlines wander and masks of
//! nothing are added ([`outline`]). Every error is drawn from the seed, the frame's name and the object's id
//! ([`crate::chance`]), so a frame's masks are the same whatever was segmented before.

mod decision;
mod merge;
mod outline;
mod settings;
mod split;
mod truth;

pub use settings::{OracleErrorModel, OraclePreset, OracleSettings};
pub use truth::{GroundTruthSource, SceneGroundTruth};

use crate::chance::{Chance, FrameChance, normal, poisson};
use crate::{Segmenter, SegmenterError};
use decision::Decision;
use merge::merged;
use outline::{Wander, blob};
use rand::RngExt;
use rayon::prelude::*;
use splatseg_geometry::{Mask, RgbdFrame, ScoredMask, SegmentId, SegmentMap};
use split::split;
use std::collections::BTreeMap;

/// Score of a mask that fits no object: FastSAM's confidence threshold.
const LEAST_SCORE: f32 = 0.4;

/// A segmenter that returns the true segments, disturbed by a seeded error model, so that methods can be compared
/// without a network. Masks may overlap once their outlines wander.
///
/// Deterministic in (seed, frame name, true segments), whatever the number of threads and the order of the frames.
pub struct OracleSegmenter {
    truth: Box<dyn GroundTruthSource>,
    model: OracleErrorModel,
    chance: Chance,
}

impl OracleSegmenter {
    /// An oracle that knows `truth` and errs as `settings` say. `seed` decides where.
    ///
    /// # Errors
    /// [`SegmenterError::Setting`] if a setting is out of its range.
    pub fn new(
        truth: impl GroundTruthSource + 'static,
        settings: &OracleSettings,
        seed: u64,
    ) -> Result<Self, SegmenterError> {
        Ok(Self { truth: Box::new(truth), model: settings.resolved()?, chance: Chance { seed } })
    }

    /// The error model in use.
    pub fn error_model(&self) -> &OracleErrorModel {
        &self.model
    }
}

/// One frame, and the errors made in it.
struct ErringFrame<'a> {
    truth: &'a SegmentMap,
    model: OracleErrorModel,
    chance: FrameChance<'a>,
}

impl ErringFrame<'_> {
    fn masks(&self) -> Vec<ScoredMask> {
        let wander = Wander { sigma: self.model.boundary_jitter_px, wavelength: self.model.boundary_wavelength_px };
        let with_outline =
            |part: Part| wander.apply(part.mask, &mut self.chance.of_frame(Decision::Outline, part.id, part.number));
        let mut masks: Vec<Mask> = self.parts().into_par_iter().map(with_outline).collect();
        masks.extend(self.false_positives());
        masks.retain(|mask| mask.area() >= self.model.min_area_px.max(1));
        let areas = self.truth.areas();
        let scored = masks.into_par_iter().enumerate().map(|(number, mask)| {
            let noise = self.model.score_noise * normal(&mut self.chance.of_frame(Decision::Score, 0, number));
            let fit = best_iou(self.truth, &areas, &mask) * (1.0 - noise.abs()).max(0.0);
            ScoredMask { mask, score: LEAST_SCORE + (1.0 - LEAST_SCORE) * fit }
        });
        scored.collect()
    }

    /// What is found, with exact outlines.
    fn parts(&self) -> Vec<Part> {
        let (model, chance) = (&self.model, self.chance);
        let mut objects = Mask::of_segments(self.truth);
        objects.retain(|(id, mask)| {
            let never: f64 = chance.run.of_object(Decision::PersistentMiss, *id).random();
            mask.area() >= model.min_area_px && never >= model.persistent_miss_rate
        });
        let mut parts = Vec::new();
        for group in merged(self.truth, objects, model, chance) {
            let id = group.id;
            for (number, mask) in split(group, model, chance).into_iter().enumerate() {
                let missed: f64 = chance.of_frame(Decision::Miss, id, number).random();
                if missed >= model.miss_rate {
                    parts.push(Part { id, number, mask });
                }
            }
        }
        parts
    }

    fn false_positives(&self) -> Vec<Mask> {
        let mut random = self.chance.of_frame(Decision::FalsePositives, 0, 0);
        let count = poisson(self.model.false_positives_per_frame, &mut random);
        (0..count).map(|_| blob(self.truth.size(), self.model.false_positive_radius_px, &mut random)).collect()
    }
}

/// Something that is found: piece `number` of the object (or group of objects) `id`.
struct Part {
    id: SegmentId,
    number: usize,
    mask: Mask,
}

impl Segmenter for OracleSegmenter {
    fn name(&self) -> &str {
        "oracle"
    }

    fn segment(&mut self, frame: &RgbdFrame) -> Result<Vec<ScoredMask>, SegmenterError> {
        let truth = self.truth.ground_truth(frame)?;
        let expected = (frame.width(), frame.height());
        if truth.size() != expected {
            let (frame, found) = (frame.name().to_owned(), truth.size());
            return Err(SegmenterError::GroundTruthSize { frame, found, expected });
        }
        let chance = FrameChance { run: self.chance, frame: frame.name() };
        Ok(ErringFrame { truth: &truth, model: self.model, chance }.masks())
    }
}

/// IoU of a mask with the true object that fits it best.
fn best_iou(truth: &SegmentMap, areas: &BTreeMap<SegmentId, usize>, mask: &Mask) -> f32 {
    let mut shared: BTreeMap<SegmentId, usize> = BTreeMap::new();
    for index in mask.pixel_indices() {
        *shared.entry(truth.pixels()[index]).or_insert(0) += 1;
    }
    let area = mask.area();
    let iou = |(id, shared): (&SegmentId, &usize)| {
        areas.get(id).map_or(0.0, |object| *shared as f32 / (area + object - shared) as f32)
    };
    shared.iter().map(iou).fold(0.0, f32::max)
}
