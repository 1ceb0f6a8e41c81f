//! The paper's memory learns.

use crate::run::{Run, features, recalled};
use crate::scene::{Scene, WALL};
use splatseg_geometry::SegmentMap;
use splatseg_memory::GrowthRule;

/// Shares of a wall that a memory shows as another segment after each of `frames` frames that say so. Ten frames before
/// said otherwise.
fn shares_turned(direction_learning_rate: f32, frames: usize) -> Vec<f32> {
    let shot = Scene::wall().seen_from_origin();
    let other = SegmentMap::filled(shot.truth.width(), shot.truth.height(), 2);
    let settings = features().with(|settings| settings.direction_learning_rate = direction_learning_rate);
    assert_eq!(settings.growth_rule(), GrowthRule::Paper);
    let mut run = Run::new(settings);
    run.show_times(&shot, 10);
    assert!(recalled(&run.expected(&shot), &shot.truth, WALL) > 0.99);
    let turned = |_| {
        run.show_as(&shot, &other);
        recalled(&run.expected(&shot), &other, 2)
    };
    (0..frames).map(turned).collect()
}

#[test]
fn an_id_turns_within_the_steps_of_a_frame_at_the_papers_rate() {
    let turned = shares_turned(0.5, 1);
    assert!(turned[0] > 0.99, "aligned with the current frame's predictions for use at the next step: {turned:?}");
}

#[test]
fn one_wrong_frame_does_not_turn_an_id_at_the_default_rate() {
    let turned = shares_turned(features().direction_learning_rate, 10);
    println!("{turned:?}");
    assert!(turned[0] < 0.01, "after one frame: {turned:?}");
    assert!(turned[9] > 0.99, "after ten: {turned:?}");
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
