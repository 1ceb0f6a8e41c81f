//! Views that contradict the map: poses that jump, large objects that leave, frames with wrong depth.

use super::run::{Run, evidence};
use super::scene::{Scene, Shot, Solid, pose};
use splatseg_geometry::{Pose, SegmentId};
use splatseg_memory::SplatMemory;
use std::collections::{BTreeMap, BTreeSet};

/// A board that fills the view, 1 m in front of the origin.
const BOARD: Solid = Solid { id: 9, min: glam::Vec3::new(-2.0, -2.0, 1.0), max: glam::Vec3::new(2.0, 2.0, 1.1) };

/// Shows each shot as the method does. Returns the ids of each true mask over all shots.
fn ids_of(run: &mut Run, shots: &[Shot]) -> BTreeMap<SegmentId, BTreeSet<SegmentId>> {
    let mut ids: BTreeMap<SegmentId, BTreeSet<SegmentId>> = BTreeMap::new();
    for shot in shots {
        for (truth, id) in run.show_matched(shot) {
            ids.entry(truth).or_default().insert(id);
        }
    }
    ids
}

/// Poses of a jump: to each side, forwards, backwards and turned.
fn jumps() -> Vec<Pose> {
    let offsets =
        [[0.4, 0.0, 0.0], [-0.4, 0.0, 0.0], [0.0, 0.3, 0.0], [0.0, 0.0, 0.5], [0.0, 0.0, -0.5], [0.2, 0.2, 0.2]];
    offsets
        .into_iter()
        .map(|offset| pose(offset, 0.0))
        .chain([pose([0.0; 3], 12.0), pose([0.3, 0.0, 0.3], -9.0)])
        .collect()
}

#[test]
fn when_poses_jump_the_map_moves_with_them() {
    for jump in jumps() {
        let mut run = Run::new(evidence());
        let before = Scene::boxes().seen_from_origin();
        let after = before.clone().with_pose(jump);
        let there: Vec<Shot> = [vec![before.clone(); 6], vec![after.clone(); 12]].concat();
        let mut ids = ids_of(&mut run, &there[..6]);
        let count = run.memory.gaussian_count();
        ids_of(&mut run, &there[6..])
            .into_iter()
            .for_each(|(truth, found)| ids.entry(truth).or_default().extend(found));
        assert!(ids.values().all(|ids| ids.len() == 1), "{jump:?}: {ids:?}");
        assert_eq!(run.memory.gaussian_count(), count, "{jump:?}: no Gaussian is duplicated");
        let back = ids_of(&mut run, &vec![before; 6]);
        assert_eq!((back, run.memory.gaussian_count()), (ids, count), "{jump:?}, and back");
    }
}

#[test]
fn the_map_moves_with_a_jump_while_the_camera_moves() {
    let scene = Scene::boxes();
    for jump in jumps() {
        let mut run = Run::new(evidence());
        let shot = |step: usize| scene.seen_from(pose([0.02 * step as f32, 0.0, 0.0], 0.5 * step as f32));
        let jumped = |shot: Shot| {
            let pose = jump * shot.pose;
            shot.with_pose(pose)
        };
        let shots: Vec<Shot> = (0..8).map(shot).chain((8..20).map(|step| jumped(shot(step)))).collect();
        let ids = ids_of(&mut run, &shots);
        assert!(ids.values().all(|ids| ids.len() == 1), "{jump:?}: {ids:?}");
    }
}

#[test]
fn a_moving_camera_is_no_jump() {
    let scene = Scene::room();
    let mut run = Run::new(evidence());
    for step in 0..72 {
        let shot = scene.seen_from(pose([0.0; 3], 10.0 * step as f32));
        run.show_matched(&shot);
        let frame = shot.frame();
        let mean = run.means()[0];
        run.memory.update(run.memory.recall(&frame), &shot.truth.map(|_| 0), &BTreeSet::new()).unwrap();
        assert_eq!(run.means()[0], mean, "step {step}");
    }
}

#[test]
fn a_large_object_that_leaves_is_removed_within_five_frames() {
    for distance in [0.0, -0.3] {
        let board = BOARD.moved(glam::Vec3::Z * distance);
        let mut run = Run::new(evidence());
        run.show_times(&Scene::boxes().with(board).seen_from_origin(), 10);
        let behind = Scene::boxes().seen_from_origin();
        let ids = ids_of(&mut run, &vec![behind.clone(); 5]);
        assert_eq!(run.count_in(&board, 0.02), 0, "the board at {distance} m is removed");
        let later = ids_of(&mut run, &vec![behind.clone(); 20]);
        assert!(later.values().all(|ids| ids.len() == 1) && later == ids, "{ids:?}, later {later:?}");
        let mut fresh = Run::new(evidence());
        fresh.show_times(&behind, 5);
        let (found, expected) = (run.memory.gaussian_count(), fresh.memory.gaussian_count());
        assert!(found.abs_diff(expected) * 20 <= expected, "{found} Gaussians, {expected} without the board");
    }
}

#[test]
fn a_frame_that_disagrees_alone_changes_nothing() {
    let (board, behind) = (Scene::boxes().with(BOARD).seen_from_origin(), Scene::boxes().seen_from_origin());
    let mut run = Run::new(evidence());
    run.show_times(&board, 5);
    let means = run.means().to_vec();
    for _ in 0..4 {
        assert_eq!(run.show(&behind).update.removed, 0);
        let expected = run.show(&board).expected;
        assert!(expected.pixels().iter().all(|id| *id == BOARD.id), "the board is still expected");
    }
    assert_eq!(run.means(), means);
}

#[test]
fn frames_that_disagree_with_each_other_change_nothing() {
    let mut run = Run::new(evidence());
    run.show_times(&Scene::boxes().with(BOARD).seen_from_origin(), 5);
    let known = run.count_in(&BOARD, 0.02);
    for distance in [2.0, 3.0, 4.5, 2.5, 6.0, 3.5, 8.0, 2.0, 5.0, 3.0] {
        let wall = Scene(vec![Solid::new(1, [0.0, 0.0, distance], [40.0, 40.0, 0.1])]).seen_from_origin();
        assert_eq!(run.show(&wall).update.removed, 0, "a wall at {distance} m");
    }
    assert_eq!(run.count_in(&BOARD, 0.02), known);
}

#[test]
fn a_bad_first_pose_is_overcome() {
    let scene = Scene::room();
    let mut run = Run::new(evidence());
    let wrong = scene.seen_from(pose([0.0, 0.0, -1.2], 0.0)).with_pose(pose([0.0, 0.0, 0.0], 180.0));
    run.show_matched(&wrong);
    let shots: Vec<Shot> = (0..40).map(|step| scene.seen_from(pose([0.0; 3], 120.0 + 6.0 * step as f32))).collect();
    ids_of(&mut run, &shots[..20]);
    let ids = ids_of(&mut run, &shots[20..]);
    assert!(ids.values().all(|ids| ids.len() == 1), "{ids:?}");
}

#[test]
fn a_memory_saved_during_a_contradiction_continues_unchanged() {
    let folder = tempfile::tempdir().unwrap();
    let behind = Scene::boxes().seen_from_origin();
    for saved_after in 0..5 {
        let mut run = Run::new(evidence());
        ids_of(&mut run, &vec![Scene::boxes().with(BOARD).seen_from_origin(); 5]);
        ids_of(&mut run, &vec![behind.clone(); saved_after]);
        let path = folder.path().join(format!("{saved_after}.ply"));
        run.memory.save(&path).unwrap();
        let mut continued = Run { memory: SplatMemory::load(&path, evidence()).unwrap() };
        for _ in 0..6 {
            assert_eq!(continued.show_matched(&behind), run.show_matched(&behind), "saved after {saved_after}");
            assert_eq!(continued.means(), run.means(), "saved after {saved_after}");
        }
    }
}
