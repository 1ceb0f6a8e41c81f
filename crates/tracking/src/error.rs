//! Everything that can go wrong in a method.

use crate::TrackerError;
use splatseg_memory::MemoryError;
use splatseg_segmenter::SegmenterError;
use thiserror::Error;

/// Why a method could not be made or a frame not be processed.
#[derive(Debug, Error)]
pub enum TrackingError {
    /// The segmenter failed.
    #[error(transparent)]
    Segmenter(#[from] SegmenterError),
    /// The memory failed.
    #[error(transparent)]
    Memory(#[from] MemoryError),
    /// The tracker failed.
    #[error(transparent)]
    Tracker(#[from] TrackerError),
    /// A mask is not of the frame's size; both are `(width, height)`.
    #[error("a mask has {}x{} pixels, expected the frame's {}x{}", found.0, found.1, expected.0, expected.1)]
    MaskSize {
        /// Size of the mask.
        found: (usize, usize),
        /// Size of the frame.
        expected: (usize, usize),
    },
    /// A setting is out of range.
    #[error("min_match_f_score is {0}, expected 0 to 1")]
    MinMatchFScore(f64),
    /// A setting of FastSPAM is no share.
    #[error("{field} is {found}, expected more than 0 and at most 1")]
    Share {
        /// The setting's name.
        field: &'static str,
        /// Its value.
        found: f64,
    },
    /// A setting of a method over a tracker is out of range.
    #[error("{field} is {found}, expected {expected}")]
    Setting {
        /// The setting's name, e.g. `reprompt.clicks`.
        field: &'static str,
        /// Its value.
        found: String,
        /// What it may be.
        expected: &'static str,
    },
    /// All ids have been given.
    #[error("the video has more segments than there are 32-bit ids")]
    OutOfIds,
}
