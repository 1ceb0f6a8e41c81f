//! What can go wrong on a device.

use splatseg_memory::MemoryError;
use std::sync::Arc;
use thiserror::Error;

/// A device that cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum GpuError {
    /// There is no GPU that can be used.
    #[error("no GPU: {reason}")]
    NoDevice {
        /// What was found instead.
        reason: String,
    },
    /// A buffer is larger than the device allows.
    #[error("{what} takes {bytes} bytes, and the device allows {limit} in one buffer")]
    TooLarge {
        /// What the buffer is for.
        what: &'static str,
        /// Its size.
        bytes: u64,
        /// The largest size that is allowed.
        limit: u64,
    },
    /// The device failed while it worked.
    #[error("the device failed: {reason}")]
    Failed {
        /// What it reports.
        reason: String,
    },
    /// A recall was made by another device or by the CPU.
    #[error("the view of this frame was not made on this device")]
    ForeignView,
}

impl From<GpuError> for MemoryError {
    fn from(error: GpuError) -> Self {
        Self::Device(Arc::new(error))
    }
}
