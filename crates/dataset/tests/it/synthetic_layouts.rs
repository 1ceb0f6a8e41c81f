//! Tours and corridors: consistent truth, equal rounds, and views that show enough.

use glam::Vec2;
use splatseg_dataset::{Layout, Motion, Scene, SyntheticScene};
use splatseg_geometry::SegmentId;
use splatseg_test_scenes::{room, truth};
use std::collections::BTreeSet;

/// Returns the fractions of a frame's pixels whose point is visible in another frame, and of these, of the pixels with
/// the same id and colour there.
fn agreement(scene: &SyntheticScene, first: usize, second: usize) -> (f32, f32) {
    let (here, there) = (scene.read_frame(first).unwrap(), scene.read_frame(second).unwrap());
    let [ids_here, ids_there] = [first, second].map(|index| truth(scene, index));
    let (width, height) = ids_here.size();
    let (mut visible, mut same) = (0, 0);
    for row in 0..height {
        for column in 0..width {
            let at = (column, row);
            let point = here.intrinsics().unproject(Vec2::new(column as f32, row as f32), here.depth()[at]);
            let point = there.world_from_camera().to_camera(here.world_from_camera().to_world(point));
            let Some(pixel) = there.intrinsics().project(point).map(Vec2::round) else { continue };
            let is_inside = pixel.cmpge(Vec2::ZERO) & pixel.cmplt(Vec2::new(width as f32, height as f32));
            if !is_inside.all() {
                continue;
            }
            let there_at = (pixel.x as usize, pixel.y as usize);
            if (there.depth()[there_at] - point.z).abs() < 0.03 {
                visible += 1;
                let colors = here.color()[at].iter().zip(there.color()[there_at]);
                let same_color = colors.map(|(one, other)| one.abs_diff(other)).max() < Some(40);
                same += usize::from(ids_here[at] == ids_there[there_at] && same_color);
            }
        }
    }
    (visible as f32 / (width * height) as f32, same as f32 / visible.max(1) as f32)
}

#[test]
fn frames_agree_on_places_ids_and_colours() {
    for (layout, frames) in [("tour=4", 1800), ("tour=1", 600), ("corridor=6", 900)] {
        let scene = room(&format!("synthetic:frames={frames},seed=4,width=160,height=120,{layout}"));
        for first in (0..frames - 8).step_by(frames / 9) {
            let (visible, same) = agreement(&scene, first, first + 8);
            assert!(visible > 0.7, "{layout}, frame {first}: {visible} is visible 8 frames later");
            // The rest are edges of patterns and things.
            assert!(same > 0.85, "{layout}, frame {first}: {same} is the same 8 frames later");
        }
    }
}

#[test]
fn rounds_are_equal_and_do_not_depend_on_the_number_of_frames() {
    for (layout, round) in [("tour=1", 600), ("tour=4", 1800)] {
        let short = room(&format!("synthetic:frames=30,seed=1,width=64,height=48,{layout}"));
        let long = room(&format!("synthetic:frames=4000,seed=1,width=64,height=48,{layout}"));
        assert_eq!((short.frames_per_round(), long.frames_per_round()), (round, round));
        for index in [0, 29] {
            let (first, second) = (long.read_frame(index).unwrap(), long.read_frame(index + round).unwrap());
            assert_eq!(short.read_frame(index).unwrap(), first);
            assert_eq!(first.world_from_camera(), second.world_from_camera());
            assert_eq!((first.color(), first.depth()), (second.color(), second.depth()));
        }
        let slow = room(&format!("synthetic:frames=4000,seed=1,width=64,height=48,{layout},speed=0.5"));
        assert_eq!(slow.frames_per_round(), 2 * round);
        assert_eq!(slow.read_frame(58).unwrap().color(), long.read_frame(29).unwrap().color());
    }
}

#[test]
fn every_view_shows_something_at_a_distance() {
    for (layout, frames) in [("tour=4", 1800), ("tour=1", 600), ("corridor=6", 1000)] {
        for seed in 0..3 {
            let scene = room(&format!("synthetic:frames={frames},seed={seed},width=48,height=36,{layout}"));
            for index in (0..frames).step_by(20) {
                let mut depth = scene.read_frame(index).unwrap().depth().pixels().to_vec();
                depth.sort_by(f32::total_cmp);
                assert!(depth[0] > 0.25, "{layout}, seed {seed}, frame {index}: {} m", depth[0]);
                let median = depth[depth.len() / 2];
                assert!(median > 1.0, "{layout}, seed {seed}, frame {index}: median {median} m");
            }
        }
    }
}

#[test]
fn all_rooms_and_most_things_are_seen_in_a_round() {
    let scene = room("synthetic:frames=1800,seed=3,width=64,height=48,tour=4");
    let ids = |index| scene.read_ground_truth(index).unwrap().unwrap().areas();
    let seen: BTreeSet<SegmentId> = (0..1800).step_by(15).flat_map(|index| ids(index).into_keys()).collect();
    assert!(!seen.contains(&0), "every pixel belongs to something");
    assert!((0..4).all(|room| seen.contains(&(6 * room + 1))), "all floors: {seen:?}");
    let things = scene.things();
    let seen_things = things.iter().filter(|thing| seen.contains(&thing.id)).count();
    assert!(things.len() >= 72 && things[0].id == 25 && seen_things * 5 >= things.len() * 4, "{seen_things}");
    for group in scene.twins() {
        let twins: Vec<_> = group.iter().map(|id| things.iter().find(|thing| thing.id == *id).unwrap()).collect();
        assert!(twins.len() >= 4 && twins.iter().all(|twin| (twin.kind, twin.size) == (twins[0].kind, twins[0].size)));
    }
}

#[test]
fn things_slide_visibly_on_a_tour() {
    for layout in ["tour=1", "tour=4"] {
        for seed in 0..4 {
            let scene = room(&format!("synthetic:frames=2400,seed={seed},width=80,height=60,moving=2,{layout}"));
            assert_eq!(scene.movers().len(), 2);
            for mover in scene.movers() {
                let Motion::Slide { step, steps } = mover.motion else { panic!("{mover:?}") };
                let (speed, reach) = (step.length(), step.length() * steps as f32);
                assert!((0.007..0.008).contains(&speed) && reach > 0.29, "{layout}, seed {seed}: {speed} {reach}");
                let pixels = |index| scene.read_ground_truth(index).unwrap().unwrap().areas().remove(&mover.id);
                let clear =
                    (0..scene.frames_per_round()).step_by(12).filter(|index| pixels(*index) >= Some(20)).count();
                assert!(clear >= 5, "{layout}, seed {seed}: {} is seen in {clear} frames", mover.id);
            }
        }
    }
}

#[test]
fn a_corridor_is_walked_to_its_end() {
    let scene = room("synthetic:frames=3000,width=64,height=48,corridor=5");
    assert_eq!(scene.settings().layout, Layout::Corridor(5));
    let ids = |index: usize| scene.read_ground_truth(index).unwrap().unwrap();
    let seen: BTreeSet<SegmentId> =
        (0..scene.frames_per_round()).step_by(20).flat_map(|index| ids(index).areas().into_keys()).collect();
    assert!((7..7 + 15).all(|part| seen.contains(&part)), "every door, frame and sign: {seen:?}");
    let end = scene.frames_per_round() + 60;
    assert_eq!(scene.read_frame(end).unwrap().color(), scene.read_frame(2999).unwrap().color());
    assert_eq!(scene.things().len(), 2);
    let moving = room("synthetic:corridor=5,objects=0");
    assert!(moving.movers().is_empty());
}
