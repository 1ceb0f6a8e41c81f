//! Prompts for promptable segmenters and trackers: clicks, boxes and masks.

use crate::Mask;

/// A click on the frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Click {
    /// Column in pixels of the frame, from 0 at the left border to its width.
    pub x: f32,
    /// Row in pixels of the frame, from 0 at the upper border to its height.
    pub y: f32,
    /// True if the click is on the object, false if it is off the object.
    pub positive: bool,
}

/// A prompt for one object on the current frame.
#[derive(Clone, Debug, PartialEq)]
pub enum Prompt {
    /// A box, clicks, or both. They replace earlier prompts of this object on this frame.
    Points {
        /// x0, y0, x1, y1 in pixels of the frame.
        bounding_box: Option<[f32; 4]>,
        /// Clicks.
        clicks: Vec<Click>,
    },
    /// Clicks in addition to the earlier prompt of this object on this frame.
    MoreClicks(Vec<Click>),
    /// The object's mask, at the frame's size.
    Mask(Mask),
}

impl Prompt {
    /// Creates a prompt of one positive click.
    pub fn click(x: f32, y: f32) -> Self {
        Self::Points { bounding_box: None, clicks: vec![Click { x, y, positive: true }] }
    }

    /// Creates a box prompt from the upper left and lower right corners, in pixels.
    pub fn bounding_box(corners: [f32; 4]) -> Self {
        Self::Points { bounding_box: Some(corners), clicks: Vec::new() }
    }
}
