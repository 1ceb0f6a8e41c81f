//! Tests of the book-keeping of patches. `tests/it/affinities.rs` tests what they are for.

use super::*;
use std::collections::BTreeMap;

const UNIT: i32 = Affinities::UNIT as i32;

/// Patches of two Gaussians each, the first one seen as id 1, the second as id 2 and so on, and a Gaussian without a patch.
/// Neighbours are linked.
fn graph(patches: u32) -> PatchGraph {
    let mut graph = PatchGraph::default();
    for patch in 0..patches {
        let mut new = Patch { gaussians: 2, ..Patch::default() };
        new.count(patch + 1, 10);
        graph.patches.push(new);
        graph.of_gaussians.extend([patch, patch]);
    }
    for patch in 1..patches {
        graph.pairs.add(pair_key(patch, patch - 1), PairEvidence { sum: 3 * UNIT, count: 3 });
    }
    graph.of_gaussians.push(NO_PATCH);
    graph
}

/// The id of the verdict on each Gaussian.
fn decided(graph: &PatchGraph) -> Vec<SegmentId> {
    let mut graph = graph.clone();
    graph.decide(Scope::All);
    graph.verdicts().into_iter().map(|verdict| verdict.id).collect()
}

#[test]
fn an_object_keeps_the_id_that_most_frames_gave_it() {
    let mut graph = graph(3);
    graph.pairs = PatchPairs::default();
    graph.patches[1].count(1, 300);
    assert_eq!(decided(&graph), [0, 0, 1, 1, 3, 3, 0], "the second has more of 1");
    graph.patches[1].count(2, 900);
    assert_eq!(decided(&graph), [1, 1, 2, 2, 3, 3, 0]);
    graph.patches[2].pixels_of_ids.clear();
    assert_eq!(decided(&graph), [1, 1, 2, 2, 0, 0, 0], "no frame gave the third one an id");
}

#[test]
fn eight_frames_count_as_one_vote() {
    let mut graph = graph(2);
    assert!(graph.verdicts().is_empty(), "nothing was decided");
    (graph.patches[0].frames, graph.patches[1].frames) = (8, 20);
    graph.decide(Scope::All);
    let votes: Vec<f32> = graph.verdicts().iter().map(|verdict| verdict.votes).collect();
    assert_eq!(votes, [1.0, 1.0, 2.5, 2.5, 0.0]);
    graph.forget_verdicts();
    assert!(graph.verdicts().is_empty());
}

#[test]
fn only_what_was_seen_lately_is_decided_again() {
    let mut graph = graph(4);
    graph.learnt = 9;
    (0..4).for_each(|patch| graph.patches[patch].last_seen = [2, 3, 8, 9][patch]);
    graph.pairs = PatchPairs::default();
    graph.decide(Scope::All);
    for (one, other) in [(0, 1), (1, 2), (2, 3)] {
        graph.pairs.add(pair_key(one, other), PairEvidence { sum: 3 * UNIT, count: 3 });
    }
    graph.decide(Scope::Frames(2));
    let ids: Vec<SegmentId> = graph.patches.iter().map(|patch| patch.object).collect();
    assert_eq!(ids, [1, 2, 3, 3]);
    graph.decide(Scope::Frames(7));
    let ids: Vec<SegmentId> = graph.patches.iter().map(|patch| patch.object).collect();
    assert_eq!(ids, [1, 3, 3, 3], "most of it had 3");
}

#[test]
fn evidence_goes_with_the_last_gaussian_and_its_number_is_used_again() {
    let mut graph = graph(3);
    assert_eq!(decided(&graph), [1, 1, 1, 1, 1, 1, 0], "the first of the ids with most pixels");
    graph.retain(&[true, true, false, true, true, true, true]);
    assert_eq!(decided(&graph), [1, 1, 1, 1, 1, 0]);
    graph.retain(&[true, true, false, true, true, true]);
    assert_eq!(graph.pairs.len(), 0, "both pairs were with the middle patch");
    assert_eq!(decided(&graph), [1, 1, 3, 3, 0]);
    assert_eq!(graph.new_patch(), 1);
    assert_eq!(graph.patches[1], Patch::default(), "nothing is known about the new patch");
    assert_eq!(graph.new_patch(), 3);
}

#[test]
fn gaussians_that_show_another_thing_leave_their_patch() {
    let mut graph = graph(3);
    graph.forget([2, 3, 4].into_iter());
    assert_eq!(graph.of_gaussians, [0, 0, NO_PATCH, NO_PATCH, NO_PATCH, 2, NO_PATCH]);
    assert_eq!(graph.pairs.len(), 0, "the middle patch has no Gaussians");
    graph.forget([5, 6].into_iter());
    assert_eq!(decided(&graph), [1, 1, 0, 0, 0, 0, 0]);
    assert_eq!(graph.new_patch(), 1);
}

#[test]
fn the_evidence_of_doubles_goes_to_the_earlier_patch() {
    let mut graph = graph(4);
    // The third patch is the first one, seen again; the fourth one only in part.
    graph.absorb(&[(4, 0), (5, 1), (6, 1)]);
    graph.retain(&[true, true, true, true, false, false, false, true, true]);
    assert_eq!(graph.patches[0].pixels_of_ids, [(1, 10), (3, 10)]);
    let pairs: BTreeMap<u64, PairEvidence> = graph.pairs.iter().collect();
    let of = |sum: i32, count| PairEvidence { sum: sum * UNIT, count };
    assert_eq!(pairs, BTreeMap::from([(pair_key(0, 1), of(6, 6)), (pair_key(0, 3), of(3, 3))]));
}

#[test]
fn the_evidence_of_doubles_of_doubles_goes_to_the_earliest_patch() {
    let mut graph = graph(5);
    // The fourth patch is the third one, seen again, and that the first one.
    graph.absorb(&[(4, 0), (5, 1), (6, 4), (7, 5)]);
    graph.retain(&[true, true, true, true, false, false, false, false, true, true, true]);
    assert_eq!(graph.patches[0].pixels_of_ids, [(1, 10), (3, 10), (4, 10)]);
    let pairs: BTreeMap<u64, PairEvidence> = graph.pairs.iter().collect();
    let of = |sum: i32, count| PairEvidence { sum: sum * UNIT, count };
    assert_eq!(pairs, BTreeMap::from([(pair_key(0, 1), of(6, 6)), (pair_key(0, 4), of(3, 3))]));

    // Two patches that are each other's doubles are both gone.
    let mut graph = self::graph(3);
    graph.absorb(&[(2, 4), (3, 5), (4, 2), (5, 3)]);
    graph.retain(&[true, true, false, false, false, false, true]);
    assert_eq!(decided(&graph), [1, 1, 0]);
}

#[test]
fn ids_are_renamed_and_the_rarest_are_forgotten() {
    let mut graph = graph(1);
    graph.patches[0].count(7, 5);
    graph.remap(&BTreeMap::from([(7, 1)]));
    assert_eq!(graph.patches[0].pixels_of_ids, [(1, 15)]);
    (0..IDS_PER_PATCH as u32).for_each(|more| graph.patches[0].count(20 + more, 3 + more));
    let ids: Vec<SegmentId> = graph.patches[0].pixels_of_ids.iter().map(|(id, _)| *id).collect();
    assert_eq!(ids, [1, 21, 22, 23, 24, 25, 26, 27], "20 had three pixels");
}

#[test]
fn much_evidence_keeps_its_mean_and_can_still_change() {
    let mut evidence = PairEvidence::default();
    (0..1000).for_each(|_| evidence.add(PairEvidence { sum: 96 * 10_000, count: 10_000 }));
    assert!(evidence.count <= MAX_PAIRS && evidence.sum == 96 * evidence.count as i32, "{evidence:?}");
    (0..1000).for_each(|_| evidence.add(PairEvidence { sum: -96 * 10_000, count: 10_000 }));
    assert!(evidence.sum < -48 * evidence.count as i32, "{evidence:?}");
}

#[test]
fn saved_patches_are_restored() {
    let restored = |saved: SavedPatches, gaussians| {
        let saved = SavedPatches::from_block(&saved.into_block()).map_err(|error| error.to_string())?;
        PatchGraph::restored(saved, gaussians, 9)
    };
    let mut graph = graph(3);
    graph.patches[2].frames = 5;
    graph.retain(&[true, true, false, false, true, true, true]);
    assert_eq!(restored(graph.saved(), 5), Ok(graph.clone()));
    let mut unknown = PatchGraph::default();
    unknown.add_unknown(4);
    assert!(unknown.saved().into_block().is_empty());
    assert_eq!(restored(unknown.saved(), 4), Ok(unknown));

    let error = |change: fn(&mut SavedPatches)| {
        let mut saved = self::graph(3).saved();
        change(&mut saved);
        restored(saved, 7).unwrap_err()
    };
    assert_eq!(error(|saved| saved.of_gaussians.truncate(6)), "patches of 6 Gaussians, expected 7");
    assert_eq!(error(|saved| saved.of_gaussians[0] = 1 << 31), "the patch 2147483648 of a map of 7 Gaussians");
    let message = error(|saved| saved.ids[0] = [0, 10, 1]);
    assert_eq!(message, "the patch 0 was predicted as 10: one of them does not exist");
    assert_eq!(error(|saved| saved.ids[0][2] = 0), "the patch 0 was predicted as 1 by no pixel");
    let message = error(|saved| saved.ids[1] = [0, 1, 1]);
    assert_eq!(message, "the ids of the patch 0 are too many, or do not increase");
    let message = error(|saved| saved.sums[0] = i32::MIN);
    assert_eq!(message, "impossible evidence about the patches 0 and 1: 3 pairs, sum -2147483648");
    let message = error(|saved| saved.pairs[1] = [0, 1, 1]);
    assert_eq!(message, "impossible evidence about the patches 0 and 1: 1 pairs, sum 48");
    assert_eq!(error(|saved| saved.frames.truncate(2)), "the frames of 2 patches, expected 3");
    assert_eq!(error(|saved| saved.sums.truncate(1)), "sums: found [1], expected 2 rows");
}
