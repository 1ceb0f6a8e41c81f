//! Errors of Depth Anything networks.

use crate::checkpoint::CheckpointError;
use std::path::PathBuf;
use thiserror::Error;

/// A Depth Anything network that cannot be loaded or used.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum DepthAnythingError {
    /// The checkpoint cannot be read.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    /// The checkpoint is of another network.
    #[error("{}: found {found}, expected Depth Anything V2, of its authors (.pth) or Hugging Face (.safetensors)", .path.display())]
    OtherNetwork {
        /// The file.
        path: PathBuf,
        /// The value found.
        found: String,
    },
    /// A size of the network is not possible, or not supported.
    #[error("{}: {what}: found {found}, expected {expected}", .path.display())]
    Size {
        /// The checkpoint, or the configuration beside it.
        path: PathBuf,
        /// The part with the size.
        what: String,
        /// The size.
        found: String,
        /// The values allowed.
        expected: String,
    },
    /// The network computed numbers that are not finite.
    #[error("{}: its depth has numbers that are not finite", .path.display())]
    NotFinite {
        /// The checkpoint.
        path: PathBuf,
    },
}
