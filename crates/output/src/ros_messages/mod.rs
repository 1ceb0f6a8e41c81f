//! Results as ROS 2 messages: for recordings of a run, and for a node while it runs.
//!
//! Headers name the coordinate frames [`WORLD`], [`MAP`] and [`CAMERA`].

mod depth_messages;
mod frame_messages;
mod object_messages;

pub use depth_messages::{DepthPixels, depth_image};
pub(crate) use frame_messages::number;
pub use frame_messages::{CameraPose, IdPixels, camera_info, camera_pose, color_png, id_image, map_origin, overlay};
pub(crate) use object_messages::{BOX_OPACITY, TEXT_HEIGHT};
pub use object_messages::{PointBytes, ShownObject, detections, markers};

/// The coordinate frame of camera poses and objects.
pub const WORLD: &str = "world";
/// The coordinate frame of the map, if its origin is not the world's.
pub const MAP: &str = "splatseg_map";
/// The optical frame of the camera: x right, y down, z forward.
pub const CAMERA: &str = "camera";
