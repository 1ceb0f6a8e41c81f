//! Errors creating or using a memory.

use crate::CodebookError;
use splatseg_geometry::SegmentId;
use splatseg_settings::SettingError;
use thiserror::Error;

/// An error creating or using a memory.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum MemoryError {
    /// A setting is out of range.
    #[error(transparent)]
    Setting(#[from] SettingError),
    /// The codebook cannot be created.
    #[error(transparent)]
    Codebook(#[from] CodebookError),
    /// A store defined outside this crate failed.
    #[error("{name}: {source}")]
    Other {
        /// Name of the store.
        name: String,
        /// The store's error.
        source: Box<dyn std::error::Error + Send + Sync>,
    },
    /// The predictions differ from the frame in size; both sizes are `(width, height)`.
    #[error("the predictions have {}x{} pixels, expected the frame's {}x{}", found.0, found.1, expected.0, expected.1)]
    PredictionSize {
        /// Size of the predictions.
        found: (usize, usize),
        /// Size of the frame.
        expected: (usize, usize),
    },
    /// A prediction has an id that [`SplatMemory::new_segment`](crate::SplatMemory::new_segment) never returned.
    #[error("a prediction has the id {found}, but only 1 to {known} exist")]
    UnknownSegment {
        /// The id.
        found: SegmentId,
        /// The largest id returned so far.
        known: SegmentId,
    },
}
