//! Settings of FastSAM's predictor.

use splatseg_settings::{Allowed, settings};

settings! {
    /// Settings of a [`FastSamPredictor`](super::FastSamPredictor), with Ultralytics' names and the paper's defaults.
    pub struct FastSamPredictorSettings in "fastsam" {
        /// The longer side of the network's input, pixels (`imgsz`).
        image_size: usize = 1024, Allowed::Multiple { of: 32, min: 32, max: 2048 };
        /// Boxes with a lower score are dropped (`conf`).
        confidence: f64 = 0.4, Allowed::between(0.0, 1.0);
        /// NMS drops the worse of two boxes whose IoU is larger (`iou`).
        iou: f64 = 0.9, Allowed::between(0.0, 1.0);
        /// Maximum number of objects per image.
        max_det: usize = 300, Allowed::between(1.0, 10000.0);
        /// Computes masks at the image's size. Otherwise, masks have the size of the network's input, which is coarser
        /// if the input is smaller.
        retina_masks: bool = true, Allowed::Switch;
    }
}
