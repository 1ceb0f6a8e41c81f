//! Comparison of single-frame scores with COCO's own code and SciPy; see `tools/make_single_frame_test_data.py`.

use serde::Deserialize;
use splatseg_geometry::{Mask, SegmentId, SegmentMap};
use splatseg_metrics::{FramePrediction, ScoreSettings, SingleFrameScores, SizeClass, VideoScorer, Void};
use std::collections::BTreeMap;

#[derive(Deserialize)]
struct Golden {
    width: usize,
    height: usize,
    frames: Vec<Frame>,
    expected: Expected,
}

#[derive(Deserialize)]
struct Frame {
    truth: Vec<(SegmentId, usize)>,
    predicted: Vec<(SegmentId, usize)>,
    confidences: BTreeMap<SegmentId, f32>,
}

#[derive(Deserialize)]
struct Expected {
    ap: f64,
    ap50: f64,
    ar: f64,
    ar_by_size: BTreeMap<SizeClass, f64>,
    boundary_f: f64,
    over_segmentation: f64,
    under_segmentation: f64,
}

impl Golden {
    fn read() -> Self {
        serde_json::from_str(include_str!("../data/single_frames.json")).unwrap()
    }

    fn map(&self, runs: &[(SegmentId, usize)]) -> SegmentMap {
        let pixels = runs.iter().flat_map(|(id, count)| std::iter::repeat_n(*id, *count)).collect();
        SegmentMap::from_pixels(self.width, self.height, pixels).unwrap()
    }

    /// The scores, with or without confidences.
    fn scores(&self, has_confidences: bool) -> SingleFrameScores {
        let mut scorer = VideoScorer::new(ScoreSettings { void: Void::Excluded, ..ScoreSettings::default() });
        for frame in &self.frames {
            let (truth, predicted) = (self.map(&frame.truth), self.map(&frame.predicted));
            let confidences = has_confidences.then_some(&frame.confidences);
            scorer.push_with_confidences(&truth, &FramePrediction::Ids(&predicted), confidences).unwrap();
        }
        scorer.finish().scores().single_frames
    }
}

fn assert_close(found: Option<f64>, expected: f64, what: &str) {
    assert!(found.is_some_and(|found| (found - expected).abs() < 1e-9), "{what}: {found:?}, expected {expected}");
}

#[test]
fn scores_are_those_of_coco() {
    let golden = Golden::read();
    let (found, expected) = (golden.scores(true), &golden.expected);
    assert_close(found.ap, expected.ap, "ap");
    assert_close(found.ap50, expected.ap50, "ap50");
    assert_close(found.ar, expected.ar, "ar");
    for (class, expected) in &expected.ar_by_size {
        assert_close(found.ar_by_size[class], *expected, class.name());
    }
    assert_close(found.boundary_f, expected.boundary_f, "boundary_f");
    assert_close(found.over_segmentation, expected.over_segmentation, "over_segmentation");
    assert_close(found.under_segmentation, expected.under_segmentation, "under_segmentation");
}

#[test]
fn precision_needs_confidences_and_nothing_else_does() {
    let golden = Golden::read();
    let mut with = golden.scores(true);
    with.ap = None;
    with.ap50 = None;
    assert_eq!(golden.scores(false), with);
}

#[test]
fn splitting_is_over_segmentation_and_merging_is_under_segmentation() {
    let halves = SegmentMap::from_fn(8, 4, |column, _| 1 + u32::from(column >= 4));
    let whole = SegmentMap::filled(8, 4, 1);
    let shares = |truth: &SegmentMap, predicted: &SegmentMap| {
        let mut scorer = VideoScorer::new(ScoreSettings::default());
        scorer.push(truth, &FramePrediction::Ids(predicted)).unwrap();
        let scores = scorer.finish().scores().single_frames;
        (scores.over_segmentation, scores.under_segmentation)
    };
    assert_eq!(shares(&halves, &whole), (Some(0.0), Some(50.0)));
    assert_eq!(shares(&whole, &halves), (Some(50.0), Some(0.0)));
    assert_eq!(shares(&halves, &halves), (Some(0.0), Some(0.0)));
}

#[test]
fn all_frames_count_and_masks_may_overlap() {
    let truth = SegmentMap::from_fn(8, 4, |column, _| 1 + u32::from(column >= 4));
    let masks = [truth.mask_of(1), truth.mask_of(2), Mask::from_fn(8, 4, |_, row| row < 2)];
    let mut scorer = VideoScorer::new(ScoreSettings::default());
    for _ in 0..3 {
        scorer.push(&truth, &FramePrediction::Unlinked(&masks)).unwrap();
    }
    let score = scorer.finish();
    assert_eq!(score.counts().single_frames.matches.windows, 3);
    let scores = score.scores().single_frames;
    assert_eq!((scores.segments_per_frame, scores.objects_per_frame), (Some(3.0), Some(2.0)));
    assert_close(scores.quality, 100.0 * 2.0 / 2.5, "quality");
}
