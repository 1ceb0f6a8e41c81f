//! Errors of FastSAM.

use crate::checkpoint::CheckpointError;
use splatseg_settings::SettingError;
use std::path::PathBuf;
use thiserror::Error;

/// Errors loading a network or segmenting an image.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum FastSamError {
    /// The file cannot be read, or a tensor does not fit the architecture.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    /// The weights belong to another model.
    #[error("{}: {found}, expected FastSAM: a YOLOv8-seg with one class", path.display())]
    NotFastSam {
        /// The file.
        path: PathBuf,
        /// Description of the actual model.
        found: String,
    },
    /// A setting is out of range.
    #[error(transparent)]
    Setting(#[from] SettingError),
    /// The image is empty.
    #[error("the image has no pixels")]
    EmptyImage,
    /// The device failed.
    #[error("the device failed: {message}")]
    Device {
        /// Message from the device.
        message: String,
    },
}
