//! Errors of a pipeline.

use crate::names::NamesError;
use crate::parts::PartError;
use crate::settings::SettingsError;
use splatseg_dataset::FrameReadError;
use splatseg_depth::DepthPredictorError;
use splatseg_files::StateError;
use splatseg_geometry::SegmentId;
use splatseg_kernels::InstructionsError;
use splatseg_memory::LoadMemoryError;
use splatseg_objects::NameError;
use splatseg_odometry::PoseSourceError;
use splatseg_segmenter::SegmenterError;
use splatseg_tracking::TrackingError;
use std::error::Error as StdError;
use std::path::PathBuf;
use thiserror::Error;

/// An error building a pipeline or processing a frame.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum PipelineError {
    /// The settings cannot be used.
    #[error(transparent)]
    Settings(#[from] SettingsError),
    /// The environment variable `SPLATSEG_INSTRUCTIONS` cannot be used.
    #[error(transparent)]
    Instructions(#[from] InstructionsError),
    /// The segmenter, the tracker or the namer could not be built.
    #[error(transparent)]
    Part(#[from] PartError),
    /// The method could not be created.
    #[error(transparent)]
    MakeMethod(#[from] TrackingError),
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
    /// The times or rooms of a saved memory cannot be used.
    #[error("{}: when objects were seen: {source}", path.display())]
    History {
        /// The saved memory.
        path: PathBuf,
        /// The error.
        source: StateError,
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
    /// The frame's depth could not be predicted. Later frames can still be processed.
    #[error("{frame}: {source}")]
    Depth {
        /// The frame.
        frame: String,
        /// The error.
        source: Box<DepthPredictorError>,
    },
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
    /// The objects of a saved map could not be named.
    #[error("{}: {source}", .path.display())]
    MapNames {
        /// The map.
        path: PathBuf,
        /// The error.
        source: Box<NamesError>,
    },
    /// The namer that the settings chose failed after a frame, whose result is lost.
    #[error("frame {frame}: {source}")]
    Namer {
        /// The frame.
        frame: String,
        /// The error.
        source: NameObjectsError,
    },
}

/// An error naming objects. Names given before it stay.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum NameObjectsError {
    /// The pipeline keeps no views.
    #[error("the pipeline keeps no views of objects: build it with keep_views")]
    NoViews,
    /// The function failed.
    #[error("naming object {id}: {source}")]
    Namer {
        /// The object.
        id: SegmentId,
        /// The function's error.
        source: Box<dyn StdError + Send + Sync>,
    },
    /// The namer could not choose labels for the objects.
    #[error("labels of the objects: {source}")]
    Labels {
        /// The namer's error.
        source: Box<dyn StdError + Send + Sync>,
    },
    /// The function has returned a name that cannot be used.
    #[error("the name of object {id}: {source}")]
    Name {
        /// The object.
        id: SegmentId,
        /// The error.
        source: NameError,
    },
}

/// A frame of a source that did not reach the method. Later frames can still be processed.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum UnusableFrame {
    /// The frame's depth could not be predicted.
    #[error("{frame}: {source}")]
    Depth {
        /// The frame.
        frame: String,
        /// The error.
        source: Box<DepthPredictorError>,
    },
    /// The frame could not be read.
    #[error(transparent)]
    Read(#[from] FrameReadError),
    /// The frame's pose could not be determined.
    #[error(transparent)]
    Pose(#[from] PoseSourceError),
}
