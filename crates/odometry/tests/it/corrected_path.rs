//! Given poses that another program corrects later move the keyframes that were made from them.

use crate::scene::{corner, render};
use splatseg_geometry::Pose;
use splatseg_odometry::{PoseInput, PoseMode, PoseSource, TrackedPoses};

#[test]
fn keyframes_move_with_the_corrected_poses_of_their_frames() {
    let pose = |number: usize| Pose::from_translation(glam::DVec3::new(0.2 * number as f64, 0.0, 0.0));
    let shifted =
        |number: usize| Pose::from_translation(glam::DVec3::new(0.0, 0.05 * number as f64, 0.0)) * pose(number);
    let mut poses = TrackedPoses::new(PoseMode::Given);
    for number in 0..4 {
        let given = pose(number);
        let update = poses.pose(&render(&corner(), &given), PoseInput::new(number, Some(&given))).unwrap();
        assert!(update.correction.is_none());
        assert_eq!(update.anchor.world_from_keyframe, given);
    }
    // Frame 2 has no corrected pose: its keyframe moves like that of frame 1.
    let corrected: Vec<(usize, Pose)> = [1, 3].map(|number| (number, shifted(number))).to_vec();
    // A frame without a pose is refused; the next one returns its news.
    let without = PoseInput { corrected: &corrected, ..PoseInput::new(4, None) };
    assert!(poses.pose(&render(&corner(), &pose(4)), without).is_err());
    let given = shifted(4);
    let update = poses.pose(&render(&corner(), &given), PoseInput::new(5, Some(&given))).unwrap();
    let correction = update.correction.unwrap();
    assert_eq!(correction.new_from_old.keys().copied().collect::<Vec<_>>(), [1, 2, 3]);
    let found = poses.keyframes();
    assert!(found.iter().all(|(id, place)| poses.keyframe(*id) == Some(*place)), "one by one, too");
    assert_eq!(poses.keyframe(99), None);
    let position = |id: u32| found[&id].world_from_keyframe.translation();
    let close = |id: u32, expected: Pose| position(id).distance(expected.translation()) < 1e-12;
    assert!(close(0, pose(0)) && close(1, shifted(1)) && close(3, shifted(3)));
    assert!((position(2).y - 0.05).abs() < 1e-12);
}
