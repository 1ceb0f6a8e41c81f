//! A thing that the segmenter separates from its neighbour only after some frames.

mod exact_masks;

use exact_masks::{evidence, masks, method, truth};
use splatseg_dataset::{Scene, SyntheticScene};
use splatseg_geometry::{SegmentId, SegmentMap};
use splatseg_tracking::Method;
use std::collections::{BTreeMap, BTreeSet};

/// Number of frames in which both are one mask.
const TOGETHER: usize = 10;

/// The largest id of the floor, ceiling and walls.
const SHELL: SegmentId = 6;

/// Number of frames within which a thing must get an id once it has its own mask.
const PATIENCE: usize = 14;

/// The most frequent id on the pixels of a thing.
fn id_of(truth: &SegmentMap, shown: &SegmentMap, thing: SegmentId) -> SegmentId {
    let mut counts = BTreeMap::<SegmentId, usize>::new();
    for (truth, shown) in truth.pixels().iter().zip(shown.pixels()) {
        if *truth == thing {
            *counts.entry(*shown).or_default() += 1;
        }
    }
    counts.into_iter().max_by_key(|(_, count)| *count).map_or(0, |(id, _)| id)
}

/// The largest thing, except walls, floor and ceiling, that touches a larger one, and that larger one.
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

#[test]
fn a_thing_that_is_separated_late_gets_a_lasting_id() {
    for seed in 0..3 {
        let text = format!("synthetic:frames=40,seed={seed},width=160,height=120,objects=16,camera=static");
        let scene = SyntheticScene::new(text.parse().unwrap()).unwrap();
        let (late, large) = neighbours(&truth(&scene, 0));
        let mut method = method(evidence());
        let mut ids = Vec::new();
        for index in 0..scene.frame_count() {
            let (frame, truth) = (scene.read_frame(index).unwrap(), truth(&scene, index));
            let seen =
                if index < TOGETHER { truth.map(|id| if *id == late { large } else { *id }) } else { truth.clone() };
            let output = method.process(&frame, &masks(&seen, index)).unwrap();
            let [late, large] = [late, large].map(|thing| id_of(&truth, &output.segments, thing));
            ids.push((late, large));
        }
        let of_large: BTreeSet<SegmentId> = ids.iter().map(|(_, large)| *large).collect();
        assert_eq!(of_large.len(), 1, "{text}: the larger one keeps its id: {ids:?}");
        let of_late: BTreeSet<SegmentId> = ids[TOGETHER + PATIENCE..].iter().map(|(late, _)| *late).collect();
        assert!(of_late.len() == 1 && of_late.is_disjoint(&of_large), "{text}: {ids:?}");
    }
}
