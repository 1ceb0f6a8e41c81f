//! The paper's memory learns.

use crate::run::{Run, features, recalled};
use crate::scene::{Scene, WALL};
use splatseg_geometry::SegmentMap;
use splatseg_memory::GrowthRule;

#[test]
fn an_id_turns_within_the_steps_of_a_frame() {
    let shot = Scene::wall().seen_from_origin();
    let other = SegmentMap::filled(shot.truth.width(), shot.truth.height(), 2);
    let settings = features();
    assert_eq!(settings.growth_rule(), GrowthRule::Paper);
    let mut run = Run::new(settings);
    run.show_times(&shot, 10);
    assert!(recalled(&run.expected(&shot), &shot.truth, WALL) > 0.99);
    run.show_as(&shot, &other);
    let turned = recalled(&run.expected(&shot), &other, 2);
    assert!(turned > 0.99, "aligned with the current frame's predictions for use at the next step: {turned}");
}

#[test]
fn without_steps_an_id_does_not_turn() {
    let shot = Scene::wall().seen_from_origin();
    let other = SegmentMap::filled(shot.truth.width(), shot.truth.height(), 2);
    let mut run = Run::new(features().with(|settings| settings.num_steps = 0));
    run.show_times(&shot, 10);
    run.show_as(&shot, &other);
    assert_eq!(recalled(&run.expected(&shot), &other, 2), 0.0);
}

#[test]
fn the_pixels_of_new_gaussians_are_learnt_if_the_settings_say_so() {
    let shot = Scene::wall().seen_from_origin();
    let learnt = |learn_new: bool| {
        let settings = features().with(|settings| {
            (settings.learn_new, settings.active_tolerance) = (learn_new, -1.0);
        });
        Run::new(settings).show(&shot).update.learning.active_pixels
    };
    assert_eq!(learnt(false), 0, "all Gaussians are new");
    assert_eq!(learnt(true), shot.truth.pixels().len());
}
