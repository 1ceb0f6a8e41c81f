//! Corrected poses of earlier frames, by the frame with which they become known.

use glam::DQuat;
use splatseg_geometry::Pose;
use std::collections::BTreeMap;
use std::ops::Range;

/// Smaller corrections are left out, metres...
const MIN_SHIFT: f64 = 1e-3;
/// ...and degrees.
const MIN_TURN: f64 = 0.05;

/// A pose of an earlier frame, corrected by the program that recorded the poses, e.g. when it closed a loop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CorrectedPose {
    /// Index of the corrected frame in its source.
    pub frame: usize,
    /// Its corrected pose.
    pub world_from_camera: Pose,
}

/// The corrected poses of a scene.
#[derive(Debug, Default)]
pub(crate) struct CorrectionList {
    /// For each frame, the corrected poses that become known with it, by corrected frame.
    by_frame: BTreeMap<usize, BTreeMap<usize, Pose>>,
    /// Latest pose of each corrected frame.
    latest: BTreeMap<usize, Pose>,
}

impl CorrectionList {
    /// Adds the pose of a frame that becomes known with a later one, unless it is about the one given before. `given` is
    /// the pose of the frame itself. Call in the order in which poses become known.
    pub(crate) fn add(&mut self, known_with: usize, frame: usize, given: Option<Pose>, corrected: Pose) {
        let before = self.latest.get(&frame).copied().or(given);
        if frame < known_with && before.is_none_or(|before| differ(&before, &corrected)) {
            self.latest.insert(frame, corrected);
            self.by_frame.entry(known_with).or_default().insert(frame, corrected);
        }
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.by_frame.is_empty()
    }

    /// Returns the number of frames that are corrected at least once.
    pub(crate) fn corrected_frames(&self) -> usize {
        self.latest.len()
    }

    /// Returns the last correction of each frame that becomes known with a range of frames, by increasing frame.
    pub(crate) fn known_with(&self, frames: Range<usize>) -> Vec<CorrectedPose> {
        if frames.is_empty() {
            return Vec::new();
        }
        let lists = self.by_frame.range(frames).map(|(_, list)| list);
        let last: BTreeMap<usize, Pose> = lists.flatten().map(|(frame, pose)| (*frame, *pose)).collect();
        last.into_iter().map(|(frame, world_from_camera)| CorrectedPose { frame, world_from_camera }).collect()
    }
}

/// Returns true if two poses differ by more than the least correction.
fn differ(one: &Pose, other: &Pose) -> bool {
    let [first, second] = [one, other].map(|pose| DQuat::from_mat3(&pose.rotation()));
    let turned = first.dot(second).abs() < (MIN_TURN / 2.0).to_radians().cos();
    turned || one.translation().distance(other.translation()) > MIN_SHIFT
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    fn pose(x: f64, degrees: f64) -> Pose {
        Pose::from_quaternion(DVec3::new(x, 0.0, 0.0), DQuat::from_rotation_z(degrees.to_radians())).unwrap()
    }

    #[test]
    fn small_differences_and_later_frames_are_left_out() {
        let mut list = CorrectionList::default();
        list.add(5, 2, Some(pose(0.0, 0.0)), pose(0.0009, 0.04));
        list.add(5, 5, None, pose(1.0, 0.0));
        assert!(list.is_empty());
        list.add(5, 2, Some(pose(0.0, 0.0)), pose(0.0011, 0.0));
        list.add(6, 2, Some(pose(0.0, 0.0)), pose(0.0011, 0.06));
        list.add(6, 3, None, pose(0.0, 0.0));
        list.add(7, 2, Some(pose(0.0, 0.0)), pose(0.0015, 0.08));
        let found = |range| list.known_with(range).iter().map(|found| found.frame).collect::<Vec<_>>();
        assert_eq!((found(0..5), found(5..6), found(6..7), found(7..9)), (vec![], vec![2], vec![2, 3], vec![]));
        assert_eq!(list.known_with(0..9)[0].world_from_camera, pose(0.0011, 0.06));
        assert_eq!(list.corrected_frames(), 2);
    }
}
