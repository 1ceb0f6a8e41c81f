//! What can go wrong in FastSAM.

use crate::checkpoint::CheckpointError;
use std::path::PathBuf;
use thiserror::Error;

/// Why a network could not be loaded or an image not be segmented.
#[derive(Debug, Error)]
pub enum FastSamError {
    /// The file cannot be read, or a tensor does not fit the architecture.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    /// The weights are those of another model.
    #[error("{}: {found}, expected FastSAM: a YOLOv8-seg with one class", path.display())]
    NotFastSam {
        /// The file.
        path: PathBuf,
        /// What tells it apart.
        found: String,
    },
    /// A setting has an impossible value.
    #[error("fastsam.{field} is {found}, expected {expected}")]
    Setting {
        /// The setting's name, e.g. `image_size`.
        field: &'static str,
        /// Its value.
        found: String,
        /// What it may be.
        expected: &'static str,
    },
    /// There is nothing to segment.
    #[error("the image has no pixels")]
    EmptyImage,
    /// The device failed while it computed.
    #[error("the device failed: {message}")]
    Device {
        /// What it said.
        message: String,
    },
}
