//! The mask of an object in a frame.

use crate::sam2::resize::{Size, resize_bilinear};
use splatseg_geometry::{Image, Mask};

/// The output of the network for one object in one frame.
#[derive(Clone, Debug, PartialEq)]
pub struct ObjectMask {
    /// The object's id.
    pub object: u64,
    /// Mask logits at a quarter of the network input's resolution; -1024 everywhere if the object is not in the frame.
    pub low_res_logits: Image<f32>,
    /// Logit of "the object is in the frame".
    pub object_score: f32,
    /// Predicted intersection over union with the true mask.
    pub predicted_iou: f32,
    /// The object pointer: an embedding of the object to which later frames attend.
    pub pointer: Vec<f32>,
    /// `(width, height)` of the frame.
    pub frame_size: (usize, usize),
}

impl ObjectMask {
    /// Returns the mask logits at the frame's size, `[height, width]`.
    pub fn logits(&self) -> Image<f32> {
        let (width, height) = self.frame_size;
        let low = Size { width: self.low_res_logits.width(), height: self.low_res_logits.height() };
        let logits = resize_bilinear(self.low_res_logits.pixels(), low, Size { width, height });
        // `resize_bilinear` returns width times height values.
        Image::from_pixels(width, height, logits).expect("one logit per pixel")
    }

    /// Returns the mask at the frame's size.
    pub fn mask(&self) -> Mask {
        let logits = self.logits();
        Mask::from_fn(logits.width(), logits.height(), |column, row| logits[(column, row)] > 0.0)
    }

    /// True if the object is in the frame.
    pub fn is_present(&self) -> bool {
        self.object_score > 0.0
    }
}
