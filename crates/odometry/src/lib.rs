//! The pose of an RGB-D camera, tracked from frame to frame on the CPU.
//!
//! [`Odometry`] aligns each frame with a keyframe, an earlier frame with a known pose. Geometry (distances from the
//! keyframe's surfaces) and image (luminance at the keyframe's points) form one 6×6 system, solved from coarse to fine.
//! A [`PoseSource`] decides for each frame between the pose that came with it and a tracked one.
//!
//! | file | |
//! | --- | --- |
//! | `pose_source.rs` | the trait, and poses that come with the frames |
//! | `tracked_source.rs`, `tracked_poses.rs` | poses that are tracked, always or where they are missing, or refined |
//! | `pose_event.rs` | what else is found out: loops, new parts of the map, a camera that was found |
//! | `input_doubt.rs` | what is conspicuous about the input |
//! | `odometry.rs` | a frame in, its pose out; choice of keyframes; loss and return |
//! | `tracked_frame.rs`, `pyramid.rs` | a frame at several resolutions |
//! | `reference.rs` | the points of a keyframe, with planes and image gradients |
//! | `alignment.rs`, `sums.rs`, `linear.rs` | residuals, weights and the system |
//! | `prior.rs` | the motion model |
//! | `motion_test.rs` | which segments moved by themselves in one frame |
//! | `movers.rs` | weights of segments that move by themselves |
//! | `plausibility.rs` | doubts about the focal length |
//! | `upright.rs` | where up is, and by which turn the images are upright |
//! | `input_checks/` | whether given poses and units fit what the frames show |
//! | `search.rs` | a start when the motion model fails |
//! | `keyframes/` | the keyframes of the whole map, in little memory |
//! | `relocalisation/` | recognises the place that a frame shows |
//! | `relocaliser.rs` | where single frames were taken, in a saved map |
//! | `lost.rs` | the search for a lost camera, and new parts of the map |
//! | `map_joining/` | joins the keyframes of two maps of one place |
//! | `keyframe_map.rs`, `loops.rs`, `loop_closing.rs`, `graph/` | relative poses of keyframes, loops, the correction of all poses |
//! | `se3.rs` | rigid motions as six numbers |
//! | `saved.rs`, `saved_keyframes.rs` | the state of a run that is resumed; keyframes saved with a map |
//! | `old_keyframes.rs` | keyframes in maps of an earlier version |
//! | `read_keyframes.rs` | whether keyframes from a file belong together |

mod alignment;
mod graph;
mod input_checks;
mod input_doubt;
mod keyframe;
mod keyframe_map;
mod keyframes;
mod linear;
mod loop_closing;
mod loops;
mod lost;
mod map_joining;
mod motion_test;
mod movers;
mod odometry;
mod old_keyframes;
mod plausibility;
mod pose_event;
mod pose_source;
mod pose_state;
mod prior;
mod pyramid;
mod read_keyframes;
mod reference;
mod relocalisation;
mod relocaliser;
mod saved;
mod saved_keyframes;
mod se3;
mod search;
mod segment_runs;
mod sums;
mod tracked_frame;
mod tracked_poses;
mod tracked_source;
mod upright;

pub use input_doubt::{DoubtKind, InputDoubt};
pub use map_joining::{JoinError, JoinedKeyframes, MapFit, RecognisedCount, erase_surfaces, join_keyframes};
pub use odometry::Odometry;
pub use pose_event::{PoseEvent, PoseEventCounts};
pub use pose_source::{
    GivenPoses, KeyframePlace, MethodFindings, PoseInput, PoseSource, PoseSourceError, PoseUpdate, StateScope,
};
pub use pose_state::{CameraPose, PoseQuality, PoseState};
pub use relocaliser::{LocatedFrame, Relocaliser};
pub use saved_keyframes::{KeyframeView, keyframe_views};
pub use tracked_poses::{PoseMode, TrackedPoses};
