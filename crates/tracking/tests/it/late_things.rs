//! An object and its neighbour that share a mask in some frames.

use crate::exact_masks::{evidence, masks, method};
use splatseg_dataset::Scene;
use splatseg_geometry::{SegmentId, SegmentMap};
use splatseg_test_scenes::{room, truth};
use splatseg_tracking::Method;
use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

/// Number of frames of a scene.
const FRAMES: usize = 40;

/// The largest id of the floor, ceiling and walls.
const SHELL: SegmentId = 6;

/// Number of frames within which an object must get an id once it has its own mask.
const PATIENCE: usize = 14;

/// Returns the most frequent id on the pixels of an object.
fn id_of(truth: &SegmentMap, shown: &SegmentMap, thing: SegmentId) -> SegmentId {
    let mut counts = BTreeMap::<SegmentId, usize>::new();
    for (truth, shown) in truth.pixels().iter().zip(shown.pixels()) {
        if *truth == thing {
            *counts.entry(*shown).or_default() += 1;
        }
    }
    counts.into_iter().max_by_key(|(_, count)| *count).map_or(0, |(id, _)| id)
}

/// Returns the largest object, except walls, floor and ceiling, that touches a larger one, and that larger object.
fn neighbours(truth: &SegmentMap) -> (SegmentId, SegmentId) {
    let areas = truth.areas();
    let mut pairs = BTreeSet::new();
    for row in 0..truth.height() {
        for pair in truth.row(row).windows(2).filter(|pair| pair[0] != pair[1]) {
            let is_smaller = areas[&pair[0]] < areas[&pair[1]];
            pairs.insert(if is_smaller { (pair[0], pair[1]) } else { (pair[1], pair[0]) });
        }
    }
    let largest = pairs.into_iter().filter(|(small, _)| *small > SHELL).max_by_key(|(small, _)| areas[small]);
    largest.expect("a thing in front of a wall")
}

/// Returns the ids of an object and of its larger neighbour in every frame of a scene. In the frames `joined`, both
/// share a mask.
fn ids_of_neighbours(seed: u64, joined: Range<usize>) -> Vec<(SegmentId, SegmentId)> {
    let text = format!("synthetic:frames={FRAMES},seed={seed},width=160,height=120,objects=16,camera=static");
    let scene = room(&text);
    let (small, large) = neighbours(&truth(&scene, 0));
    let mut method = method(evidence());
    let ids_in = |index| {
        let (frame, truth) = (scene.read_frame(index).unwrap(), truth(&scene, index));
        let is_joined = joined.contains(&index);
        let predicted = truth.map(|id| if is_joined && *id == small { large } else { *id });
        let output = method.process_masks(&frame, &masks(&predicted, index)).unwrap();
        (id_of(&truth, &output.segments, small), id_of(&truth, &output.segments, large))
    };
    (0..FRAMES).map(ids_in).collect()
}

#[test]
fn an_object_that_is_separated_late_gets_a_lasting_id() {
    const TOGETHER: usize = 10;
    for seed in 0..3 {
        let ids = ids_of_neighbours(seed, 0..TOGETHER);
        let of_large: BTreeSet<SegmentId> = ids.iter().map(|(_, large)| *large).collect();
        assert_eq!(of_large.len(), 1, "seed {seed}: the larger one keeps its id: {ids:?}");
        let of_late: BTreeSet<SegmentId> = ids[TOGETHER + PATIENCE..].iter().map(|(late, _)| *late).collect();
        assert!(of_late.len() == 1 && of_late.is_disjoint(&of_large), "seed {seed}: {ids:?}");
    }
}
