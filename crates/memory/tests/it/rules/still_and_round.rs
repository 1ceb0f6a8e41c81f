//! Known surfaces are not added again.

use super::run::{Run, evidence};
use super::scene::{Scene, pose};

#[test]
fn a_still_camera_adds_nothing_from_the_second_frame_on() {
    let shot = Scene::boxes().seen_from_origin();
    for growth_spacing in [1, 4, 8] {
        let mut run = Run::new(evidence().with(|settings| settings.growth_spacing = growth_spacing));
        let steps = run.show_times(&shot, 50);
        assert!(steps[0].update.grown > 0);
        for (frame, step) in steps.iter().enumerate().skip(1) {
            let change = (step.update.grown, step.update.removed);
            assert_eq!(change, (0, 0), "spacing {growth_spacing}, frame {}", frame + 1);
        }
    }
}

#[test]
fn a_second_round_through_a_known_room_adds_nearly_nothing() {
    let scene = Scene::room();
    let mut run = Run::new(evidence());
    let mut round = || {
        let mut grown = 0;
        for degrees in (0..360).step_by(12) {
            let angle = (degrees as f32).to_radians();
            let shot = scene.seen_from(pose([0.4 * angle.sin(), 0.0, 0.4 * angle.cos()], degrees as f32));
            grown += run.show(&shot).update.grown;
        }
        grown
    };
    let (first, second) = (round(), round());
    assert!(second * 100 <= first, "first round {first}, second {second}");
}
