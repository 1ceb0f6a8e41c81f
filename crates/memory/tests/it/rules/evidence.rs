//! The memory of evidence against its definition, pixel by pixel and Gaussian by Gaussian (docs/PAPER.md, "Evidence").

use super::run::{Run, evidence};
use super::scene::{SIZE, Scene, Shot, Solid, pose};
use glam::Vec3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use splatseg_geometry::{SegmentId, SegmentMap};
use splatseg_memory::{MemorySettings, Recall, SplatContent, SplatFile, Votes};
use splatseg_render::TileWeights;
use std::collections::{BTreeMap, BTreeSet};

/// Largest id in the predictions.
const IDS: SegmentId = 6;

/// The id whose predictions count as contradicted.
const CONTRADICTED: SegmentId = 4;
/// Maximum difference of sums in another order, and minimum lead of a clear result.
const CLOSE: f32 = 1e-4;

/// A second opinion with less evidence, relative to one vote for a contradicted mask, is none.
const MIN_OPINION: f32 = 0.4;

/// A Gaussian seen by a pixel.
#[derive(Clone, Copy, Debug)]
struct Seen {
    gaussian: usize,
    weight: f32,
    depth: f32,
}

/// Returns the Gaussians at every pixel, from front to back.
fn seen_at_pixels(recall: &Recall<'_>) -> Vec<Vec<Seen>> {
    let mut pixels = vec![Vec::new(); SIZE.0 * SIZE.1];
    for tile in recall.view().weights().tiles() {
        let (left, top) = tile.origin();
        for (column, (gaussian, depth)) in tile.gaussians().iter().zip(tile.depths()).enumerate() {
            for (pixel, weight) in tile.column(column) {
                let (row, column) = (usize::from(pixel) / TileWeights::SIDE, usize::from(pixel) % TileWeights::SIDE);
                let at = (top + row) * SIZE.0 + left + column;
                pixels[at].push(Seen { gaussian: *gaussian as usize, weight, depth: *depth });
            }
        }
    }
    pixels
}

fn votes_of(run: &Run) -> Vec<Votes> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("map.ply");
    run.memory.save(&path).unwrap();
    match SplatFile::load(&path).unwrap().content {
        SplatContent::Evidence { votes } => votes,
        _ => panic!("a memory of evidence"),
    }
}

/// Maximum difference of the depths of one surface at a distance.
fn tolerance(distance: f32, settings: &MemorySettings) -> f32 {
    settings.depth_tolerance.max(0.05 * distance)
}

/// `E_p(id)` by definition.
fn evidence_at(seen: &[Seen], observed: f32, votes: &[Votes], settings: &MemorySettings) -> BTreeMap<SegmentId, f32> {
    let (mut light, mut evidence) = (1.0, BTreeMap::new());
    for Seen { gaussian, weight, depth } in seen.iter().copied() {
        let behind = if observed > 0.0 { depth - observed } else { 0.0 };
        if behind < -tolerance(observed, settings) {
            light -= weight;
        } else if behind <= tolerance(observed, settings) {
            for (id, votes) in votes[gaussian].iter() {
                *evidence.entry(id).or_insert(0.0) += weight * votes;
            }
        }
    }
    evidence.values_mut().for_each(|evidence| *evidence /= f32::max(light, 0.05));
    evidence
}

/// Returns the id with the most evidence, that evidence, and its lead.
fn best(evidence: &BTreeMap<SegmentId, f32>) -> (SegmentId, f32, f32) {
    let mut ordered: Vec<(SegmentId, f32)> = evidence.iter().map(|(id, evidence)| (*id, *evidence)).collect();
    ordered.sort_by(|one, other| other.1.total_cmp(&one.1));
    ordered.push((0, 0.0));
    let lead = ordered[0].1 - ordered.get(1).map_or(0.0, |second| second.1);
    (ordered[0].0, ordered[0].1, lead)
}

/// Returns the segment with the most evidence besides `expected`, that evidence, and its lead.
fn second_best(evidence: &BTreeMap<SegmentId, f32>, expected: SegmentId) -> (SegmentId, f32, f32) {
    let others = evidence.iter().filter(|(id, _)| **id != 0 && **id != expected);
    best(&others.map(|(id, evidence)| (*id, *evidence)).collect())
}

/// Compares the expected and the fused segments with the definition. Returns the number of clear pixels.
fn check_pixels(run: &Run, recall: &Recall<'_>, predicted: &SegmentMap, votes: &[Votes]) -> usize {
    let settings = run.memory.settings();
    let (belief, fused) = (recall.expected(), run.memory.fuse(recall, predicted).unwrap());
    let opinion = run.memory.second_opinion(recall);
    let mut clear = 0;
    for (at, gaussians) in seen_at_pixels(recall).iter().enumerate() {
        let silhouette: f32 = gaussians.iter().map(|seen| seen.weight).sum();
        let mut evidence = evidence_at(gaussians, recall.frame().depth().pixels()[at], votes, settings);
        let (id, most, lead) = best(&evidence);
        let is_clear = lead > CLOSE && (silhouette - 0.3).abs() > CLOSE;
        if is_clear {
            let is_expected = silhouette > 0.3 && id != 0;
            let expected = if is_expected { (id, most.min(1.0)) } else { (0, 0.0) };
            assert_eq!(belief.segments.pixels()[at], expected.0, "pixel {at}: {evidence:?}");
            assert!((belief.confidence.pixels()[at] - expected.1).abs() < CLOSE, "pixel {at}: {evidence:?}");
        }
        let (second, most, lead) = second_best(&evidence, belief.segments.pixels()[at]);
        let least = MIN_OPINION * settings.contradicted_weight;
        if lead > CLOSE && (most - least).abs() > CLOSE {
            let second = if most > least { second } else { 0 };
            assert_eq!(opinion.pixels()[at], second, "pixel {at}: {evidence:?}");
        }
        let own = predicted.pixels()[at];
        *evidence.entry(own).or_insert(0.0) += if own == 0 { settings.no_segment_weight } else { 1.0 };
        let (id, _, lead) = best(&evidence);
        if lead > CLOSE {
            assert_eq!(fused.pixels()[at], id, "pixel {at} of {}: {evidence:?}", predicted.pixels()[at]);
            clear += usize::from(is_clear);
        }
    }
    clear
}

/// Returns the votes that every Gaussian should have after a frame; `None` where they are too close to call.
fn votes_after(
    recall: &Recall<'_>,
    predicted: &SegmentMap,
    votes: &[Votes],
    settings: &MemorySettings,
) -> Vec<Option<BTreeMap<SegmentId, f32>>> {
    let mut labels: Vec<(f32, BTreeMap<SegmentId, f32>)> = vec![Default::default(); votes.len()];
    for (at, gaussians) in seen_at_pixels(recall).iter().enumerate() {
        let observed = recall.frame().depth().pixels()[at];
        for Seen { gaussian, weight, depth } in gaussians.iter().copied() {
            if observed > 0.0 && (depth - observed).abs() > tolerance(observed, settings) {
                continue;
            }
            labels[gaussian].0 += weight;
            *labels[gaussian].1.entry(predicted.pixels()[at]).or_insert(0.0) += weight;
        }
    }
    let after = |(votes, (total, labels)): (&Votes, &(f32, BTreeMap<SegmentId, f32>))| {
        let mut after: BTreeMap<SegmentId, f32> = votes.iter().collect();
        if *total == 0.0 {
            return Some(after);
        }
        for (id, weight) in labels {
            let say = match *id {
                0 => settings.no_segment_weight,
                CONTRADICTED => settings.contradicted_weight,
                _ => 1.0,
            };
            *after.entry(*id).or_insert(0.0) += say * weight / total.max(1.0);
        }
        let sum: f32 = after.values().sum();
        after.values_mut().for_each(|votes| *votes *= f32::min(1.0, settings.max_votes / sum));
        // More than four ids compete for slots, and negligible votes are dropped: too close to call.
        (after.len() <= Votes::SLOTS && after.values().all(|votes| *votes > 0.02 + CLOSE)).then_some(after)
    };
    votes.iter().zip(&labels).map(after).collect()
}

/// A view of boxes with noise and sometimes holes in the depth. One box comes and goes; it fills whole tiles.
fn noisy_shot(number: usize, random: &mut ChaCha8Rng) -> Shot {
    let visitor = Solid::new(5, [0.0, -0.2, 1.4], [0.8, 0.8, 0.2]);
    let scene = if number % 4 == 1 { Scene::boxes().with(visitor) } else { Scene::boxes() };
    let position = Vec3::from_array(std::array::from_fn(|_| random.random_range(-0.15..0.15)));
    let mut shot = scene.seen_from(pose(position.to_array(), random.random_range(-8.0..8.0)));
    let has_holes = number.is_multiple_of(2);
    for depth in shot.depth.pixels_mut() {
        *depth =
            if has_holes && random.random_range(0..40) == 0 { 0.0 } else { *depth + random.random_range(-0.04..0.04) };
    }
    shot
}

/// Returns the true ids as predictions, except for rectangles with another id or none.
fn noisy_predictions(shot: &Shot, random: &mut ChaCha8Rng) -> SegmentMap {
    let mut predicted = shot.truth.clone();
    for id in [0, 0, random.random_range(1..=IDS), random.random_range(1..=IDS)] {
        let (left, top) = (random.random_range(0..SIZE.0 - 30), random.random_range(0..SIZE.1 - 30));
        let (width, height) = (random.random_range(3..30), random.random_range(3..30));
        for row in top..top + height {
            for column in left..left + width {
                predicted[(column, row)] = id;
            }
        }
    }
    predicted
}

#[test]
fn expected_fused_and_learnt_segments_match_the_definition() {
    let defaults = evidence();
    // With `removal_frames` 0, Gaussians that a frame sees through stay in the view, in front.
    let removes_nothing = evidence().with(|settings| settings.removal_frames = 0);
    let others = evidence().with(|settings| {
        settings.no_segment_weight = 0.4;
        settings.contradicted_weight = 0.6;
        settings.max_votes = 2.0;
        settings.depth_tolerance = 0.2;
    });
    for settings in [defaults, removes_nothing, others] {
        let mut random = ChaCha8Rng::seed_from_u64(7);
        let mut run = Run::new(settings.clone());
        (0..IDS).for_each(|_| _ = run.memory.new_segment().unwrap());
        let (mut clear, mut learnt) = (0, 0);
        for number in 0..8 {
            let shot = noisy_shot(number, &mut random);
            let predicted = noisy_predictions(&shot, &mut random);
            let (frame, votes) = (shot.frame(), votes_of(&run));
            let recall = run.memory.recall(&frame);
            clear += check_pixels(&run, &recall, &predicted, &votes);
            let expected = votes_after(&recall, &predicted, &votes, &settings);
            let update = run.memory.update(recall, &predicted, &BTreeSet::from([CONTRADICTED])).unwrap();
            if update.removed > 0 {
                continue;
            }
            for (expected, found) in expected.iter().zip(votes_of(&run)) {
                let Some(expected) = expected else { continue };
                let found: BTreeMap<SegmentId, f32> = found.iter().collect();
                let is_equal = expected.len() == found.len()
                    && expected
                        .iter()
                        .zip(&found)
                        .all(|(one, other)| one.0 == other.0 && (one.1 - other.1).abs() < CLOSE);
                assert!(is_equal, "frame {number}: {found:?} instead of {expected:?}");
                learnt += 1;
            }
        }
        assert!(clear > 4 * SIZE.0 * SIZE.1, "{clear} pixels");
        assert!(learnt > 3 * run.memory.gaussian_count(), "{learnt} Gaussians");
    }
}

#[test]
fn of_two_ids_with_equal_evidence_the_smaller_one_is_expected() {
    for order in [[1, 2], [2, 1]] {
        let shot = Scene::wall().seen_from_origin();
        let mut run = Run::new(evidence());
        for id in order {
            run.show_as(&shot, &shot.truth.map(|_| id));
        }
        let frame = shot.frame();
        let recall = run.memory.recall(&frame);
        assert_eq!(recall.expected().segments, shot.truth, "first predicted as {}", order[0]);
    }
}

#[test]
fn shares_are_of_the_segment_with_the_most_votes() {
    let shot = Scene::wall().seen_from_origin();
    let mut run = Run::new(evidence());
    for id in [1, 1, 2] {
        run.show_as(&shot, &shot.truth.map(|_| id));
    }
    let shares = run.memory.map().segment_shares();
    assert_eq!(shares.len(), run.memory.gaussian_count());
    assert!(shares.iter().all(|share| (share - 2.0 / 3.0).abs() < 1e-3), "{shares:?}");
}

#[test]
fn a_gaussian_has_seven_numbers_and_eight_for_its_votes() {
    let mut run = Run::new(evidence());
    run.show(&Scene::wall().seen_from_origin());
    assert_eq!(run.memory.map().parameter_count(), 15 * run.memory.gaussian_count());
}

#[test]
fn the_gaussians_that_got_votes_are_counted() {
    let shot = Scene::wall().seen_from_origin();
    let mut run = Run::new(evidence());
    assert_eq!(run.show(&shot).update.learning.active_gaussians, 0, "all are new");
    let learning = run.show(&shot).update.learning;
    assert_eq!((learning.active_gaussians, learning.active_pixels), (run.memory.gaussian_count(), SIZE.0 * SIZE.1));
}
