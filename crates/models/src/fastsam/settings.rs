//! Settings of FastSAM.

use super::FastSamError;
use super::letterbox::INPUT_MULTIPLE;
use serde::{Deserialize, Serialize};

/// Largest side of the network's input: four times the paper's.
const MAX_IMAGE_SIZE: usize = 4096;

/// Settings of a [`FastSamPredictor`](super::FastSamPredictor); the names are Ultralytics', the defaults the paper's.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FastSamPredictorSettings {
    /// The longer side of the network's input in pixels, a multiple of 32 (`imgsz`). Default: 1024.
    pub image_size: usize,
    /// Boxes with a lower score are dropped, from 0 to 1 (`conf`). Default: 0.4.
    pub confidence: f64,
    /// NMS drops a box that overlaps a better one by a larger IoU, from 0 to 1 (`iou`). Default: 0.9.
    pub iou: f64,
    /// Most objects of an image. Default: 300.
    pub max_det: usize,
    /// Whether masks are computed at the image's size. Otherwise they have the size of the network's input, which is
    /// coarser where that is smaller. Default: true.
    pub retina_masks: bool,
}

impl Default for FastSamPredictorSettings {
    fn default() -> Self {
        Self { image_size: 1024, confidence: 0.4, iou: 0.9, max_det: 300, retina_masks: true }
    }
}

impl FastSamPredictorSettings {
    /// The settings, if all are in range.
    ///
    /// # Errors
    /// [`FastSamError::Setting`] names the first that is not.
    pub fn validated(self) -> Result<Self, FastSamError> {
        let size = self.image_size;
        if !(size.is_multiple_of(INPUT_MULTIPLE) && (INPUT_MULTIPLE..=MAX_IMAGE_SIZE).contains(&size)) {
            let expected = "a multiple of 32 from 32 to 4096";
            return Err(FastSamError::Setting { field: "image_size", found: size.to_string(), expected });
        }
        for (field, value) in [("confidence", self.confidence), ("iou", self.iou)] {
            if !(0.0..=1.0).contains(&value) {
                let expected = "a number from 0 to 1";
                return Err(FastSamError::Setting { field, found: value.to_string(), expected });
            }
        }
        if self.max_det == 0 {
            return Err(FastSamError::Setting { field: "max_det", found: "0".to_owned(), expected: "1 or more" });
        }
        Ok(self)
    }
}
