//! Scenes far from the world's origin.

use super::run::{Run, evidence, features};
use super::scene::{Scene, Shot, pose};
use glam::{DVec3, Vec3};
use splatseg_geometry::Pose;
use splatseg_memory::{MemorySettings, SplatMemory};

/// A walk through a room in world coordinates moved by `offset`.
fn walk(offset: DVec3, frames: usize) -> Vec<Shot> {
    let shot = |step: usize| {
        let shot = Scene::room().seen_from(pose([0.03 * step as f32, 0.0, -0.02 * step as f32], 2.0 * step as f32));
        let moved = Pose::from_translation(offset) * shot.pose;
        shot.with_pose(moved)
    };
    (0..frames).map(shot).collect()
}

/// The memory of the walk.
fn memory_at(offset: DVec3, settings: &MemorySettings) -> SplatMemory {
    let mut run = Run::new(settings.clone());
    for shot in walk(offset, 12) {
        run.show_matched(&shot);
    }
    run.memory
}

/// Positions in the coordinates of the scene before it was moved by `offset`.
fn positions(memory: &SplatMemory, offset: DVec3) -> Vec<Vec3> {
    memory.map().means.iter().map(|mean| (mean.as_dvec3() + (memory.map().origin - offset)).as_vec3()).collect()
}

#[test]
fn a_scene_in_map_coordinates_is_remembered_as_it_is_at_the_origin() {
    for settings in [evidence(), features()] {
        let near = memory_at(DVec3::ZERO, &settings);
        assert_eq!(near.map().origin, DVec3::ZERO);
        for offset in [DVec3::new(5e5, 5.4e6, 0.0), DVec3::splat(1e7), DVec3::new(-3e4, 200.0, 1e6)] {
            let far = memory_at(offset, &settings);
            assert!((far.map().origin - offset).abs().max_element() < 20.0, "{}", far.map().origin);
            assert_eq!(
                (far.gaussian_count(), far.map().segment_ids()),
                (near.gaussian_count(), near.map().segment_ids())
            );
            for (found, expected) in positions(&far, offset).into_iter().zip(near.map().means) {
                assert!(found.distance(*expected) < 2e-5, "{found} {expected}");
            }
        }
    }
}

#[test]
fn the_origin_follows_a_long_drive_and_places_stay_where_they_are() {
    // A wall every 100 m along a street of 3 km, there and back.
    let wall = |x: f64| {
        let shot = Scene::boxes().seen_from_origin();
        shot.with_pose(Pose::from_translation(DVec3::new(x, -0.3 * x, 0.0)))
    };
    let mut run = Run::new(evidence());
    let there: Vec<f64> = (0..30).map(|step| 100.0 * f64::from(step)).collect();
    let ids: Vec<_> = there.iter().map(|x| run.show_matched(&wall(*x))).collect();
    assert!(
        (run.memory.map().origin - DVec3::new(2900.0, -870.0, 0.0)).length() < 200.0,
        "{}",
        run.memory.map().origin
    );
    let count = run.memory.gaussian_count();
    for (x, ids) in there.iter().zip(ids).rev() {
        assert_eq!(run.show_matched(&wall(*x)), ids, "at {x} m");
    }
    assert_eq!(run.memory.gaussian_count(), count, "no Gaussian was lost or added");
    let first = positions(&run.memory, DVec3::ZERO)[0];
    let mut fresh = Run::new(evidence());
    fresh.show_matched(&wall(0.0));
    assert!(first.distance(fresh.means()[0]) < 5e-4, "{first} {}", fresh.means()[0]);
}

#[test]
fn poses_that_jump_to_map_coordinates_and_back_keep_ids_and_gaussians() {
    let settings = evidence();
    let mut run = Run::new(settings.clone());
    let still = walk(DVec3::ZERO, 1).remove(0);
    let far = still.clone().with_pose(Pose::from_translation(DVec3::new(5e5, 5.4e6, 90.0)) * still.pose);
    let ids = run.show_matched(&still);
    run.show_matched(&still);
    let (count, before) = (run.memory.gaussian_count(), positions(&run.memory, DVec3::ZERO));
    for shot in [&far, &far, &still, &still, &far, &still] {
        assert_eq!(run.show_matched(shot), ids);
    }
    assert_eq!(run.memory.gaussian_count(), count);
    for (found, expected) in positions(&run.memory, DVec3::ZERO).into_iter().zip(before) {
        assert!(found.distance(expected) < 1e-4, "{found} {expected}");
    }
}

#[test]
fn a_lone_pose_far_away_does_not_round_the_map() {
    for distance in [1e6, 1e8] {
        let mut run = Run::new(evidence());
        let shot = Scene::boxes().seen_from_origin();
        run.show_times(&shot, 5);
        let (before, origin) = (run.positions(), run.memory.map().origin);
        let other = Scene::room().seen_from(pose([0.0; 3], 90.0));
        let lost = other.with_pose(Pose::from_translation(DVec3::splat(distance)));
        for _ in 0..4 {
            run.show_times(&lost, 2);
            run.show(&shot);
        }
        assert_eq!((run.positions(), run.memory.map().origin), (before, origin));
        // The pose is not a mistake if the camera stays there.
        run.show_times(&lost, 3);
        assert!(run.memory.map().origin.length() > distance);
    }
}

#[test]
fn a_saved_memory_has_its_origin() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("far.ply");
    let offset = DVec3::new(5e5, 5.4e6, 12.0);
    let mut run = Run { memory: memory_at(offset, &evidence()) };
    run.memory.save(&path).unwrap();
    let text = String::from_utf8_lossy(&std::fs::read(&path).unwrap()[..400]).into_owned();
    assert!(text.contains("\ncomment origin 500000 5400000 16\n"), "{text}");
    let mut continued = Run { memory: SplatMemory::load(&path, evidence()).unwrap() };
    assert_eq!(continued.memory.map().origin, run.memory.map().origin);
    for shot in walk(offset, 20).iter().skip(12) {
        assert_eq!(continued.show_matched(shot), run.show_matched(shot));
    }
    assert_eq!((continued.means(), continued.memory.map().origin), (run.means(), run.memory.map().origin));
}
