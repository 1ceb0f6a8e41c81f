//! Results as ROS 2 messages: for recordings of a run, and for a node while it runs.
//!
//! Headers name the coordinate frames [`WORLD`], [`MAP`], [`PLAN`] and [`CAMERA`].

mod depth_messages;
mod frame_messages;
mod object_messages;
mod plan_messages;

pub use depth_messages::{DepthPixels, depth_image};
pub(crate) use frame_messages::number;
pub use frame_messages::{CameraPose, IdPixels, camera_info, camera_pose, color_png, id_image, map_origin, overlay};
pub(crate) use object_messages::{BOX_OPACITY, TEXT_HEIGHT};
pub use object_messages::{PointBytes, ShownObject, all_markers, detections, markers};
pub use plan_messages::{occupancy_grid, plan_transform};

/// The coordinate frame of camera poses and objects.
pub const WORLD: &str = "world";
/// The coordinate frame of the map, if its origin is not the world's.
pub const MAP: &str = "splatseg_map";
/// The coordinate frame of the plan, if z does not point up in the world: the world turned, with the floor at z = 0.
pub const PLAN: &str = "splatseg_plan";
/// The optical frame of the camera: x right, y down, z forward.
pub const CAMERA: &str = "camera";
