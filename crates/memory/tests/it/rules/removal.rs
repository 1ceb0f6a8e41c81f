//! Objects that are gone are forgotten; hidden ones are not.

use super::run::{Run, evidence, recalled};
use super::scene::{Scene, Solid, TABLE, pose};
use glam::Vec3;

/// Box 3, which touches nothing, 1 m in front of the wall.
const FLOATING: Solid = Solid { id: 3, min: Vec3::new(-0.3, -0.3, 1.8), max: Vec3::new(0.3, 0.3, 2.0) };

/// Number of frames that see through an object until it must be gone.
fn frames_to_remove() -> usize {
    usize::from(evidence().removal_frames) + 2
}

#[test]
fn a_box_that_is_carried_away_is_forgotten() {
    let mut run = Run::new(evidence());
    run.show_times(&Scene::wall().with(FLOATING).seen_from_origin(), 10);
    assert!(run.count_in(&FLOATING, 0.02) > 20);
    let empty = Scene::wall().seen_from_origin();
    let steps = run.show_times(&empty, frames_to_remove());
    assert_eq!(run.count_in(&FLOATING, 0.02), 0, "Gaussians are left");
    assert!(!run.expected(&empty).areas().contains_key(&3), "the box is still expected");
    let forgotten: Vec<u32> = steps.into_iter().flat_map(|step| step.update.forgotten).collect();
    assert_eq!(forgotten, [3]);
}

#[test]
fn a_box_that_is_taken_from_the_table_is_gone() {
    let mut run = Run::new(evidence());
    let scene = Scene::boxes();
    run.show_times(&scene.seen_from_origin(), 10);
    let solid = *scene.solid(3);
    let empty = scene.without(3).seen_from_origin();
    run.show_times(&empty, frames_to_remove());
    // Depth cannot distinguish Gaussians nearer to the table than the margin from the table.
    let above = Solid { max: solid.max - Vec3::Y * 0.15, ..solid };
    assert_eq!(run.count_in(&above, 0.02), 0);
    run.show_times(&empty, 8);
    let left = run.expected(&empty).areas().get(&3).copied().unwrap_or(0);
    assert_eq!(left, 0, "newer votes outweigh the remaining ones");
}

#[test]
fn removal_waits_for_its_number_of_frames() {
    for removal_frames in [1, 3, 6] {
        let mut run = Run::new(evidence().with(|settings| settings.removal_frames = removal_frames));
        run.show_times(&Scene::wall().with(FLOATING).seen_from_origin(), 3);
        let steps = run.show_times(&Scene::wall().seen_from_origin(), usize::from(removal_frames));
        let (last, before) = steps.split_last().unwrap();
        assert!(before.iter().all(|step| step.update.removed == 0), "none before frame {removal_frames}");
        assert!(last.update.removed > 0, "in frame {removal_frames}");
    }
}

#[test]
fn a_sight_in_between_restarts_the_count() {
    let mut run = Run::new(evidence());
    let (with, without) = (Scene::wall().with(FLOATING).seen_from_origin(), Scene::wall().seen_from_origin());
    run.show(&with);
    for _ in 0..5 {
        for step in run.show_times(&without, usize::from(evidence().removal_frames) - 1) {
            assert_eq!(step.update.removed, 0);
        }
        run.show(&with);
    }
}

#[test]
fn with_removal_frames_0_nothing_is_removed() {
    let mut run = Run::new(evidence().with(|settings| settings.removal_frames = 0));
    run.show_times(&Scene::wall().with(FLOATING).seen_from_origin(), 3);
    let count = run.memory.gaussian_count();
    run.show_times(&Scene::wall().seen_from_origin(), 300);
    assert_eq!(run.memory.gaussian_count(), count);
}

#[test]
fn a_box_behind_something_is_not_removed() {
    let scene = Scene::wall().with(FLOATING);
    let mut run = Run::new(evidence());
    run.show_times(&scene.seen_from_origin(), 5);
    let known = run.memory.gaussian_count();
    let hidden = scene.clone().with(Solid::new(4, [0.0, 0.0, 1.2], [0.8, 0.8, 0.2])).seen_from_origin();
    assert!(!hidden.truth.areas().contains_key(&3), "the box is hidden");
    for step in run.show_times(&hidden, 20) {
        assert_eq!(step.update.removed, 0);
    }
    let back = scene.seen_from_origin();
    run.show_times(&back, frames_to_remove());
    assert!(run.memory.gaussian_count() >= known);
    let share = recalled(&run.expected(&back), &back.truth, 3);
    assert!(share > 0.95, "the box has its id again: {share}");
}

#[test]
fn poses_off_by_half_a_pixel_do_not_erode_a_thin_object() {
    // Two pixels see the pole, but only one does from half a pixel aside.
    let pole = Solid::new(3, [0.0, 0.0, 2.0], [0.034, 6.0, 0.034]);
    let scene = Scene::wall().with(pole);
    let mut run = Run::new(evidence());
    let shot = scene.seen_from_origin();
    run.show(&shot);
    let known = run.count_in(&pole, 0.03);
    // Half a pixel is 1.25 cm at the pole.
    let offsets = [[0.0125, 0.0], [-0.0125, 0.0], [0.0, 0.0125], [-0.009, -0.009], [0.0125, 0.0125]];
    for [x, y] in offsets {
        // More frames than removal takes.
        run.show_times(&scene.seen_from(pose([x, y, 0.0], 0.0)).with_pose(shot.pose), 6);
    }
    let left = run.count_in(&pole, 0.03);
    assert!(left * 10 >= known * 9, "{left} of {known} are left");
}

#[test]
fn a_box_pushed_across_the_table_keeps_its_id_and_leaves_no_gaussians_behind() {
    let start = Solid::new(3, [-0.6, 0.35, 1.8], [0.4, 0.5, 0.3]);
    let mut run = Run::new(evidence());
    let mut id = 0;
    let mut solid = start;
    let known = (0..5).map(|_| run.show_matched(&Scene::table().with(start).seen_from_origin())[&3]);
    for found in known {
        assert!(id == 0 || found == id, "a still box keeps its id");
        id = found;
    }
    for frame in 0..50 {
        solid = solid.moved(Vec3::X * 0.02);
        let ids = run.show_matched(&Scene::table().with(solid).seen_from_origin());
        assert_eq!(ids[&3], id, "frame {frame} of the push");
        assert!(ids[&TABLE] != id, "frame {frame} of the push: the table is another object");
    }
    let end = Scene::table().with(solid).seen_from_origin();
    for _ in 0..10 {
        run.show_matched(&end);
    }
    // Depth cannot distinguish Gaussians nearer to the table than the margin from the table.
    let place = Solid { max: start.max - Vec3::Y * 0.15, ..start };
    assert_eq!(run.count_in(&place, 0.02), 0, "its old place is free");
    let expected = run.expected(&end);
    let stray = expected.pixels().iter().zip(end.truth.pixels()).filter(|(found, truth)| **found == id && **truth != 3);
    let stray = stray.count();
    assert!(stray < 20, "and shows other objects: {stray}");
}
