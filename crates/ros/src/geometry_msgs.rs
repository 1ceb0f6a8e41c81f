//! `geometry_msgs`, `tf2_msgs` and `nav_msgs`.

use crate::{Header, Interface, Message};
use serde::{Deserialize, Serialize};

message! {
    /// A vector (`geometry_msgs/msg/Vector3`).
    Vector3: Default, "geometry_msgs/msg/Vector3", "float64 x\nfloat64 y\nfloat64 z\n", [] {
        /// Along x.
        x: f64,
        /// Along y.
        y: f64,
        /// Along z.
        z: f64,
    }
}

message! {
    /// A point, metres (`geometry_msgs/msg/Point`).
    Point: Default, "geometry_msgs/msg/Point", "float64 x\nfloat64 y\nfloat64 z\n", [] {
        /// Along x.
        x: f64,
        /// Along y.
        y: f64,
        /// Along z.
        z: f64,
    }
}

message! {
    /// A rotation as a unit quaternion (`geometry_msgs/msg/Quaternion`).
    Quaternion, "geometry_msgs/msg/Quaternion", "float64 x 0\nfloat64 y 0\nfloat64 z 0\nfloat64 w 1\n", [] {
        /// First component of the vector part.
        x: f64,
        /// Second component of the vector part.
        y: f64,
        /// Third component of the vector part.
        z: f64,
        /// Scalar part.
        w: f64,
    }
}

impl Default for Quaternion {
    fn default() -> Self {
        Self { x: 0.0, y: 0.0, z: 0.0, w: 1.0 }
    }
}

message! {
    /// A rigid transform (`geometry_msgs/msg/Transform`).
    Transform: Default, "geometry_msgs/msg/Transform",
    "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n", [Vector3, Quaternion] {
        /// Origin of the child frame in the parent frame, metres.
        translation: Vector3,
        /// Rotation from the child frame to the parent frame.
        rotation: Quaternion,
    }
}

message! {
    /// A transform from `child_frame_id` to `header.frame_id` (`geometry_msgs/msg/TransformStamped`).
    TransformStamped: Default, "geometry_msgs/msg/TransformStamped",
    "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform\n", [Header, Transform] {
        /// Time of the transform, and the parent frame.
        header: Header,
        /// The child frame.
        child_frame_id: String,
        /// The transform.
        transform: Transform,
    }
}

message! {
    /// Transforms between frames (`tf2_msgs/msg/TFMessage`).
    TfMessage: Default, "tf2_msgs/msg/TFMessage", "geometry_msgs/TransformStamped[] transforms\n", [TransformStamped] {
        /// The transforms.
        transforms: Vec<TransformStamped>,
    }
}

message! {
    /// A position and an orientation (`geometry_msgs/msg/Pose`).
    PoseMessage: Default, "geometry_msgs/msg/Pose",
    "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n", [Point, Quaternion] {
        /// Origin of the body, metres.
        position: Point,
        /// Rotation from the body's axes to the frame.
        orientation: Quaternion,
    }
}

message! {
    /// A pose with its time and frame (`geometry_msgs/msg/PoseStamped`).
    PoseStamped: Default, "geometry_msgs/msg/PoseStamped",
    "std_msgs/Header header\ngeometry_msgs/Pose pose\n", [Header, PoseMessage] {
        /// Time of the pose, and its frame.
        header: Header,
        /// The pose.
        pose: PoseMessage,
    }
}

message! {
    /// A pose with its covariance (`geometry_msgs/msg/PoseWithCovariance`).
    PoseWithCovariance: Default, "geometry_msgs/msg/PoseWithCovariance",
    "geometry_msgs/Pose pose\nfloat64[36] covariance\n", [PoseMessage] {
        /// The pose.
        pose: PoseMessage,
        /// Covariance of x, y, z and the rotations about these axes, 6×6, row-major.
        covariance: [[f64; 6]; 6],
    }
}

message! {
    /// A pose with its time, frame and covariance (`geometry_msgs/msg/PoseWithCovarianceStamped`).
    PoseWithCovarianceStamped: Default, "geometry_msgs/msg/PoseWithCovarianceStamped",
    "std_msgs/Header header\ngeometry_msgs/PoseWithCovariance pose\n", [Header, PoseWithCovariance] {
        /// Time of the pose, and its frame.
        header: Header,
        /// The pose.
        pose: PoseWithCovariance,
    }
}

message! {
    /// A velocity (`geometry_msgs/msg/Twist`).
    Twist: Default, "geometry_msgs/msg/Twist", "geometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular\n", [Vector3] {
        /// Linear velocity, metres per second.
        linear: Vector3,
        /// Angular velocity, radians per second.
        angular: Vector3,
    }
}

message! {
    /// A velocity with its covariance (`geometry_msgs/msg/TwistWithCovariance`).
    TwistWithCovariance: Default, "geometry_msgs/msg/TwistWithCovariance",
    "geometry_msgs/Twist twist\nfloat64[36] covariance\n", [Twist] {
        /// The velocity.
        twist: Twist,
        /// Covariance of x, y, z and the rotations about these axes, 6×6, row-major.
        covariance: [[f64; 6]; 6],
    }
}

message! {
    /// Pose and velocity of a robot (`nav_msgs/msg/Odometry`).
    Odometry: Default, "nav_msgs/msg/Odometry",
    "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/PoseWithCovariance pose\n\
     geometry_msgs/TwistWithCovariance twist\n", [Header, PoseWithCovariance, TwistWithCovariance] {
        /// Time of the data, and the frame of the pose.
        header: Header,
        /// The frame whose pose is given. The velocity is in its axes.
        child_frame_id: String,
        /// The pose.
        pose: PoseWithCovariance,
        /// The velocity.
        twist: TwistWithCovariance,
    }
}

message! {
    /// A path of a robot (`nav_msgs/msg/Path`).
    NavPath: Default, "nav_msgs/msg/Path",
    "std_msgs/Header header\ngeometry_msgs/PoseStamped[] poses\n", [Header, PoseStamped] {
        /// Time of the path, and the frame of its poses.
        header: Header,
        /// The poses, each with its time.
        poses: Vec<PoseStamped>,
    }
}
