//! Errors creating or using a memory.

use crate::{CodebookError, SplatFileError};
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
    /// The regions, or the grid of the affinities, do not fit the frame; both sizes are `(width, height)`.
    #[error(
        "regions of {}x{} pixels and affinities do not fit the frame of {}x{}",
        regions.0, regions.1, expected.0, expected.1
    )]
    Affinities {
        /// Size of the regions.
        regions: (usize, usize),
        /// Size of the frame.
        expected: (usize, usize),
    },
    /// Two maps cannot be joined: Gaussians that remember features, or in a way of your own, have no votes to add.
    #[error("only maps of votes can be joined, memory.kind = \"evidence\"")]
    CannotJoin,
    /// A prediction has an id that [`SplatMemory::new_segment`](crate::SplatMemory::new_segment) never returned.
    #[error("a prediction has the id {found}, but only 1 to {known} exist")]
    UnknownSegment {
        /// The id.
        found: SegmentId,
        /// The largest id returned so far.
        known: SegmentId,
    },
}

/// An error loading a saved memory.
#[derive(Debug, Error)]
pub enum LoadMemoryError {
    /// The file is damaged or not a splatseg memory.
    #[error(transparent)]
    File(#[from] SplatFileError),
    /// A setting is out of range.
    #[error(transparent)]
    Settings(#[from] MemoryError),
    /// The file contains a memory of another kind than the settings.
    #[error("{path}: the memory has the kind {found:?}, but memory.kind is {expected:?}")]
    Kind {
        /// The file.
        path: String,
        /// Kind of the file.
        found: String,
        /// Kind in the settings.
        expected: &'static str,
    },
    /// The state that the file contains besides its Gaussians is invalid.
    #[error("{path}: invalid state besides the Gaussians: {found}")]
    SavedState {
        /// The file.
        path: String,
        /// The problem.
        found: String,
    },
    /// The file's features have another dimension than the settings.
    #[error("{path}: the features have {found} channels, but memory.feature_dim is {expected}")]
    FeatureDim {
        /// The file.
        path: String,
        /// Channels in the file.
        found: usize,
        /// Channels in the settings.
        expected: usize,
    },
}
