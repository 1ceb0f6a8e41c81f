//! How finely a frame is segmented.

use splatseg_settings::choices;

choices! {
    /// How finely frames are segmented, by segmenters that judge how surely two parts belong to one object. In
    /// log-odds, so it means the same for every camera.
    pub enum Detail, default Normal {
        /// Fewer, larger segments: a shelf with its books.
        Coarse = "coarse",
        /// As many segments as people would label.
        Normal = "normal",
        /// More, smaller segments: the doors of a cupboard.
        Fine = "fine",
    }
}

impl Detail {
    /// Added to the log-odds that two parts must have to become one.
    pub const fn log_odds(self) -> f32 {
        match self {
            Self::Coarse => -1.0,
            Self::Normal => 0.0,
            Self::Fine => 1.0,
        }
    }
}
