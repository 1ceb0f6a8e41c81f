//! Basic types shared by all splatseg crates: cameras, poses, RGB-D frames, masks and segment maps.
//!
//! Conventions of the whole project:
//!
//! - World coordinates are in metres. Camera axes are x right, y down, z forward.
//! - Poses are camera-to-world ([`Pose`], named `world_from_camera`), in double precision. Computations near a camera
//!   are in single precision, relative to a nearby origin ([`LocalPose`]).
//! - Pixel `(column, row)` has its **centre at the integer coordinates** `(column, row)`, as in OpenCV, ROS, ScanNet
//!   and 7-Scenes. (gsplat puts the centre at `(column + 0.5, row + 0.5)`, so its `cx` is ours plus 0.5.)
//! - Depth is z-depth in metres as `f32`; 0 means "no measurement".
//! - Segment id 0 means "no segment".
//! - Images are row-major, `[height, width]`.
//!
//! This crate does no I/O and starts no threads.

mod affinities;
mod assignment;
mod cholesky;
mod distance_transform;
mod distortion;
mod flood_fill;
mod frame;
mod image;
mod intrinsics;
mod linking;
mod local_pose;
mod map_copy;
mod map_correction;
mod map_view;
mod mask;
mod mask_runs;
mod pose;
mod pose_format;
mod prompt;
mod quarter_turn;
mod rle;
mod segment_map;
mod segmentation;
mod stamped_pose;
mod up;

pub use affinities::{Affinities, AffinityPlane};
pub use assignment::{Candidate, Ratio, best_assignment};
pub use cholesky::Cholesky;
pub use distance_transform::distance_transform;
pub use distortion::{Distortion, DistortionError};
pub use flood_fill::flood_fill;
pub use frame::{CameraFrame, FrameError, RgbdFrame};
pub use image::{CowImage, Image, ImageSizeError};
pub use intrinsics::{Intrinsics, IntrinsicsError};
pub use linking::MaskLinker;
pub use local_pose::LocalPose;
pub use map_copy::MapCopy;
pub use map_correction::{FrameAnchor, KeyframeId, MapCorrection, RemappedId};
pub use map_view::{MapGaussian, MapSegments, MapView, PatchSize, SurfaceKind};
pub use mask::{Mask, ScoredMask};
pub use mask_runs::MaskRuns;
pub use pose::{Pose, PoseError};
pub use pose_format::{CameraAxes, PoseFormat};
pub use prompt::{Click, Prompt};
pub use quarter_turn::QuarterTurn;
pub use rle::{RleError, RunLengths};
pub use segment_map::{MAX_16_BIT_ID, MAX_SEGMENT_ID, SegmentId, SegmentMap};
pub use segmentation::Segmentation;
pub use stamped_pose::StampedPose;
pub use up::UpEstimate;

/// Target of the `tracing` spans that measure the stages of a frame. The span's name is the stage's, e.g. `match`.
pub const STAGE_TARGET: &str = "splatseg::stage";

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
