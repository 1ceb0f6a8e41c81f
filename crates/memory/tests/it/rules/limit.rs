//! The maximum number of Gaussians.

use super::run::{Run, agreement, evidence, features};
use super::scene::{Scene, pose};

#[test]
fn gaussians_beyond_the_limit_are_removed_longest_unseen_first() {
    let scene = Scene::room();
    let shots: Vec<_> = (0..=180).step_by(10).map(|degrees| scene.seen_from(pose([0.0; 3], degrees as f32))).collect();
    let mut unlimited = Run::new(evidence());
    shots.iter().for_each(|shot| drop(unlimited.show(shot)));
    let limit = unlimited.memory.gaussian_count() / 2;

    let mut run = Run::new(evidence().with(|settings| settings.max_gaussians = limit));
    for shot in &shots {
        run.show(shot);
        assert!(run.memory.gaussian_count() <= limit);
    }
    assert!(run.memory.gaussian_count() >= limit - limit / 16);
    let share = |shot| {
        let found = agreement(&run.expected(shot), &shot.truth);
        let before = agreement(&unlimited.expected(shot), &shot.truth);
        (found, before)
    };
    let (last, unlimited_last) = share(shots.last().unwrap());
    assert!(last > 0.95 && last >= unlimited_last - 0.01, "the last view is whole: {last}");
    let (first, unlimited_first) = share(&shots[0]);
    assert!(first < 0.2 && unlimited_first > 0.95, "the first is gone: {first}, {unlimited_first} without a limit");
}

#[test]
fn a_frame_with_more_than_the_limit_stays_below_it() {
    let shot = Scene::boxes().seen_from_origin();
    for growth_spacing in [1, 4] {
        let mut run = Run::new(evidence().with(|settings| {
            settings.max_gaussians = 100;
            settings.growth_spacing = growth_spacing;
        }));
        for _ in 0..5 {
            run.show(&shot);
            assert_eq!(run.memory.gaussian_count(), 94, "below the limit, so that it is not reached again at once");
        }
    }
}

#[test]
fn the_papers_map_removes_gaussians_only_beyond_the_limit() {
    let (wall, boxes) = (Scene::wall().seen_from_origin(), Scene::boxes().seen_from_origin());
    let mut run = Run::new(features());
    run.show(&boxes);
    for _ in 0..8 {
        let update = run.show(&wall).update;
        assert_eq!((update.removed, update.forgotten.len()), (0, 0), "the boxes are seen through");
    }
    let limit = boxes.truth.pixels().len();
    let mut run = Run::new(features().with(|settings| settings.max_gaussians = limit));
    assert_eq!(run.show(&boxes).update.removed, 0, "exactly the limit");
    let update = run.show(&wall).update;
    assert!(update.grown > 0 && update.removed > update.grown);
    assert_eq!(run.memory.gaussian_count(), limit - limit / 16);
}

#[test]
fn a_map_at_its_limit_is_not_searched_in_every_frame() {
    let scene = Scene::room();
    let shots: Vec<_> = (0..360).step_by(3).map(|degrees| scene.seen_from(pose([0.0; 3], degrees as f32))).collect();
    let mut unlimited = Run::new(evidence());
    shots.iter().for_each(|shot| drop(unlimited.show(shot)));
    let limit = unlimited.memory.gaussian_count() / 2;
    let mut run = Run::new(evidence().with(|settings| settings.max_gaussians = limit));
    let updates: Vec<_> = shots.iter().map(|shot| run.show(shot).update).collect();
    let grew = updates.iter().filter(|update| update.grown > 0).count();
    let shrank = updates.iter().filter(|update| update.removed > 0).count();
    assert!(shrank > 0 && shrank * 3 <= grew, "removed in {shrank} of {grew} frames that grew");
}

#[test]
fn the_papers_map_keeps_gaussians_that_were_in_view_last() {
    let scene = Scene::room();
    let view = |degrees: f32| scene.seen_from(pose([0.0; 3], degrees));
    let mut run = Run::new(features());
    run.show(&view(0.0));
    run.show(&view(90.0));
    // The first view again: its Gaussians were added first, but seen last.
    run.show(&view(0.0));
    let limit = run.memory.gaussian_count();
    let mut limited = Run::new(features().with(|settings| settings.max_gaussians = limit));
    [0.0, 90.0, 0.0].into_iter().for_each(|degrees| drop(limited.show(&view(degrees))));
    let first: Vec<glam::Vec3> = limited.means()[..view(0.0).truth.pixels().len()].to_vec();
    limited.show(&view(180.0));
    let kept: std::collections::BTreeSet<[u32; 3]> =
        limited.means().iter().map(|mean| mean.to_array().map(f32::to_bits)).collect();
    let share = first.iter().filter(|mean| kept.contains(&mean.to_array().map(f32::to_bits))).count();
    assert!(share * 10 >= first.len() * 9, "{share} of {} of the first view are left", first.len());
}
