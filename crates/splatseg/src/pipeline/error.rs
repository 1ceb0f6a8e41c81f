//! Errors of a pipeline.

use crate::settings::SettingsError;
use splatseg_dataset::FrameReadError;
use splatseg_kernels::InstructionsError;
use splatseg_memory::LoadMemoryError;
use splatseg_models::checkpoint::CheckpointError;
use splatseg_models::device::DeviceError;
use splatseg_models::sam2::Sam2Error;
use splatseg_objects::NameError;
use splatseg_odometry::PoseSourceError;
use splatseg_segmenter::SegmenterError;
use splatseg_settings::SettingError;
use splatseg_simulators::SimulatorError;
use splatseg_tracking::{TrackerError, TrackingError};
use std::path::PathBuf;
use thiserror::Error;

/// An error building a pipeline or processing a frame.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum PipelineError {
    /// The settings cannot be used.
    #[error(transparent)]
    Settings(#[from] SettingsError),
    /// A setting is out of range.
    #[error(transparent)]
    Setting(#[from] SettingError),
    /// The environment variable `SPLATSEG_INSTRUCTIONS` cannot be used.
    #[error(transparent)]
    Instructions(#[from] InstructionsError),
    /// A setting needs the ground truth of a scene, and no scene was given.
    #[error("{0} needs a scene with ground truth, but the pipeline has no scene")]
    NoScene(&'static str),
    /// A simulator could not be created.
    #[error(transparent)]
    Simulator(#[from] SimulatorError),
    /// The segmenter could not be created.
    #[error(transparent)]
    MakeSegmenter(#[from] SegmenterError),
    /// The tracker could not be created.
    #[error(transparent)]
    MakeTracker(#[from] TrackerError),
    /// The method could not be created.
    #[error(transparent)]
    MakeMethod(#[from] TrackingError),
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
    /// A saved memory could not be loaded.
    #[error(transparent)]
    Memory(#[from] LoadMemoryError),
    /// The names of objects in a saved memory cannot be used.
    #[error("{}: {source}", path.display())]
    Names {
        /// The saved memory.
        path: PathBuf,
        /// The error.
        source: NameError,
    },
    /// A saved memory was given, but the method has no memory.
    #[error("{}: the method {method} has no splat memory to load", path.display())]
    NoMemory {
        /// The saved memory.
        path: PathBuf,
        /// The method.
        method: &'static str,
    },
    /// The frame's pose could not be determined. Later frames can still be processed.
    #[error(transparent)]
    Pose(#[from] PoseSourceError),
    /// The segmenter failed on a frame. Later frames can still be processed.
    #[error("{frame}: {source}")]
    Segmenter {
        /// The frame.
        frame: String,
        /// The error.
        source: Box<SegmenterError>,
    },
    /// The device failed. No later frame can be processed.
    #[error("frame {frame}: {source}")]
    DeviceFailed {
        /// The frame.
        frame: String,
        /// The error.
        source: Box<SegmenterError>,
    },
    /// The method failed on a frame.
    #[error("frame {frame}: {source}")]
    Method {
        /// The frame.
        frame: String,
        /// The error.
        source: Box<TrackingError>,
    },
}

/// A frame of a source that did not reach the method. Later frames can still be processed.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum UnusableFrame {
    /// The frame could not be read.
    #[error(transparent)]
    Read(#[from] FrameReadError),
    /// The frame's pose could not be determined.
    #[error(transparent)]
    Pose(#[from] PoseSourceError),
}
