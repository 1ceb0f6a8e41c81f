//! Prompts: clicks, boxes and masks, with their validation and encoding.

mod prompt_encoder;

pub use prompt_encoder::PointLabel;
pub(crate) use prompt_encoder::{InputPoint, PromptEncoder};

use crate::sam2::Sam2Error;
use crate::sam2::resize::{Size, resize_antialiased};
use splatseg_geometry::{Mask, Prompt};

/// A checked prompt, in pixels of the network's input.
#[derive(Clone, Debug)]
pub(crate) enum CheckedPrompt {
    Points {
        points: Vec<InputPoint>,
        replace: bool,
    },
    /// At the input's size. Stored as bits, because there may be hundreds of objects.
    Mask(Mask),
}

impl CheckedPrompt {
    /// Checks a prompt for `object` on a frame of the given `(width, height)`.
    pub fn new(object: u64, prompt: &Prompt, frame: (usize, usize), image_size: usize) -> Result<Self, Sam2Error> {
        let (bounding_box, clicks, replace) = match prompt {
            Prompt::Mask(mask) => return Ok(Self::Mask(checked_mask(object, mask, frame, image_size)?)),
            Prompt::Points { bounding_box, clicks } => (*bounding_box, clicks, true),
            Prompt::MoreClicks(clicks) => (None, clicks, false),
        };
        let checked = |x: f32, y: f32, label| {
            let inside = (0.0..=frame.0 as f32).contains(&x) && (0.0..=frame.1 as f32).contains(&y);
            // As in the official code: relative to the frame first, then in pixels of the input.
            let point = InputPoint {
                x: x / frame.0 as f32 * image_size as f32,
                y: y / frame.1 as f32 * image_size as f32,
                label: Some(label),
            };
            if inside {
                Ok(point)
            } else {
                Err(Sam2Error::PointOutside { object, x, y, width: frame.0, height: frame.1 })
            }
        };
        let mut points = Vec::new();
        if let Some(corners @ [x0, y0, x1, y1]) = bounding_box {
            points.push(checked(x0, y0, PointLabel::BoxStart)?);
            points.push(checked(x1, y1, PointLabel::BoxEnd)?);
            if x1 <= x0 || y1 <= y0 {
                return Err(Sam2Error::EmptyBox { object, corners });
            }
        }
        for click in clicks {
            let label = if click.positive { PointLabel::Positive } else { PointLabel::Negative };
            points.push(checked(click.x, click.y, label)?);
        }
        if points.is_empty() {
            return Err(Sam2Error::EmptyPrompt { object });
        }
        Ok(Self::Points { points, replace })
    }
}

/// Resizes a mask to the network's input size, as in the official code.
fn checked_mask(object: u64, mask: &Mask, frame: (usize, usize), image_size: usize) -> Result<Mask, Sam2Error> {
    let found = (mask.width(), mask.height());
    if found != frame {
        return Err(Sam2Error::MaskSize { object, found, expected: frame });
    }
    let (from, to) = (Size { width: found.0, height: found.1 }, Size { width: image_size, height: image_size });
    let resized = if from == to {
        mask.clone()
    } else {
        let values = resize_antialiased(&zeros_and_ones(mask), from, to);
        Mask::from_fn(image_size, image_size, |column, row| values[row * image_size + column] >= 0.5)
    };
    if resized.is_empty() { Err(Sam2Error::EmptyMask { object }) } else { Ok(resized) }
}

/// Converts a mask to 1 inside and 0 outside, `[height, width]`.
pub(crate) fn zeros_and_ones(mask: &Mask) -> Vec<f32> {
    let mut values = vec![0.0; mask.width() * mask.height()];
    mask.pixel_indices().for_each(|index| values[index] = 1.0);
    values
}
