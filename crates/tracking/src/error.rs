//! Errors of methods.

use crate::TrackerError;
use splatseg_memory::MemoryError;
use splatseg_settings::SettingError;
use thiserror::Error;

/// An error creating a method or processing a frame.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum TrackingError {
    /// A setting is out of range.
    #[error(transparent)]
    Setting(#[from] SettingError),
    /// The memory failed.
    #[error(transparent)]
    Memory(#[from] MemoryError),
    /// The tracker failed.
    #[error(transparent)]
    Tracker(#[from] TrackerError),
    /// A mask does not have the frame's size; both sizes are `(width, height)`.
    #[error("a mask has {}x{} pixels, expected the frame's {}x{}", found.0, found.1, expected.0, expected.1)]
    MaskSize {
        /// Size of the mask.
        found: (usize, usize),
        /// Size of the frame.
        expected: (usize, usize),
    },
    /// A frame has more masks than the method can compare.
    #[error("the frame has {found} masks, expected at most {limit} with this method (fastsam-splat takes any number)")]
    TooManyMasks {
        /// Number of masks of the frame.
        found: usize,
        /// Maximum number of masks.
        limit: usize,
    },
    /// A method defined outside this crate failed.
    #[error("{name}: {source}")]
    Other {
        /// Name of the method.
        name: String,
        /// The method's error.
        source: Box<dyn std::error::Error + Send + Sync>,
    },
}
