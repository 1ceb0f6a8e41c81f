//! Given poses that another program corrects later move the keyframes that were made from them.

use crate::scene::{corner, render};
use splatseg_geometry::Pose;
use splatseg_odometry::{PoseMode, PoseSource, TrackedPoses};

#[test]
fn keyframes_move_with_the_corrected_poses_of_their_frames() {
    let pose = |number: usize| Pose::from_translation(glam::DVec3::new(0.2 * number as f64, 0.0, 0.0));
    let shifted =
        |number: usize| Pose::from_translation(glam::DVec3::new(0.0, 0.05 * number as f64, 0.0)) * pose(number);
    let mut poses = TrackedPoses::new(PoseMode::Given);
    for number in 0..4 {
        poses.begin_frame(number, &[]);
        poses.pose(&render(&corner(), &pose(number)), Some(&pose(number))).unwrap();
        assert!(poses.take_correction().is_none());
        assert_eq!(poses.anchor().world_from_keyframe, pose(number));
    }
    // Frame 2 has no corrected pose: its keyframe moves like that of frame 1.
    let corrected: Vec<(usize, Pose)> = [1, 3].map(|number| (number, shifted(number))).to_vec();
    poses.begin_frame(4, &corrected);
    let correction = poses.take_correction().unwrap();
    assert_eq!(correction.new_from_old.keys().copied().collect::<Vec<_>>(), [1, 2, 3]);
    let found = poses.keyframe_poses();
    let close = |id: u32, expected: Pose| found[&id].translation().distance(expected.translation()) < 1e-12;
    assert!(close(0, pose(0)) && close(1, shifted(1)) && close(3, shifted(3)));
    assert!((found[&2].translation().y - 0.05).abs() < 1e-12);
}
