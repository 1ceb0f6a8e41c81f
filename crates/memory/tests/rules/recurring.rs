//! What is explained again and again in the same place is a thing of its own.

use crate::run::{Run, evidence};
use crate::scene::{Scene, Shot, Solid, WALL, pose};
use splatseg_geometry::SegmentId;

/// A book 2 on the wall, less than the depth tolerance before it.
const BOOK: SegmentId = 2;

/// Frames in which a prediction must be explained.
const NEEDED: usize = 6;

/// The book from a camera that walks along the wall.
fn shot(step: usize) -> Shot {
    let book = Solid::new(BOOK, [0.0, 0.0, 2.95], [0.6, 0.6, 0.1]);
    Scene::wall().with(book).seen_from(pose([0.04 * step as f32 - 0.3, 0.0, 0.0], 0.0))
}

/// A run that has seen wall and book as one.
fn run_that_knows_one() -> Run {
    let mut run = Run::new(evidence());
    for step in 0..5 {
        let shot = shot(step);
        run.show_as(&shot, &shot.truth.map(|id| (*id).min(WALL)));
    }
    while run.memory.segment_count() < BOOK as usize {
        run.memory.new_segment().unwrap();
    }
    run
}

/// Shows the book as a prediction that is explained, where `is_predicted`; returns whether it is a thing of its own now.
fn explain(run: &mut Run, shot: &Shot, is_predicted: bool) -> bool {
    let explained = shot.truth.map(|id| if is_predicted && *id == BOOK { BOOK } else { 0 });
    let frame = shot.frame();
    let recall = run.memory.recall(&frame);
    let recurring = run.memory.note_explained(&recall, &explained, &|_, times| times >= NEEDED).unwrap();
    let seen = shot.truth.map(|id| match *id {
        BOOK if recurring.is_empty() => splatseg_memory::ABSTAIN,
        id => id,
    });
    run.memory.update(recall, &seen).unwrap();
    recurring == [BOOK]
}

#[test]
fn a_prediction_that_is_explained_often_enough_is_a_thing() {
    let mut run = run_that_knows_one();
    for step in 0..NEEDED {
        assert!(!run.expected(&shot(step)).areas().contains_key(&BOOK), "step {step}");
        assert_eq!(explain(&mut run, &shot(step), true), step + 1 == NEEDED, "step {step}");
    }
    // The Gaussians there are those of the inside of a wall, which are coarse: the border takes some frames to settle,
    // and stays rough.
    (NEEDED..NEEDED + 4).for_each(|step| drop(run.show(&shot(step))));
    let shot = shot(NEEDED + 4);
    let area = shot.truth.areas()[&BOOK];
    let found = run.expected(&shot).areas().get(&BOOK).copied().unwrap_or(0);
    assert!(found * 2 >= area && found * 4 <= area * 5, "{found} of {area} pixels are expected");
}

#[test]
fn frames_without_it_take_its_count_back() {
    let mut run = run_that_knows_one();
    for step in 0..4 * NEEDED {
        assert!(!explain(&mut run, &shot(step % 5), step % 2 == 0), "step {step}");
    }
}
