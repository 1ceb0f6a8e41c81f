//! Poses in a recording, from pose, odometry and transform messages.

use super::clock::Recorded;
use super::frame_names::frame_name;
use super::timeline::Timeline;
use super::transforms::{Parts, Rigid, Sample};
use glam::{DQuat, DVec3};
use splatseg_ros::{
    CdrError, Header, Odometry, PoseMessage, PoseStamped, PoseWithCovarianceStamped, Time, TransformStamped, from_cdr,
};

/// Message types with a pose.
#[derive(Clone, Copy, Debug)]
pub(crate) enum PoseType {
    Odometry,
    Pose,
    PoseWithCovariance,
    Transform,
}

/// The poses of a topic.
#[derive(Debug)]
pub(crate) struct Poses {
    kind: PoseType,
    /// Coordinate frame of the poses.
    pub(crate) world: String,
    /// Frame that the poses describe, if the messages name it.
    pub(crate) body: Option<String>,
    pub(crate) timeline: Timeline<Sample>,
}

impl Poses {
    pub(crate) fn new(kind: PoseType) -> Self {
        Self { kind, world: String::new(), body: None, timeline: Timeline::default() }
    }

    /// Records a message. `rigid_of` makes a pose of a position and a quaternion, if they are valid. Returns the memory it
    /// uses, bytes.
    pub(crate) fn record(
        &mut self,
        (data, recorded): (&[u8], Recorded),
        stamp_of: impl Fn(Time) -> i64,
        rigid_of: impl FnOnce(Parts) -> Option<Rigid>,
    ) -> Result<u64, CdrError> {
        let (header, body, parts) = self.kind.read(data)?;
        if self.timeline.unsorted() == 0 {
            self.world = frame_name(&header.frame_id);
            self.body = body.map(|body| frame_name(&body)).filter(|body| !body.is_empty());
        }
        let Some(transform) = rigid_of(parts) else { return Ok(0) };
        self.timeline.record(Sample { stamp: stamp_of(header.stamp), recorded, transform });
        Ok(2 * size_of::<Sample>() as u64)
    }
}

impl PoseType {
    /// Reads the header of a message, the frame it describes if it names one, and the position and quaternion.
    fn read(self, data: &[u8]) -> Result<(Header, Option<String>, Parts), CdrError> {
        Ok(match self {
            Self::Odometry => {
                let message: Odometry = from_cdr(data)?;
                (message.header, Some(message.child_frame_id), parts_of_pose(&message.pose.pose))
            }
            Self::Pose => {
                let message: PoseStamped = from_cdr(data)?;
                (message.header, None, parts_of_pose(&message.pose))
            }
            Self::PoseWithCovariance => {
                let message: PoseWithCovarianceStamped = from_cdr(data)?;
                (message.header, None, parts_of_pose(&message.pose.pose))
            }
            Self::Transform => {
                let message: TransformStamped = from_cdr(data)?;
                let parts = parts_of_transform(&message);
                (message.header, Some(message.child_frame_id), parts)
            }
        })
    }
}

/// Returns the position and the quaternion of a pose, as they are written.
fn parts_of_pose(pose: &PoseMessage) -> Parts {
    let (position, turn) = (&pose.position, &pose.orientation);
    (DVec3::new(position.x, position.y, position.z), DQuat::from_xyzw(turn.x, turn.y, turn.z, turn.w))
}

/// Returns the translation and the quaternion of a transform, as they are written.
pub(crate) fn parts_of_transform(transform: &TransformStamped) -> Parts {
    let (shift, turn) = (&transform.transform.translation, &transform.transform.rotation);
    (DVec3::new(shift.x, shift.y, shift.z), DQuat::from_xyzw(turn.x, turn.y, turn.z, turn.w))
}

/// Returns a pose; `None` if it is invalid.
pub(crate) fn rigid_of_pose(pose: &PoseMessage) -> Option<Rigid> {
    let (position, turn) = parts_of_pose(pose);
    Rigid::new(position, turn)
}
