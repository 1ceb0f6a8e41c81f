//! How frames are turned for the segmenter.

use splatseg_geometry::QuarterTurn;
use splatseg_settings::choices;

choices! {
    /// How frames are turned, clockwise, for a segmenter that prefers upright images.
    pub enum Rotate, default Auto {
        /// Upright, once the camera has looked around and the floor is known.
        Auto = "auto",
        /// Not at all.
        None = "0",
        /// By 90°: the top of the scene is on the left of the images.
        Right = "90",
        /// By 180°: the camera is upside down.
        Half = "180",
        /// By 270°: the top of the scene is on the right of the images.
        Left = "270",
    }
}

impl Rotate {
    /// The turn. `None` if it is to be found.
    pub const fn turn(self) -> Option<QuarterTurn> {
        match self {
            Self::Auto => None,
            Self::None => Some(QuarterTurn::None),
            Self::Right => Some(QuarterTurn::Right),
            Self::Half => Some(QuarterTurn::Half),
            Self::Left => Some(QuarterTurn::Left),
        }
    }
}
