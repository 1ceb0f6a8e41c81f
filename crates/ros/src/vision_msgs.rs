//! `vision_msgs` 4, of ROS 2 Humble and later.

use crate::{Header, Interface, Message, PoseMessage, PoseWithCovariance, Vector3};
use serde::{Deserialize, Serialize};

message! {
    /// A class of an object (`vision_msgs/msg/ObjectHypothesis`).
    ObjectHypothesis: Default, "vision_msgs/msg/ObjectHypothesis", "string class_id\nfloat64 score\n", [] {
        /// The class.
        class_id: String,
        /// Its confidence, 0 to 1.
        score: f64,
    }
}

message! {
    /// A class and a pose of an object (`vision_msgs/msg/ObjectHypothesisWithPose`).
    ObjectHypothesisWithPose: Default, "vision_msgs/msg/ObjectHypothesisWithPose",
    "vision_msgs/ObjectHypothesis hypothesis\ngeometry_msgs/PoseWithCovariance pose\n",
    [ObjectHypothesis, PoseWithCovariance] {
        /// The class.
        hypothesis: ObjectHypothesis,
        /// The pose.
        pose: PoseWithCovariance,
    }
}

message! {
    /// A box of any orientation (`vision_msgs/msg/BoundingBox3D`).
    BoundingBox3d: Default, "vision_msgs/msg/BoundingBox3D",
    "geometry_msgs/Pose center\ngeometry_msgs/Vector3 size\n", [PoseMessage, Vector3] {
        /// Its centre and orientation.
        center: PoseMessage,
        /// Its size along its own axes, metres.
        size: Vector3,
    }
}

message! {
    /// An object (`vision_msgs/msg/Detection3D`).
    Detection3d: Default, "vision_msgs/msg/Detection3D",
    "std_msgs/Header header\nvision_msgs/ObjectHypothesisWithPose[] results\nvision_msgs/BoundingBox3D bbox\n\
     string id\n", [Header, ObjectHypothesisWithPose, BoundingBox3d] {
        /// Time of the detection, and the frame of the poses.
        header: Header,
        /// The classes that it may have.
        results: Vec<ObjectHypothesisWithPose>,
        /// Its box.
        bbox: BoundingBox3d,
        /// Its lasting id.
        id: String,
    }
}

message! {
    /// Several objects (`vision_msgs/msg/Detection3DArray`).
    Detection3dArray: Default, "vision_msgs/msg/Detection3DArray",
    "std_msgs/Header header\nvision_msgs/Detection3D[] detections\n", [Header, Detection3d] {
        /// Time of the objects, and the frame of their poses.
        header: Header,
        /// The objects.
        detections: Vec<Detection3d>,
    }
}
