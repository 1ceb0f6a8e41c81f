//! The pipeline: frames → segmenter, pose → method ⇄ memory → ids and objects.
//!
//! [`Pipeline`] is the only frame loop. `splatseg run`, `bench` and `demo` run it on scenes. A robot passes it the frames
//! of its camera with [`Pipeline::step`].

mod builder;
mod enlarging;
mod error;
mod frame_result;
mod frames;
mod hindsight;
mod kept_names;
mod late;
mod map_places;
mod named_map;
mod naming;
mod naming_beside;
mod predicted_depth;
mod relations;
mod rotate;
mod stage_times;
mod stages;
mod steps;
mod working_resolution;

pub use builder::PipelineBuilder;
pub use error::{NameObjectsError, PipelineError, UnusableFrame};
pub use frame_result::FrameResult;
pub use frames::{Frames, Processed};
pub use late::{LateFrame, WaitingFrames};
pub use map_places::{MapPlanError, RoomNameError};
pub use named_map::{NamedMap, depth_views};
pub use predicted_depth::{DepthAgain, PredictedDepthUse};
pub use rotate::Rotate;
pub use stage_times::StageTimes;
pub use steps::Pipeline;
pub use working_resolution::ReducedHindsight;

pub use crate::parts::{LoadedNetworks, ObjectToName};
