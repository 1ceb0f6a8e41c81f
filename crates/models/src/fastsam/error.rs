//! What can go wrong in FastSAM.

use thiserror::Error;

/// Why a network could not be loaded or an image not be segmented.
#[derive(Debug, Error)]
pub enum FastSamError {
    /// The weights are those of another model.
    #[error("no FastSAM: {found}, expected a YOLOv8-seg with one class")]
    NotFastSam {
        /// What tells it apart.
        found: String,
    },
    /// A tensor is missing.
    #[error("no tensor {name}, expected one of shape {expected:?}")]
    MissingTensor {
        /// Its name.
        name: String,
        /// Its shape in the architecture.
        expected: Vec<usize>,
    },
    /// A tensor does not fit the architecture.
    #[error("tensor {name} has shape {found:?}, expected {expected:?}")]
    TensorShape {
        /// Its name.
        name: String,
        /// Its shape in the file.
        found: Vec<usize>,
        /// Its shape in the architecture.
        expected: Vec<usize>,
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

impl FastSamError {
    pub(super) fn not_fastsam(found: impl Into<String>) -> Self {
        Self::NotFastSam { found: found.into() }
    }
}
