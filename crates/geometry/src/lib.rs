//! The vocabulary that every other splatseg crate speaks: cameras, poses, RGB-D frames, masks and segment maps.
//!
//! Conventions, the same in the whole project:
//!
//! - World coordinates are in metres. Camera axes are x right, y down, z forward.
//! - Poses are camera-to-world ([`Pose`], named `world_from_camera`), in double precision. What is computed near a camera is
//!   in single precision, relative to an origin nearby ([`LocalPose`]).
//! - Pixel `(column, row)` has its **centre at the integer coordinates** `(column, row)`, as in OpenCV, ROS, ScanNet
//!   and 7-Scenes. (gsplat puts the centre at `(column + 0.5, row + 0.5)`: its `cx` is ours plus 0.5.)
//! - Depth is z-depth in metres as `f32`; 0 means that there is no measurement.
//! - Segment id 0 means "no segment".
//! - Images are row-major, `[height, width]`.
//!
//! No I/O and no threads live here.

mod assignment;
mod distance_transform;
mod distortion;
mod frame;
mod image;
mod intrinsics;
mod linking;
mod local_pose;
mod mask;
mod mask_runs;
mod pose;
mod rle;
mod segment_map;

pub use assignment::{Candidate, Ratio, best_assignment};
pub use distance_transform::distance_transform;
pub use distortion::{Distortion, DistortionError};
pub use frame::{FrameError, RgbdFrame};
pub use image::{CowImage, Image, ImageSizeError};
pub use intrinsics::{Intrinsics, IntrinsicsError};
pub use linking::MaskLinker;
pub use local_pose::LocalPose;
pub use mask::{Mask, ScoredMask};
pub use mask_runs::MaskRuns;
pub use pose::{Pose, PoseError};
pub use rle::{RleError, RunLengths};
pub use segment_map::{SegmentId, SegmentMap};

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
