#![doc = include_str!("library.md")]

pub mod evaluation;
pub mod merging;
pub mod names;
pub mod parts;
pub mod pipeline;
mod relative_paths;
pub mod settings;
pub mod summary;

#[doc(inline)]
pub use pipeline::{FrameResult, Pipeline};
#[doc(inline)]
pub use settings::Settings;

pub use splatseg_annotations as annotations;
pub use splatseg_dataset as dataset;
pub use splatseg_depth as depth;
pub use splatseg_geometry as geometry;
pub use splatseg_memory as memory;
pub use splatseg_mesh as mesh;
pub use splatseg_metrics as metrics;
pub use splatseg_models as models;
pub use splatseg_objects as objects;
pub use splatseg_odometry as odometry;
pub use splatseg_output as output;
pub use splatseg_places as places;
pub use splatseg_render as render;
pub use splatseg_segmenter as segmenter;
pub use splatseg_simulators as simulators;
pub use splatseg_tracking as tracking;

pub use splatseg_geometry::{
    CameraFrame, Image, Intrinsics, Mask, Pose, RgbdFrame, ScoredMask, SegmentId, SegmentMap, Segmentation,
};
pub use splatseg_segmenter::Segmenter;
pub use splatseg_tracking::{FrameOutput, Method, Tracker};
