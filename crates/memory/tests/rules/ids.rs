//! Ids that are given, taken back and forgotten.

use crate::run::{Run, evidence, features};
use crate::scene::Scene;
use splatseg_geometry::SegmentMap;
use splatseg_memory::{ABSTAIN, GrowthRule, MAX_16_BIT_ID, MemoryError};
use std::collections::BTreeSet;

#[test]
fn an_id_that_is_taken_back_is_given_again() {
    let mut run = Run::new(evidence());
    assert_eq!([(); 2].map(|()| run.memory.new_segment().unwrap()), [1, 2]);
    run.memory.take_back(1);
    assert_eq!([(); 2].map(|()| run.memory.new_segment().unwrap()), [1, 3]);
}

/// The frames in which id 1 is told to be forgotten, of 40 in which the wall that had it is seen as 2.
fn told(run: &mut Run) -> Vec<usize> {
    let shot = Scene::wall().seen_from_origin();
    run.show(&shot);
    let two = shot.truth.map(|_| 2);
    let mut told = Vec::new();
    for frame in 1..=40 {
        let forgotten = run.show_as(&shot, &two).update.forgotten;
        let is_forgotten = forgotten.contains(&1) || !told.is_empty();
        assert_eq!(run.memory.carried_ids().contains(&1), !is_forgotten, "frame {frame}");
        told.extend(forgotten.contains(&1).then_some(frame));
        assert!(!forgotten.contains(&2));
    }
    told
}

#[test]
fn an_id_is_told_to_be_forgotten_once_when_nothing_shows_it_any_more() {
    // One vote against one: the smaller id. Then two against one.
    assert_eq!(told(&mut Run::new(evidence())), [2]);
}

#[test]
fn the_memory_of_features_looks_for_forgotten_ids_now_and_then() {
    let settings = features().with(|settings| {
        (settings.growth, settings.direction_learning_rate) = (GrowthRule::Missing, 0.5);
    });
    let mut run = Run::new(settings);
    let shot = Scene::wall().seen_from_origin();
    run.show(&shot);
    let two = shot.truth.map(|_| 2);
    let told: Vec<usize> = (1..=40).filter(|_| run.show_as(&shot, &two).update.forgotten.contains(&1)).collect();
    assert_eq!(told, [16], "features take long to decode");
}

#[test]
fn an_id_is_tentative_until_its_thing_was_seen_in_two_frames() {
    let mut run = Run::new(evidence());
    let shot = Scene::wall().seen_from_origin();
    let is_tentative = |run: &Run| [1, 2].map(|id| run.memory.is_tentative(id));
    run.show(&shot);
    assert_eq!(is_tentative(&run), [true, true]);
    run.show(&shot);
    assert_eq!(is_tentative(&run), [false, true]);
    run.show(&shot);
    assert_eq!(is_tentative(&run), [false, true]);
}

#[test]
fn predictions_of_another_size_or_with_unknown_ids_are_refused() {
    let mut run = Run::new(evidence());
    let shot = Scene::wall().seen_from_origin();
    run.show(&shot);
    let frame = shot.frame();
    let (width, height) = shot.truth.size();
    let small = SegmentMap::filled(width - 1, height, 1);
    let unknown = shot.truth.map(|_| 2);
    for seen in [&small, &unknown] {
        let recall = run.memory.recall(&frame);
        let errors = [
            run.memory.fuse(&recall, seen).unwrap_err(),
            run.memory.note_explained(&recall, seen, &|_, _| false).unwrap_err(),
            run.memory.update(recall, seen).unwrap_err(),
        ];
        for error in errors {
            match error {
                MemoryError::PredictionSize { found, expected } => {
                    assert_eq!((found, expected), ((width - 1, height), (width, height)));
                }
                MemoryError::UnknownSegment { found: 2, known: 1 } => assert_eq!(seen, &unknown),
                error => panic!("{error}"),
            }
        }
    }
    let recall = run.memory.recall(&frame);
    assert!(run.memory.fuse(&recall, &shot.truth.map(|_| ABSTAIN)).is_ok());
}

#[test]
fn new_things_in_each_frame_for_ever_need_no_more_than_16_bits() {
    let mut run = Run::new(evidence());
    let shot = Scene::wall().seen_from_origin();
    let columns = shot.truth.width();
    for id in 1..=MAX_16_BIT_ID {
        assert_eq!(run.memory.new_segment().unwrap(), id);
    }
    // Ids under which nothing was seen are released as others are.
    run.show_as(&shot, &shot.truth);
    for frame in 0..60 {
        let ids = [(); 12].map(|()| run.memory.new_segment().unwrap());
        assert!(ids.iter().all(|id| *id <= MAX_16_BIT_ID), "frame {frame}: {ids:?}");
        let seen = SegmentMap::from_fn(columns, shot.truth.height(), |column, _| ids[column * ids.len() / columns]);
        let update = run.show_as(&shot, &seen).update;
        assert_eq!(update.new_segments, BTreeSet::from(ids).into_iter().collect::<Vec<_>>());
    }
}
