//! An object in an image.

use splatseg_geometry::Mask;

/// An object found by FastSAM.
#[derive(Clone, Debug, PartialEq)]
pub struct Detection {
    /// Index of the anchor.
    pub anchor: usize,
    /// Left, top, right, bottom in image pixels, after FastSAM's adjustment at the image's borders.
    pub box_xyxy: [f32; 4],
    /// Confidence in [0, 1].
    pub score: f32,
    /// Pixels of the object, within the box before its adjustment.
    pub mask: Mask,
}
