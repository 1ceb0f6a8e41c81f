//! Corrected paths in a recording (`nav_msgs/msg/Path`), as a SLAM system publishes them when it closes a loop.

use super::clock::Recorded;
use super::frame_names::frame_name;
use super::poses::rigid_of_pose;
use super::transforms::Rigid;
use splatseg_ros::{CdrError, NavPath, from_cdr};
use std::collections::BTreeMap;

/// Poses of a path that differ from the last one of the same time by less are not kept: metres, and the cosine of half
/// the angle. A tenth of the least correction.
const SAME_SHIFT: f64 = 1e-4;
const SAME_HALF_TURN: f64 = 4.4e-5;

/// A pose of a path, when it first appears and whenever it changes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PathPose {
    pub(crate) stamp: i64,
    /// Recording time of the path.
    pub(crate) recorded: Recorded,
    pub(crate) transform: Rigid,
}

/// The poses in the messages of a topic.
#[derive(Debug, Default)]
pub(crate) struct PathPoses {
    /// Coordinate frame of the paths.
    pub(crate) world: String,
    /// In file order.
    pub(crate) poses: Vec<PathPose>,
    latest: BTreeMap<i64, Rigid>,
}

impl PathPoses {
    /// Returns true if no message had poses with times.
    pub(crate) fn is_empty(&self) -> bool {
        self.poses.is_empty()
    }

    /// Records the poses of a message that have changed. Returns the memory they use, bytes.
    pub(crate) fn record(&mut self, data: &[u8], recorded: Recorded) -> Result<u64, CdrError> {
        let path: NavPath = from_cdr(data)?;
        let stamped = path.poses.iter().map(|pose| (pose.header.stamp.nanoseconds(), rigid_of_pose(&pose.pose)));
        let stamped: BTreeMap<i64, Rigid> =
            stamped.filter(|(stamp, _)| *stamp > 0).filter_map(|(stamp, pose)| Some((stamp, pose?))).collect();
        // The poses of a planned path have one time or none.
        if stamped.len() == 1 && path.poses.len() > 1 {
            return Ok(0);
        }
        if self.poses.is_empty() {
            self.world = frame_name(&path.header.frame_id);
        }
        let before = self.poses.len();
        for (stamp, transform) in stamped {
            if self.latest.get(&stamp).is_none_or(|old| differ(old, &transform)) {
                self.latest.insert(stamp, transform);
                self.poses.push(PathPose { stamp, recorded, transform });
            }
        }
        Ok(((self.poses.len() - before) * 3 * size_of::<PathPose>()) as u64)
    }
}

fn differ(one: &Rigid, other: &Rigid) -> bool {
    one.translation.distance(other.translation) > SAME_SHIFT
        || one.rotation.dot(other.rotation).abs() < SAME_HALF_TURN.cos()
}
