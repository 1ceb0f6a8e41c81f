//! ROS 2 messages recorded by cameras and robots: structs, their CDR encoding, and their interface definitions.
//!
//! [`from_cdr`] and [`to_cdr`] convert between a message and the bytes of a recording. Images, which are most of a
//! recording, borrow their bytes. [`Interface::schema`] returns the schema of a type in an MCAP recording (schema
//! encoding `ros2msg`).

#[macro_use]
mod interface;

mod cdr;
mod diagnostic_msgs;
mod geometry_msgs;
mod nav_msgs;
mod sensor_msgs;
mod std_msgs;
mod std_srvs;
mod vision_msgs;
mod visualization_msgs;

pub use cdr::{CdrError, from_cdr, to_cdr};
pub use diagnostic_msgs::{DiagnosticArray, DiagnosticStatus, KeyValue};
pub use geometry_msgs::{
    NavPath, Odometry, Point, PoseMessage, PoseStamped, PoseWithCovariance, PoseWithCovarianceStamped, Quaternion,
    TfMessage, Transform, TransformStamped, Twist, TwistWithCovariance, Vector3,
};
pub use interface::{Interface, Message};
pub use nav_msgs::{MapMetaData, OccupancyGrid};
pub use sensor_msgs::{CameraInfo, CompressedImage, Image, PointCloud2, PointField, RegionOfInterest};
pub use std_msgs::{ColorRgba, Duration, Float32Message, Header, TextMessage, Time};
pub use std_srvs::{EmptyRequest, SetBoolRequest, SuccessResponse};
pub use vision_msgs::{BoundingBox3d, Detection3d, Detection3dArray, ObjectHypothesis, ObjectHypothesisWithPose};
pub use visualization_msgs::{Marker, MarkerArray, MeshFile, UvCoordinate, action, marker_type};

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
