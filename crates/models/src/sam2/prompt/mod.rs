//! Prompts: clicks, boxes and masks, how they are checked and how they are encoded.

mod prompt_encoder;

pub use prompt_encoder::PointLabel;
pub(crate) use prompt_encoder::{InputPoint, PromptEncoder};

use crate::sam2::Sam2Error;
use crate::sam2::resize::{Size, resize_antialiased};
use splatseg_geometry::Mask;

/// A click on the frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Click {
    /// Column in pixels of the frame, from 0 at the left border to its width.
    pub x: f32,
    /// Row in pixels of the frame, from 0 at the upper border to its height.
    pub y: f32,
    /// Whether the object is there, or not.
    pub positive: bool,
}

/// A prompt for one object on the current frame.
#[derive(Clone, Debug, PartialEq)]
pub enum Prompt {
    /// A box, clicks, or both. They replace earlier ones of this object on this frame.
    Points {
        /// x0, y0, x1, y1 in pixels of the frame.
        bounding_box: Option<[f32; 4]>,
        /// Clicks.
        clicks: Vec<Click>,
    },
    /// Clicks in addition to the earlier prompt of this object on this frame.
    MoreClicks(Vec<Click>),
    /// The object's mask, of the frame's size.
    Mask(Mask),
}

impl Prompt {
    /// One positive click.
    pub fn click(x: f32, y: f32) -> Self {
        Self::Points { bounding_box: None, clicks: vec![Click { x, y, positive: true }] }
    }

    /// A box from its upper left to its lower right corner, in pixels.
    pub fn bounding_box(corners: [f32; 4]) -> Self {
        Self::Points { bounding_box: Some(corners), clicks: Vec::new() }
    }
}

/// A checked prompt, in pixels of the network's input.
#[derive(Clone, Debug)]
pub(crate) enum CheckedPrompt {
    Points {
        points: Vec<InputPoint>,
        replace: bool,
    },
    /// Of the input's size. As bits: there may be one for each of hundreds of objects.
    Mask(Mask),
}

impl CheckedPrompt {
    /// Checks a prompt of `object` on a frame of the given `(width, height)`.
    pub fn new(object: u64, prompt: &Prompt, frame: (usize, usize), image_size: usize) -> Result<Self, Sam2Error> {
        let (bounding_box, clicks, replace) = match prompt {
            Prompt::Mask(mask) => return Ok(Self::Mask(checked_mask(object, mask, frame, image_size)?)),
            Prompt::Points { bounding_box, clicks } => (*bounding_box, clicks, true),
            Prompt::MoreClicks(clicks) => (None, clicks, false),
        };
        let checked = |x: f32, y: f32, label| {
            let inside = (0.0..=frame.0 as f32).contains(&x) && (0.0..=frame.1 as f32).contains(&y);
            // As the official code: relative to the frame first, then in pixels of the input.
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

/// A mask at the network's input size, as the official code resizes it.
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

/// 1 inside and 0 outside, `[height, width]`.
pub(crate) fn zeros_and_ones(mask: &Mask) -> Vec<f32> {
    let mut values = vec![0.0; mask.width() * mask.height()];
    mask.pixel_indices().for_each(|index| values[index] = 1.0);
    values
}
