//! The oracle segmenter: true segments with errors of known kinds and rates (`docs/dev/ORACLE.md`).
//!
//! For each frame, objects that are never found or too small are left out ([`OracleErrorModel`]), neighbours are merged
//! ([`merge`]), masks are split ([`split`]), some are missed, outlines are displaced and false positives are added
//! ([`outline`]). Every error is drawn from the seed, the name of the frame and the id of the object
//! ([`crate::chance`]), so the masks of a frame do not depend on earlier frames.

mod decision;
mod merge;
mod outline;
mod settings;
mod split;

pub use settings::{OracleErrorModel, OraclePreset, OracleSettings};

use crate::{Chance, FrameChance, normal, poisson};
use crate::{GroundTruthSource, SimulatorError};
use decision::Decision;
use merge::merged;
use outline::{BoundaryJitter, blob};
use rand::RngExt;
use rayon::prelude::*;
use splatseg_geometry::{CameraFrame, Mask, ScoredMask, SegmentId, SegmentMap, Segmentation};
use splatseg_segmenter::{Segmenter, SegmenterError};
use splatseg_settings::SettingError;
use split::split;
use std::collections::BTreeMap;

/// Score of a mask that does not overlap any object: FastSAM's confidence threshold.
const LEAST_SCORE: f32 = 0.4;

/// A segmenter that returns the true segments with random errors, so that methods can be compared without a network.
/// Masks may overlap where their outlines are displaced.
///
/// The masks depend on the seed, the name of the frame and its true segments, not on the number of threads or the order
/// of the frames.
pub struct OracleSegmenter {
    truth: Box<dyn GroundTruthSource>,
    model: OracleErrorModel,
    chance: Chance,
}

impl OracleSegmenter {
    /// Creates an oracle for `truth` with the errors described by `settings`, drawn from `seed`.
    ///
    /// # Errors
    /// [`SettingError`] if a setting is out of range.
    pub fn new(
        truth: impl GroundTruthSource + 'static,
        settings: &OracleSettings,
        seed: u64,
    ) -> Result<Self, SettingError> {
        Ok(Self { truth: Box::new(truth), model: settings.resolved()?, chance: Chance { seed } })
    }

    /// The error model in use.
    pub fn error_model(&self) -> &OracleErrorModel {
        &self.model
    }
}

/// One frame and its errors.
struct FrameWithErrors<'a> {
    truth: &'a SegmentMap,
    model: OracleErrorModel,
    chance: FrameChance<'a>,
}

impl FrameWithErrors<'_> {
    fn masks(&self) -> Vec<ScoredMask> {
        let jitter =
            BoundaryJitter { sigma: self.model.boundary_jitter_px, wavelength: self.model.boundary_wavelength_px };
        let with_outline =
            |part: Part| jitter.apply(part.mask, &mut self.chance.of_frame(Decision::Outline, part.id, part.number));
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

    /// The objects and parts that are found, with exact outlines.
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

/// A part that is found, with its number within the object or group of objects `id`.
struct Part {
    id: SegmentId,
    number: usize,
    mask: Mask,
}

impl Segmenter for OracleSegmenter {
    fn name(&self) -> &str {
        "oracle"
    }

    fn segment(&mut self, frame: &CameraFrame) -> Result<Segmentation, SegmenterError> {
        let truth = self.truth.ground_truth(frame)?;
        SimulatorError::check_size(frame, truth.size())?;
        let chance = FrameChance { run: self.chance, frame: frame.name() };
        Ok(FrameWithErrors { truth: &truth, model: self.model, chance }.masks().into())
    }
}

/// IoU of a mask with the best-fitting true object.
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
