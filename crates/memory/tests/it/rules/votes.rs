//! Votes against wrong masks.

use super::run::{Run, agreement, evidence, recalled};
use super::scene::{Scene, Shot};
use splatseg_geometry::SegmentMap;
use splatseg_memory::Votes;
use std::collections::BTreeSet;

/// Number of frames after which another id must have won: votes are capped at 4, and a new id gains one per frame while
/// the old votes are scaled by 4/5. So the new id has the majority in the fourth frame where a pixel sees a single
/// Gaussian. Twice that leaves room for neighbours that blend.
const FRAMES_TO_CHANGE: usize = 8;

/// A run that has learnt the boxes ten times.
fn run_that_knows_boxes() -> (Run, Shot) {
    let shot = Scene::boxes().seen_from_origin();
    let mut run = Run::new(evidence());
    run.show_times(&shot, 10);
    (run, shot)
}

/// True ids of the view, with some replaced.
fn replaced(shot: &Shot, replace: impl Fn(u32) -> u32) -> SegmentMap {
    shot.truth.map(|id| replace(*id))
}

#[test]
fn a_frame_is_expected_as_it_was_predicted() {
    let (run, shot) = run_that_knows_boxes();
    let found = agreement(&run.expected(&shot), &shot.truth);
    assert!(found > 0.98, "{found}");
}

#[test]
fn many_frames_win_over_one_wrong_mask() {
    let (mut run, shot) = run_that_knows_boxes();
    let step = run.show_as(&shot, &replaced(&shot, |id| if id == 3 { 5 } else { id }));
    let (fused, expected) = (recalled(&step.fused, &shot.truth, 3), recalled(&run.expected(&shot), &shot.truth, 3));
    assert!(fused > 0.95 && expected > 0.95, "fused {fused}, expected {expected}");
}

#[test]
fn a_mask_over_two_segments_does_not_unite_them() {
    let replacements: [fn(u32) -> u32; 3] = [
        |id| if id == 4 { 3 } else { id },
        |id| if id == 3 || id == 4 { 5 } else { id },
        |id| if id == 3 || id == 4 { 2 } else { id },
    ];
    for replace in replacements {
        let (mut run, shot) = run_that_knows_boxes();
        let step = run.show_as(&shot, &replaced(&shot, replace));
        let expected = run.expected(&shot);
        for id in [3, 4] {
            let shares = [&step.fused, &expected].map(|found| recalled(found, &shot.truth, id));
            assert!(shares.iter().all(|share| *share > 0.9), "segment {id}: {shares:?}");
        }
    }
}

#[test]
fn a_missing_prediction_does_not_erase_a_segment() {
    let (mut run, shot) = run_that_knows_boxes();
    let step = run.show_as(&shot, &replaced(&shot, |id| if id == 3 { 0 } else { id }));
    let shares = [&step.fused, &run.expected(&shot)].map(|found| recalled(found, &shot.truth, 3));
    assert!(shares.iter().all(|share| *share > 0.95), "{shares:?}");
}

#[test]
fn another_id_takes_over_after_some_frames() {
    let (mut run, shot) = run_that_knows_boxes();
    // The maximum number of votes.
    run.show_times(&shot, 40);
    let changed = replaced(&shot, |id| if id == 3 { 5 } else { id });
    for frame in 1..=FRAMES_TO_CHANGE {
        run.show_as(&shot, &changed);
        let share = recalled(&run.expected(&shot), &changed, 5);
        if share > 0.95 {
            assert!(frame >= 3, "one or two frames must not be enough: {frame}");
            return;
        }
    }
    panic!("still the old id after {FRAMES_TO_CHANGE} frames");
}

#[test]
fn a_contradicted_prediction_needs_more_frames_to_take_over() {
    let frames_until_expected = |contradicted: &BTreeSet<_>| {
        let (mut run, shot) = run_that_knows_boxes();
        let other = shot.truth.map(|_| 9);
        (0..100).find(|_| {
            let step = run.show_contradicted(&shot, &other, contradicted);
            recalled(&step.expected, &other, 9) > 0.95
        })
    };
    let (usual, late) = (frames_until_expected(&BTreeSet::new()), frames_until_expected(&BTreeSet::from([9])));
    assert!(usual.zip(late).is_some_and(|(usual, late)| 2 * usual < late), "{usual:?} and {late:?}");
}

#[test]
fn full_votes_accept_another_segment_only_if_it_is_stronger_than_the_weakest() {
    let slots = [(1, 0.5), (2, 0.4), (3, 0.3), (4, 0.2)];
    let after = |votes: f32| {
        let mut full = Votes::from_slots(slots);
        full.add(5, votes);
        full.slots()[3]
    };
    assert_eq!([0.1, 0.2, 0.21].map(after), [(4, 0.2), (4, 0.2), (5, 0.21)]);
}

#[test]
fn negligible_votes_make_room() {
    let mut votes = Votes::from_slots([(1, 3.0), (2, 0.019), (3, 0.021), (4, 0.0)]);
    votes.cap(4.0);
    assert_eq!(votes.iter().map(|(id, _)| id).collect::<Vec<_>>(), [1, 3]);
    votes.cap(1.0);
    assert_eq!(votes.iter().map(|(id, _)| id).collect::<Vec<_>>(), [1], "less than a third of 0.021 is left");
}
