//! Position of an image in the network's letterboxed input.

use super::candidates::box_iou;

/// Box sides closer to the image's border than this, in pixels, are moved to the border (FastSAM).
const BORDER_SNAP: f32 = 20.0;

/// A box whose IoU with the whole image is larger becomes the whole image (FastSAM).
const FULL_IMAGE_IOU: f32 = 0.9;

/// Sizes of image and input. They determine scale and padding, as in Ultralytics' `scale_boxes`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Placement {
    /// `(width, height)` of the image in pixels.
    pub image: (usize, usize),
    /// `(width, height)` of the network's input in pixels.
    pub input: (usize, usize),
}

impl Placement {
    /// Width and height of the image within the input.
    pub fn scaled(&self) -> (usize, usize) {
        scaled_to_fit(self.image, self.input)
    }

    /// Width and height of the input's padding, the sum of both sides.
    pub fn padding(&self) -> (usize, usize) {
        let (width, height) = self.scaled();
        (self.input.0.saturating_sub(width), self.input.1.saturating_sub(height))
    }

    /// Converts a box (left, top, right, bottom) from input pixels to image pixels and clips it to the image.
    pub fn box_in_image(&self, box_xyxy: [f32; 4]) -> [f32; 4] {
        let (scaled, padding) = (self.scaled(), self.padding());
        let along = |position: f32, padding: usize, scaled: usize, image: usize| {
            let gain = (scaled as f64 / image as f64) as f32;
            ((position - window_start(padding) as f32) / gain).clamp(0.0, image as f32)
        };
        let x = |position| along(position, padding.0, scaled.0, self.image.0);
        let y = |position| along(position, padding.1, scaled.1, self.image.1);
        [x(box_xyxy[0]), y(box_xyxy[1]), x(box_xyxy[2]), y(box_xyxy[3])]
    }

    /// Applies FastSAM's adjustment of boxes (not of masks), in image pixels: sides close to the border move to it, and
    /// a box that is nearly the whole image becomes the whole image.
    pub fn adjusted(&self, [mut left, mut top, mut right, mut bottom]: [f32; 4]) -> [f32; 4] {
        let (width, height) = (self.image.0 as f32, self.image.1 as f32);
        if left < BORDER_SNAP {
            left = 0.0;
        }
        if top < BORDER_SNAP {
            top = 0.0;
        }
        if right > width - BORDER_SNAP {
            right = width;
        }
        if bottom > height - BORDER_SNAP {
            bottom = height;
        }
        let whole = [0.0, 0.0, width, height];
        let snapped = [left, top, right, bottom];
        if box_iou(whole, snapped) > FULL_IMAGE_IOU { whole } else { snapped }
    }
}

/// Returns the size of an image scaled to fit `frame`. All sizes are `(width, height)`.
pub(super) fn scaled_to_fit(image: (usize, usize), frame: (usize, usize)) -> (usize, usize) {
    let gain = (frame.1 as f64 / image.1 as f64).min(frame.0 as f64 / image.0 as f64);
    let scaled = |side: usize| (side as f64 * gain).round_ties_even() as usize;
    (scaled(image.0), scaled(image.1))
}

/// First pixel after the left or top padding, if both sides together have `padding` pixels.
pub(super) fn window_start(padding: usize) -> usize {
    (padding as f64 / 2.0 - 0.1).round_ties_even() as usize
}
