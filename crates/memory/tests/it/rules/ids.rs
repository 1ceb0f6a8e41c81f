//! Ids that are given out and forgotten.

use super::run::{Run, evidence, features};
use super::scene::Scene;
use splatseg_geometry::{MAX_16_BIT_ID, SegmentMap};
use splatseg_memory::{GrowthRule, MemoryError};
use std::collections::BTreeSet;

/// Shows a wall that had id 1 as id 2 in 40 frames. Returns the frames that report id 1 as forgotten.
fn told(run: &mut Run) -> Vec<usize> {
    let shot = Scene::wall().seen_from_origin();
    run.show(&shot);
    let two = shot.truth.map(|_| 2);
    let mut told = Vec::new();
    for frame in 1..=40 {
        let forgotten = run.show_as(&shot, &two).update.forgotten;
        let is_forgotten = forgotten.contains(&1) || !told.is_empty();
        assert_eq!(run.memory.map().carried_ids().contains(&1), !is_forgotten, "frame {frame}");
        told.extend(forgotten.contains(&1).then_some(frame));
        assert!(!forgotten.contains(&2));
    }
    told
}

#[test]
fn an_id_is_reported_as_forgotten_once_when_no_gaussian_shows_it_any_more() {
    // One vote against one: the smaller id wins. Then two against one.
    assert_eq!(told(&mut Run::new(evidence())), [2]);
}

#[test]
fn the_memory_of_features_looks_for_forgotten_ids_in_some_frames() {
    let settings = features().with(|settings| {
        settings.growth = GrowthRule::Missing;
        settings.direction_learning_rate = 0.5;
    });
    let mut run = Run::new(settings);
    let shot = Scene::wall().seen_from_origin();
    run.show(&shot);
    let two = shot.truth.map(|_| 2);
    let told: Vec<usize> = (1..=40).filter(|_| run.show_as(&shot, &two).update.forgotten.contains(&1)).collect();
    assert_eq!(told, [16], "features take long to decode");
}

#[test]
fn an_id_is_tentative_until_it_was_predicted_in_two_frames() {
    let mut run = Run::new(evidence());
    let shot = Scene::wall().seen_from_origin();
    let is_tentative = |run: &Run| [1, 2].map(|id| run.memory.map().is_tentative(id));
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
    for predicted in [&small, &unknown] {
        let recall = run.memory.recall(&frame);
        let errors = [
            run.memory.fuse(&recall, predicted).unwrap_err(),
            run.memory.update(recall, predicted, &BTreeSet::new()).unwrap_err(),
        ];
        for error in errors {
            match error {
                MemoryError::PredictionSize { found, expected } => {
                    assert_eq!((found, expected), ((width - 1, height), (width, height)));
                }
                MemoryError::UnknownSegment { found: 2, known: 1 } => assert_eq!(predicted, &unknown),
                error => panic!("{error}"),
            }
        }
    }
}

#[test]
fn endless_new_objects_need_only_16_bits() {
    let mut run = Run::new(evidence());
    let shot = Scene::wall().seen_from_origin();
    let columns = shot.truth.width();
    for id in 1..=MAX_16_BIT_ID {
        assert_eq!(run.memory.new_segment().unwrap(), id);
    }
    // Ids that were never predicted are released as well.
    run.show_as(&shot, &shot.truth);
    for frame in 0..60 {
        let ids = [(); 12].map(|()| run.memory.new_segment().unwrap());
        assert!(ids.iter().all(|id| *id <= MAX_16_BIT_ID), "frame {frame}: {ids:?}");
        let predicted =
            SegmentMap::from_fn(columns, shot.truth.height(), |column, _| ids[column * ids.len() / columns]);
        let update = run.show_as(&shot, &predicted).update;
        assert_eq!(update.new_segments, BTreeSet::from(ids).into_iter().collect::<Vec<_>>());
    }
}
