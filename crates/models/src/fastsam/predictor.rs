//! The predictor: from an image to objects.

use super::letterbox::{input_values, letterbox};
use super::masks::{image_masks, input_mask_in_image, input_masks};
use super::{
    Candidates, Detection, FastSamConfig, FastSamError, FastSamNetwork, FastSamPredictorSettings, Placement, Prototypes,
};
use crate::checkpoint::Checkpoint;
use burn::tensor::Device;
use splatseg_geometry::{CowImage, Mask};
use std::path::Path;

/// FastSAM, like Ultralytics 8.4's `FastSAM(…).predict`.
#[derive(Clone, Debug)]
pub struct FastSamPredictor {
    network: FastSamNetwork,
    settings: FastSamPredictorSettings,
}

impl FastSamPredictor {
    /// Loads the network from a checkpoint: Ultralytics' `.pt`, or a `.safetensors` with the same tensors.
    ///
    /// # Errors
    /// [`FastSamError::Setting`] if a setting is invalid; [`FastSamError::Checkpoint`] or [`FastSamError::NotFastSam`]
    /// if the file cannot be used.
    pub fn open(path: &Path, settings: FastSamPredictorSettings, device: &Device) -> Result<Self, FastSamError> {
        let settings = settings.validated()?;
        let checkpoint = Checkpoint::open(path)?;
        let config = FastSamConfig::from_checkpoint(&checkpoint)?;
        Ok(Self { network: FastSamNetwork::load(&checkpoint, config, device)?, settings })
    }

    /// Creates a predictor from a loaded network.
    ///
    /// # Errors
    /// [`FastSamError::Setting`] if a setting is invalid.
    pub fn new(network: FastSamNetwork, settings: FastSamPredictorSettings) -> Result<Self, FastSamError> {
        Ok(Self { network, settings: settings.validated()? })
    }

    /// Segments an sRGB image into objects, best first. Masks have the image's size and are not empty.
    ///
    /// # Errors
    /// [`FastSamError::Device`] if the device fails; [`FastSamError::EmptyImage`] if the image has no pixels.
    pub fn predict(&self, image: &CowImage<'_, [u8; 3]>) -> Result<Vec<Detection>, FastSamError> {
        if image.pixels().is_empty() {
            return Err(FastSamError::EmptyImage);
        }
        let input = letterbox(image, self.settings.image_size);
        let placement = Placement { image: image.size(), input: input.size() };
        let output = self.network.forward(input_values(&input), input.height(), input.width())?;
        let candidates = output.candidates(self.settings.confidence);
        let mut detections = detections(&candidates, output.prototypes(), placement, &self.settings);
        if !self.settings.retina_masks {
            detections.iter_mut().for_each(|found| found.mask = input_mask_in_image(&found.mask, placement));
            detections.retain(|found| !found.mask.is_empty());
        }
        Ok(detections)
    }
}

/// Computes detections from the network's output: NMS, masks and boxes. Masks have the image's size, or the input's
/// size without `retina_masks`. Detections with an empty mask are dropped.
pub fn detections(
    candidates: &Candidates,
    prototypes: &Prototypes,
    placement: Placement,
    settings: &FastSamPredictorSettings,
) -> Vec<Detection> {
    let kept = candidates.nms(settings.confidence, settings.iou, settings.max_det);
    let input_boxes: Vec<[f32; 4]> = kept.iter().map(|index| candidates.box_xyxy(*index)).collect();
    let image_boxes: Vec<[f32; 4]> = input_boxes.iter().map(|found| placement.box_in_image(*found)).collect();
    let masks = if settings.retina_masks {
        image_masks(candidates, &kept, &image_boxes, prototypes, placement)
    } else {
        input_masks(candidates, &kept, &input_boxes, prototypes, placement)
    };
    let detection = |((index, image_box), mask): ((&usize, &[f32; 4]), Mask)| Detection {
        anchor: candidates.anchor(*index),
        box_xyxy: placement.adjusted(*image_box),
        score: candidates.score(*index),
        mask,
    };
    let found = kept.iter().zip(&image_boxes).zip(masks).map(detection);
    found.filter(|detection| !detection.mask.is_empty()).collect()
}
