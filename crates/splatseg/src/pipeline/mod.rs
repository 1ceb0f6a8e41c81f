//! The pipeline: frames → segmenter, pose → method ⇄ memory → ids and objects.
//!
//! [`Pipeline`] is the only frame loop. `splatseg run`, `bench` and `demo` run it on scenes. A robot passes it the frames
//! of its camera with [`Pipeline::step`].

mod background;
mod builder;
mod corrected_rooms;
mod enlarging;
mod error;
mod frame_gate;
mod frame_result;
mod frames;
mod hindsight;
mod kept_names;
mod late;
mod map_history;
mod map_places;
mod merged_objects;
mod named_map;
mod naming;
mod naming_beside;
mod plan_beside;
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
pub use map_history::MapHistory;
pub use map_places::{MapPlaces, MapPlanError, MapPlanInput, RoomNameError};
pub use merged_objects::MergeObjectsError;
pub use named_map::{NamedMap, depth_views};
pub use plan_beside::PlanBeside;
pub use predicted_depth::{DepthAgain, MapScale, PredictedDepthUse};
pub use rotate::Rotate;
pub use stage_times::StageTimes;
pub use steps::Pipeline;
pub use working_resolution::ReducedHindsight;

pub use crate::parts::{LoadedNetworks, ObjectToName};
