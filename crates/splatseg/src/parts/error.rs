//! Errors building a part.

use splatseg_models::checkpoint::CheckpointError;
use splatseg_models::device::DeviceError;
use splatseg_models::sam2::Sam2Error;
use splatseg_segmenter::SegmenterError;
use splatseg_settings::SettingError;
use splatseg_simulators::SimulatorError;
use splatseg_tracking::TrackerError;
use std::path::PathBuf;
use thiserror::Error;

/// An error building a part of a pipeline.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum PartError {
    /// A setting is out of range.
    #[error(transparent)]
    Setting(#[from] SettingError),
    /// A file that the part needs was not given.
    #[error("{key} is not given, expected {what}")]
    NoFile {
        /// The setting that names the file.
        key: &'static str,
        /// Description of the expected file.
        what: &'static str,
    },
    /// The part needs the ground truth of a scene, and no scene was given.
    #[error("{0} needs a scene with ground truth, but the pipeline has no scene")]
    NoScene(&'static str),
    /// A simulator could not be created.
    #[error(transparent)]
    Simulator(#[from] SimulatorError),
    /// The segmenter could not be created.
    #[error(transparent)]
    Segmenter(#[from] SegmenterError),
    /// The tracker could not be created.
    #[error(transparent)]
    Tracker(#[from] TrackerError),
    /// The device cannot be used.
    #[error(transparent)]
    Device(#[from] DeviceError),
    /// A checkpoint could not be read.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    /// A checkpoint is not SAM 2.1's.
    #[error("{}: {source}", path.display())]
    Sam2 {
        /// The checkpoint.
        path: PathBuf,
        /// The error.
        source: Box<Sam2Error>,
    },
    /// A part defined outside this crate could not be built.
    #[error("{name}: {source}")]
    Other {
        /// Name of the part.
        name: String,
        /// The part's error.
        source: Box<dyn std::error::Error + Send + Sync>,
    },
}
