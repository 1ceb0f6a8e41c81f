//! Errors of a live session.

use splatseg::pipeline::{MergeObjectsError, PipelineError};
use splatseg_memory::SplatFileError;
use std::io;
use std::path::PathBuf;
use thiserror::Error;

/// Errors of a [`LiveSession`](crate::LiveSession).
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum LiveError {
    /// The method or its device failed: no later frame can be processed.
    #[error(transparent)]
    Pipeline(#[from] PipelineError),
    /// The map cannot be saved.
    #[error(transparent)]
    Map(#[from] SplatFileError),
    /// The list of objects cannot be saved.
    #[error("{}: cannot be written: {source}", path.display())]
    Objects {
        /// The file.
        path: PathBuf,
        /// The error.
        source: io::Error,
    },
    /// The method has no map to save.
    #[error("the method {0} has no map to save")]
    NoMap(String),
    /// The session has ended with an error, and its map cannot be saved.
    #[error("{ended}; the map is not saved: {saved}")]
    Unsaved {
        /// The error that ended the session.
        ended: Box<LiveError>,
        /// The error of saving.
        saved: Box<LiveError>,
    },
    /// An object cannot be given a label.
    #[error("{0}")]
    Name(String),
    /// Objects cannot be merged.
    #[error(transparent)]
    Merge(#[from] MergeObjectsError),
    /// The segmenter has no degrees of detail.
    #[error("the segmenter in use cannot segment more or less finely: that of affinity and graph can")]
    NoDetail,
    /// There is no file for the map.
    #[error("no file for the map is set")]
    NoFile,
}
