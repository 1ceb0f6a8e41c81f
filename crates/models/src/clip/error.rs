//! Errors of CLIP networks.

use crate::checkpoint::CheckpointError;
use std::path::PathBuf;
use thiserror::Error;

/// A CLIP network that cannot be loaded or used.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ClipError {
    /// The checkpoint cannot be read.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    /// The file is not a `.safetensors` file.
    #[error("{}: found a checkpoint of PyTorch, expected a .safetensors file (splatseg inspect --convert makes one)", .path.display())]
    NotSafetensors {
        /// The file.
        path: PathBuf,
    },
    /// The checkpoint is of another network.
    #[error("{}: found {found}, expected a CLIP network of OpenCLIP or Hugging Face, or a Perception Encoder", .path.display())]
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
    #[error("{}: its embedding of {of} has numbers that are not finite", .path.display())]
    NotFinite {
        /// The checkpoint.
        path: PathBuf,
        /// An image or a text.
        of: &'static str,
    },
}
