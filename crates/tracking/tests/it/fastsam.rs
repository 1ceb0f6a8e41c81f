//! The baseline without memory: ids follow only from overlap between consecutive frames.

use splatseg_dataset::{Framing, Scene};
use splatseg_geometry::{Mask, Pose, RgbdFrame, ScoredMask};
use splatseg_metrics::{FramePrediction, ScoreSettings, VideoScorer};
use splatseg_segmenter::Segmenter;
use splatseg_simulators::{OraclePreset, OracleSegmenter, OracleSettings, SceneGroundTruth};
use splatseg_test_scenes::{camera, room, truth, wall};
use splatseg_tracking::{FastSamBaseline, FastSamBaselineSettings, FrameOutput, Method, TrackingError};
use std::sync::Arc;

const SIZE: (usize, usize) = (40, 10);

fn frame(size: (usize, usize)) -> RgbdFrame<'static> {
    wall("0", camera(size.0, size.1, 10.0), 1.0, Pose::IDENTITY)
}

fn stripe(from: usize, to: usize) -> ScoredMask {
    ScoredMask { mask: Mask::from_fn(SIZE.0, SIZE.1, |column, _| (from..to).contains(&column)), score: 1.0 }
}

/// Settings that accept masks of any size.
fn settings() -> FastSamBaselineSettings {
    FastSamBaselineSettings::default().with(|settings| settings.min_area = 0)
}

fn fastsam(settings: FastSamBaselineSettings) -> FastSamBaseline {
    FastSamBaseline::new(settings).unwrap()
}

fn ids(output: &FrameOutput) -> Vec<u32> {
    output.masks.iter().map(|(id, _)| *id).collect()
}

#[test]
fn slow_masks_keep_their_ids_and_a_gap_ends_them() {
    let mut method = fastsam(settings());
    let mut track = |masks: &[ScoredMask]| ids(&method.process_masks(&frame(SIZE), masks).unwrap());
    assert_eq!(track(&[stripe(0, 6), stripe(10, 16)]), [1, 2]);
    assert_eq!(track(&[stripe(13, 19), stripe(2, 8)]), [2, 1]);
    assert_eq!(track(&[stripe(4, 10)]), [1], "the second is missed");
    assert_eq!(track(&[stripe(5, 11), stripe(15, 21)]), [1, 3], "and gets a new id afterwards");
    assert_eq!(track(&[stripe(30, 36)]), [4], "too far away");
    assert!(track(&[]).is_empty());
    assert_eq!(track(&[stripe(30, 36)]), [5]);
}

#[test]
fn the_sum_of_f_scores_decides_and_can_have_a_minimum() {
    let mut method = fastsam(settings());
    method.process_masks(&frame(SIZE), &[stripe(0, 10), stripe(10, 20)]).unwrap();
    // The first mask overlaps both segments equally. The second overlaps only segment 2, so the first gets segment 1.
    let output = method.process_masks(&frame(SIZE), &[stripe(4, 16), stripe(12, 22)]).unwrap();
    assert_eq!(ids(&output), [1, 2]);

    let mut strict = fastsam(settings().with(|settings| settings.min_match_f_score = 0.5));
    strict.process_masks(&frame(SIZE), &[stripe(0, 10)]).unwrap();
    assert_eq!(ids(&strict.process_masks(&frame(SIZE), &[stripe(6, 16)]).unwrap()), [2]);
    assert_eq!(ids(&strict.process_masks(&frame(SIZE), &[stripe(8, 18)]).unwrap()), [2]);
    let refused = FastSamBaseline::new(settings().with(|settings| settings.min_match_f_score = 2.0));
    assert!(matches!(refused, Err(TrackingError::Setting(error)) if error.key == "min_match_f_score"));
}

#[test]
fn overlapping_masks_are_kept_in_full_and_painted_small_over_large() {
    let mut method = fastsam(settings().with(|settings| settings.min_area = 30));
    let output = method.process_masks(&frame(SIZE), &[stripe(3, 6), stripe(0, 10), stripe(20, 22)]).unwrap();
    assert_eq!(output.masks, [(1, stripe(3, 6).mask), (2, stripe(0, 10).mask)]);
    assert_eq!(output.segments.row(5)[..11], [2, 2, 2, 1, 1, 1, 2, 2, 2, 2, 0]);
    assert_eq!(output.predictions, 2);
}

#[test]
fn masks_must_have_the_frames_size_and_a_new_frame_size_starts_new_ids() {
    let mut method = fastsam(settings());
    method.process_masks(&frame(SIZE), &[stripe(0, 6)]).unwrap();
    assert!(matches!(method.process_masks(&frame((30, 10)), &[stripe(0, 6)]), Err(TrackingError::MaskSize { .. })));
    let wide = ScoredMask { mask: Mask::from_fn(50, 10, |column, _| column < 6), score: 1.0 };
    assert_eq!(ids(&method.process_masks(&frame((50, 10)), &[wide]).unwrap()), [2]);
}

/// Comparing 65,535 masks with 65,535 others would take hours and tens of gigabytes.
#[test]
fn more_masks_than_can_be_compared_are_refused() {
    let mut method = fastsam(settings());
    assert_eq!(method.process_masks(&frame(SIZE), &vec![stripe(0, 6); 10]).unwrap().predictions, 10);
    let error = method.process_masks(&frame(SIZE), &vec![stripe(0, 6); 2049]).unwrap_err();
    assert!(matches!(error, TrackingError::TooManyMasks { found: 2049, limit: 2048 }), "{error}");
}

/// The evaluation links masks without ids in the same way, so both have the same score.
#[test]
fn its_ids_score_like_its_masks_without_ids() {
    let scene = Arc::new(room("synthetic:width=96,height=72,frames=20"));
    let all = SceneGroundTruth::new(scene.clone(), Framing::default()).unwrap();
    let oracle = OracleSettings::default().with(|settings| settings.preset = OraclePreset::FastsamLike);
    let mut oracle = OracleSegmenter::new(all, &oracle, 1).unwrap();
    let mut method = FastSamBaseline::new(settings()).unwrap();
    let new_scorer = || VideoScorer::new(ScoreSettings::default());
    let (mut linked, mut unlinked) = (new_scorer(), new_scorer());
    for index in 0..scene.frame_count() {
        let truth = truth(scene.as_ref(), index);
        let frame = scene.read_frame(index).unwrap();
        let output = method.process_masks(&frame, &oracle.segment(&frame).unwrap().masks).unwrap();
        let masks: Vec<Mask> = output.masks.iter().map(|(_, mask)| mask.clone()).collect();
        linked.push(&truth, &FramePrediction::Masks(&output.masks)).unwrap();
        unlinked.push(&truth, &FramePrediction::Unlinked(&masks)).unwrap();
    }
    let (linked, unlinked) = (linked.finish().scores(), unlinked.finish().scores());
    assert_eq!(linked, unlinked);
    assert!(linked.vsq.unwrap() > 10.0);
}
