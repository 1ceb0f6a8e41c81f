//! The paper's memory learns.

use crate::run::{Run, features, recalled};
use crate::scene::{Scene, WALL};
use splatseg_geometry::SegmentMap;
use splatseg_memory::GrowthRule;

/// Frames of 20 steps until a wall of one id must decode to another. With the default rate and 8 channels it was measured
/// to take 5.
const FRAMES_TO_TURN: usize = 8;

#[test]
fn learning_turns_an_id() {
    let shot = Scene::wall().seen_from_origin();
    let other = SegmentMap::filled(shot.truth.width(), shot.truth.height(), 2);
    let settings = features();
    assert_eq!(settings.growth_rule(), GrowthRule::Paper);
    let mut run = Run::new(settings);
    run.show_times(&shot, 10);
    assert!(recalled(&run.expected(&shot), &shot.truth, WALL) > 0.99);
    run.show_times(&shot, 10);
    let frames = (1..=FRAMES_TO_TURN).find(|_| {
        run.show_as(&shot, &other);
        recalled(&run.expected(&shot), &other, 2) > 0.95
    });
    assert!(frames.is_some(), "not turned after {FRAMES_TO_TURN} frames");
    assert!(frames > Some(1), "one wrong frame must not do");
}
