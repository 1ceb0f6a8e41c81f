//! Rooms keep their numbers when the map is corrected.

use glam::DVec3;
use splatseg::dataset::{Scene, SyntheticScene};
use splatseg::geometry::Pose;
use splatseg::pipeline::PlanBeside;
use splatseg::places::{FloorPlan, PlanSettings};
use splatseg::{Pipeline, Settings};
use splatseg_test_scenes::room;
use std::time::{Duration, Instant};

const FRAMES: usize = 20;

/// Numbers of the rooms and where they are, world coordinates, metres.
fn rooms(plan: &FloorPlan) -> Vec<(u32, DVec3)> {
    plan.rooms().iter().map(|room| (room.id, plan.frame().to_world(room.middle))).collect()
}

/// A pipeline that has seen all frames of a scene but the last.
fn pipeline(scene: &SyntheticScene) -> Pipeline {
    let mut pipeline = Pipeline::builder(&Settings::default()).build().unwrap();
    (0..FRAMES - 1).for_each(|index| drop(pipeline.step(&scene.read_frame(index).unwrap()).unwrap()));
    pipeline
}

fn scene() -> SyntheticScene {
    room(&format!("synthetic:frames={FRAMES},width=96,height=72,objects=6"))
}

/// Moves the map, as if it had been found in another one, and processes the last frame there.
fn correct(pipeline: &mut Pipeline, scene: &SyntheticScene) -> Pose {
    let moved = Pose::from_translation(DVec3::new(20.0, 0.0, 0.0));
    let frame = |index| scene.read_frame(index).unwrap();
    let corrected: Vec<(usize, Pose)> =
        (0..FRAMES - 1).map(|index| (index, moved * *frame(index).world_from_camera())).collect();
    pipeline.correct_poses(&corrected);
    let last = frame(FRAMES - 1);
    let pose = moved * *last.world_from_camera();
    pipeline.step(&last.into_camera_frame().at(pose)).unwrap();
    moved
}

/// Asserts that two plans have the same rooms, of which those of the second are 20 m further on.
fn assert_moved(before: &[(u32, DVec3)], after: &[(u32, DVec3)], moved: Pose) {
    assert!(!before.is_empty());
    let ids = |rooms: &[(u32, DVec3)]| rooms.iter().map(|(id, _)| *id).collect::<Vec<_>>();
    assert_eq!(ids(before), ids(after));
    for ((_, before), (_, after)) in before.iter().zip(after) {
        let apart = (*before + moved.translation()).distance(*after);
        assert!(apart < 1.0, "{before} {after}");
    }
}

#[test]
fn rooms_move_with_a_corrected_map_and_keep_their_numbers() {
    let scene = scene();
    let mut pipeline = pipeline(&scene);
    let before = rooms(&pipeline.floor_plan(PlanSettings::default()).unwrap());
    let moved = correct(&mut pipeline, &scene);
    let after = rooms(&pipeline.floor_plan(PlanSettings::default()).unwrap());
    assert_moved(&before, &after, moved);
}

#[test]
fn a_plan_begun_before_a_correction_leaves_the_rooms_where_they_are_after_it() {
    let scene = scene();
    let mut pipeline = pipeline(&scene);
    let mut beside = PlanBeside::start(PlanSettings::default(), Duration::ZERO).unwrap();
    assert!(beside.step(&mut pipeline, true).is_none());
    let moved = correct(&mut pipeline, &scene);
    let started = Instant::now();
    let made = loop {
        assert!(started.elapsed() < Duration::from_secs(20), "no plan");
        match beside.step(&mut pipeline, false) {
            Some(made) => break made.unwrap(),
            None => std::thread::sleep(Duration::from_millis(5)),
        }
    };
    let before = rooms(made.plan.as_ref().unwrap());
    let after = rooms(&pipeline.floor_plan(PlanSettings::default()).unwrap());
    assert_moved(&before, &after, moved);
}
