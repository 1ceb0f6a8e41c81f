//! Properties of any video: agreement with a slow reference, and known effects of changes.

use crate::reference;
use crate::reference::{Linked, SlowFrame, slow_score};
use proptest::prelude::*;
use splatseg_geometry::{Mask, SegmentId, SegmentMap};
use splatseg_metrics::{FramePrediction, Protocol, ScoreSettings, Scores, VideoScore, VideoScorer, Void, WindowLength};

const WIDTH: usize = 10;
const HEIGHT: usize = 7;

/// A moving rectangle that is visible in some of the frames.
#[derive(Clone, Debug)]
struct Rectangle {
    id: SegmentId,
    left: i64,
    top: i64,
    width: i64,
    height: i64,
    speed: i64,
    frames: std::ops::Range<usize>,
}

impl Rectangle {
    fn covers(&self, column: usize, row: usize, frame: usize) -> bool {
        let left = self.left + self.speed * frame as i64 / 4;
        let inside = |value: usize, start: i64, length: i64| (start..start + length).contains(&(value as i64));
        self.frames.contains(&frame) && inside(column, left, self.width) && inside(row, self.top, self.height)
    }
}

fn rectangles(count: std::ops::RangeInclusive<usize>) -> impl Strategy<Value = Vec<Rectangle>> {
    let rectangle = (-2i64..9, -1i64..6, 2i64..7, 2i64..6, -1i64..2, (0usize..10, 8usize..36));
    prop::collection::vec(rectangle, count).prop_map(|parts| {
        (1..)
            .zip(parts)
            .map(|(id, (left, top, width, height, speed, (from, to)))| Rectangle {
                id: id * 11,
                left,
                top,
                width,
                height,
                speed,
                frames: from..to,
            })
            .collect()
    })
}

/// Draws the rectangles in order, later ones on top.
fn map_of(rectangles: &[Rectangle], frame: usize) -> SegmentMap {
    SegmentMap::from_fn(WIDTH, HEIGHT, |column, row| {
        rectangles.iter().rfind(|rectangle| rectangle.covers(column, row, frame)).map_or(0, |rectangle| rectangle.id)
    })
}

/// One mask per rectangle; masks overlap.
fn masks_of(rectangles: &[Rectangle], frame: usize) -> Vec<(SegmentId, Mask)> {
    let mask = |rectangle: &Rectangle| Mask::from_fn(WIDTH, HEIGHT, |column, row| rectangle.covers(column, row, frame));
    let present = rectangles.iter().filter(|rectangle| rectangle.frames.contains(&frame));
    present.map(|rectangle| (rectangle.id, mask(rectangle))).collect()
}

fn settings() -> impl Strategy<Value = ScoreSettings> {
    let protocol = prop_oneof![Just(Protocol::Paper), Just(Protocol::Strict)];
    let void = prop_oneof![Just(Void::Counted), Just(Void::Excluded)];
    let smallest = prop_oneof![Just(0.0), Just(0.1)];
    (protocol, void, smallest).prop_map(|(protocol, void, min_ground_truth_area)| ScoreSettings {
        protocol,
        void,
        min_ground_truth_area,
    })
}

fn score_maps(settings: ScoreSettings, frames: &[(SegmentMap, SegmentMap)]) -> VideoScore {
    let mut scorer = VideoScorer::new(settings);
    for (truth, prediction) in frames {
        scorer.push(truth, &FramePrediction::Ids(prediction)).unwrap();
    }
    scorer.finish()
}

/// All scores by name.
fn listed(scores: &Scores) -> Vec<(String, Option<f64>)> {
    let mut list: Vec<_> = scores.vsq_k.iter().map(|(length, value)| (format!("{length:?}"), *value)).collect();
    list.extend(
        [("vsq", scores.vsq), ("stq", scores.stq), ("aq", scores.aq), ("sq", scores.sq)].map(|(n, v)| (n.into(), v)),
    );
    list
}

fn close(first: f64, second: f64) -> bool {
    (first - second).abs() < 1e-9
}

/// Frames with the truth, its ids shifted by 100, as prediction, with noise everywhere except on the ids in `correct`.
fn with_noise(truth: &[SegmentMap], noise: &[Rectangle], correct: &[SegmentId]) -> Vec<(SegmentMap, SegmentMap)> {
    let frame = |(index, truth): (usize, &SegmentMap)| {
        let noise = map_of(noise, index);
        let prediction =
            SegmentMap::from_fn(WIDTH, HEIGHT, |column, row| match (truth[(column, row)], noise[(column, row)]) {
                (id, _) if correct.contains(&id) => id + 100,
                (0, 0) => 0,
                (id, 0) => id + 100,
                (_, noise) => noise + 1000,
            });
        (truth.clone(), prediction)
    };
    truth.iter().enumerate().map(frame).collect()
}

fn relabelled(
    frames: &[(SegmentMap, SegmentMap)],
    mut change: impl FnMut(usize, usize, SegmentId) -> SegmentId,
) -> Vec<(SegmentMap, SegmentMap)> {
    let mut changed = frames.to_vec();
    for (_, prediction) in &mut changed {
        *prediction = SegmentMap::from_fn(WIDTH, HEIGHT, |c, r| change(c, r, prediction[(c, r)]));
    }
    changed
}

fn never_better(before: &Scores, after: &Scores) -> Result<(), TestCaseError> {
    for ((name, before), (_, after)) in listed(before).into_iter().zip(listed(after)) {
        prop_assert_eq!(before.is_some(), after.is_some(), "{}", &name);
        prop_assert!(after <= before.map(|value| value + 1e-9), "{}: {:?} became {:?}", name, before, after);
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 256, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn the_reference_agrees_for_masks_with_ids(truth in rectangles(0..=3), predicted in rectangles(0..=4),
                                            frames in 0usize..34,
                                            settings in settings(), overlapping in any::<bool>()) {
        let mut scorer = VideoScorer::new(settings);
        let mut slow = Vec::new();
        for frame in 0..frames {
            let (truth, map) = (map_of(&truth, frame), map_of(&predicted, frame));
            let masks = if overlapping { masks_of(&predicted, frame) } else { Mask::of_segments(&map) };
            let prediction = if overlapping { FramePrediction::Masks(&masks) } else { FramePrediction::Ids(&map) };
            scorer.push(&truth, &prediction).unwrap();
            slow.push(slow_frame(&truth, &masks));
        }
        same(&scorer.finish(), &slow_score(&slow, Linked::Ids, &settings))?;
    }

    #[test]
    fn the_reference_agrees_for_linked_masks(truth in rectangles(0..=3), predicted in rectangles(0..=3),
                                              frames in 0usize..34,
                                              settings in settings()) {
        let mut scorer = VideoScorer::new(settings);
        let mut slow = Vec::new();
        for frame in 0..frames {
            let truth = map_of(&truth, frame);
            let mut masks = masks_of(&predicted, frame);
            if frame % 2 == 1 {
                masks.reverse();
            }
            let bare: Vec<Mask> = masks.iter().map(|(_, mask)| mask.clone()).collect();
            scorer.push(&truth, &FramePrediction::Unlinked(&bare)).unwrap();
            slow.push(slow_frame(&truth, &masks));
        }
        let slow = slow_score(&slow, Linked::No, &settings);
        prop_assume!(!slow.ambiguous_links);
        same(&scorer.finish(), &slow)?;
    }

    #[test]
    fn a_perfect_prediction_scores_100(truth in rectangles(0..=4), frames in 1usize..34, settings in settings()) {
        let settings = ScoreSettings { protocol: Protocol::Strict, min_ground_truth_area: 0.0, ..settings };
        let maps: Vec<SegmentMap> = (0..frames).map(|frame| map_of(&truth, frame)).collect();
        let score = score_maps(settings, &with_noise(&maps, &[], &[]));
        let scores = score.scores();
        for length in WindowLength::ALL {
            prop_assert!(scores.vsq_k[&length].is_none_or(|value| value == 100.0));
        }
        prop_assert!(scores.vsq.is_none_or(|value| value == 100.0));
        let all = if score.counts().stq.tracks > 0 { 100.0 } else { 0.0 };
        for score in [scores.stq, scores.aq, scores.sq] {
            prop_assert!(close(score.unwrap(), all), "{:?}", scores);
        }
    }

    #[test]
    fn renaming_ids_changes_nothing(truth in rectangles(0..=4), predicted in rectangles(0..=4),
                                        frames in 1usize..34,
                                        settings in settings(), factor in 1u32..65536) {
        // A multiple that is coprime to the prime 65537 renames the ids 1..65536 one-to-one, and reorders them.
        let renamed = |id: SegmentId| (u64::from(id) * u64::from(factor) % 65537) as SegmentId;
        let original: Vec<_> = (0..frames).map(|frame| (map_of(&truth, frame), map_of(&predicted, frame))).collect();
        let rename = |map: &SegmentMap| map.map(|id| renamed(*id));
        let changed: Vec<_> = original.iter().map(|(truth, predicted)| (rename(truth), rename(predicted))).collect();
        let (before, after) = (score_maps(settings, &original).scores(), score_maps(settings, &changed).scores());
        for ((name, before), (_, after)) in listed(&before).into_iter().zip(listed(&after)) {
            let same = match (before, after) {
                (Some(before), Some(after)) => close(before, after),
                (before, after) => before == after,
            };
            prop_assert!(same, "{}: {:?} became {:?}", name, before, after);
        }
    }

    #[test]
    fn merging_two_correct_tubes_is_never_better(truth in rectangles(2..=4), noise in rectangles(0..=3),
                                                 frames in 1usize..34,
                                                 settings in settings()) {
        // A small truth that is dropped would make its prediction incorrect.
        let settings = ScoreSettings { min_ground_truth_area: 0.0, ..settings };
        let correct = [truth[0].id, truth[1].id];
        let maps: Vec<SegmentMap> = (0..frames).map(|frame| map_of(&truth, frame)).collect();
        let before = with_noise(&maps, &noise, &correct);
        let after = relabelled(&before, |_, _, id| if id == correct[0] + 100 { correct[1] + 100 } else { id });
        never_better(&score_maps(settings, &before).scores(), &score_maps(settings, &after).scores())?;
    }

    #[test]
    fn splitting_a_correct_tube_is_never_better(truth in rectangles(1..=4), noise in rectangles(0..=3),
                                                frames in 1usize..34,
                                                settings in settings(), at in 1usize..WIDTH) {
        // A small truth that is dropped would make its prediction incorrect.
        let settings = ScoreSettings { min_ground_truth_area: 0.0, ..settings };
        let correct = truth[0].id;
        let maps: Vec<SegmentMap> = (0..frames).map(|frame| map_of(&truth, frame)).collect();
        let before = with_noise(&maps, &noise, &[correct]);
        let in_space = relabelled(&before, |column, _, id| if id == correct + 100 && column < at { 9000 } else { id });
        let mut pixel = 0;
        let in_time = relabelled(&before, |_, _, id| {
            pixel += 1;
            if id == correct + 100 && pixel > at * 2 * WIDTH * HEIGHT { 9000 } else { id }
        });
        let scores = score_maps(settings, &before).scores();
        never_better(&scores, &score_maps(settings, &in_space).scores())?;
        never_better(&scores, &score_maps(settings, &in_time).scores())?;
    }
}

fn slow_frame(truth: &SegmentMap, masks: &[(SegmentId, Mask)]) -> SlowFrame {
    let pixels = |mask: &Mask| {
        let inside = |index: usize| mask.contains(index % WIDTH, index / WIDTH);
        (0..WIDTH * HEIGHT).map(inside).collect()
    };
    SlowFrame { truth: truth.pixels().to_vec(), masks: masks.iter().map(|(id, mask)| (*id, pixels(mask))).collect() }
}

fn same(score: &VideoScore, slow: &reference::SlowScore) -> Result<(), TestCaseError> {
    for (length, (sum_iou, tubes, windows)) in WindowLength::ALL.into_iter().zip(&slow.vsq) {
        let counts = &score.counts().vsq_k[&length];
        prop_assert!(close(counts.sum_iou, *sum_iou), "{:?}: {:?} against {:?}", length, counts, slow);
        prop_assert_eq!(
            2 * counts.true_positives + counts.false_positives + counts.false_negatives,
            *tubes as u64,
            "{:?}",
            length
        );
        prop_assert_eq!(counts.windows, *windows as u64, "{:?}", length);
    }
    let stq = &score.counts().stq;
    prop_assert!(close(stq.sum_association, slow.sum_association), "{:?} against {:?}", stq, slow);
    prop_assert_eq!(stq.tracks, slow.tracks as u64);
    let (both, missed, spurious) = slow.coverage;
    prop_assert_eq!(
        (stq.labelled_predicted, stq.labelled_missed, stq.unlabelled_predicted),
        (both as u64, missed as u64, spurious as u64)
    );
    Ok(())
}
