//! FastSAM-Splat in the synthetic room, where every id is known: ids last while objects leave the view and return.

use crate::exact_masks::{MIN_AREA, count_pairs, evidence, features, masks, method};
use splatseg_dataset::{Scene, SyntheticScene};
use splatseg_geometry::{CameraFrame, Image, Mask, RgbdFrame, ScoredMask, SegmentId, SegmentMap};
use splatseg_memory::{MemorySettings, SplatContent, SplatFile};
use splatseg_test_scenes::truth;
use splatseg_tracking::{
    FastSamBaseline, FastSamBaselineSettings, FastSamSplat, FastSamSplatSettings, FastSpamBaseline,
    FastSpamBaselineSettings, FrameOutput, Method, ShownFrame, TrackingError,
};
use std::collections::BTreeMap;

fn room(frames: usize) -> SyntheticScene {
    splatseg_test_scenes::room(&format!("synthetic:width=112,height=84,frames={frames},objects=12,seed=5"))
}

/// Returns the fraction of the pixels that show the most frequent output id of their object.
fn consistency(pairs: &BTreeMap<(SegmentId, SegmentId), usize>) -> f64 {
    let mut best: BTreeMap<SegmentId, usize> = BTreeMap::new();
    for ((truth, _), count) in pairs {
        let largest = best.entry(*truth).or_insert(0);
        *largest = (*largest).max(*count);
    }
    best.values().sum::<usize>() as f64 / pairs.values().sum::<usize>() as f64
}

/// Runs the method for slightly more than one revolution of the camera and checks that ids last.
fn assert_ids_last(memory: MemorySettings) {
    let scene = room(52);
    let mut method = method(memory);
    let mut pairs = BTreeMap::new();
    let (mut seen, mut returned) = (BTreeMap::new(), 0);
    for index in 0..scene.frame_count() {
        let truth = truth(&scene, index);
        let frame = scene.read_frame(index).unwrap();
        let output = method.process_masks(&frame, &masks(&truth, index)).unwrap();
        let has_small_segments = output.segments.areas().values().any(|area| *area < MIN_AREA);
        assert!(!has_small_segments, "small segments are not shown in frame {index}");
        count_pairs(&mut pairs, &truth, &output.segments);
        for id in truth.areas().into_keys() {
            returned += usize::from(seen.insert(id, index).is_some_and(|last| last + 5 < index));
        }
    }
    assert!(returned >= 3, "the test needs objects that leave and return, there were {returned}");
    let objects = seen.len();
    let consistency = consistency(&pairs);
    assert!(consistency > 0.97, "{consistency} of the pixels keep their object's id");
    let ids = method.memory().unwrap().segment_count();
    // Slivers at the image border may get their own id before their object is known.
    assert!(ids <= objects + objects / 3, "{ids} ids for {objects} objects");
}

#[test]
fn ids_last_while_objects_leave_and_return() {
    assert_ids_last(evidence());
}

#[test]
fn ids_last_in_a_memory_of_features() {
    assert_ids_last(features());
}

#[test]
fn the_map_of_the_end_decides_earlier_frames_again() {
    let scene = room(4);
    let truth = truth(&scene, 0);
    let frame = scene.read_frame(0).unwrap();
    let all = masks(&truth, 0);
    let mut method = method(evidence());
    // One mask over everything at first, then the objects, each of which gets an id of its own.
    let whole = ScoredMask { mask: Mask::from_fn(frame.width(), frame.height(), |_, _| true), score: 1.0 };
    let first = method.process_masks(&frame, &[whole]).unwrap().segments;
    assert_eq!(first.areas().len(), 1);
    let latest = (0..20).map(|_| method.process_masks(&frame, &all).unwrap().segments).last().unwrap();
    let shown = |segments: &SegmentMap, regions: Option<SegmentMap>| ShownFrame { segments: segments.clone(), regions };
    let hindsight = method.hindsight().unwrap();
    let again = hindsight.look_again(&frame, &shown(&first, None)).unwrap();
    let same = again.segments.pixels().iter().zip(latest.pixels()).filter(|(one, other)| one == other).count();
    assert!(same * 100 > latest.pixels().len() * 97, "{same} pixels are as in the last frame");
    assert!(again.confidence.pixels().iter().all(|confidence| *confidence > 0.0));
    // A region shows one id.
    let halves =
        SegmentMap::from_fn(frame.width(), frame.height(), |column, _| 1 + (2 * column / frame.width()) as u32);
    let again = hindsight.look_again(&frame, &shown(&first, Some(halves))).unwrap();
    assert!(again.segments.areas().len() <= 2, "{:?}", again.segments.areas());
    // What is gone shows what it showed at the time.
    let gone = frame.depth().map(|depth| 0.4 * depth);
    let camera = frame.clone().into_camera_frame();
    let before = CameraFrame::new("0", camera.color().clone(), gone, *camera.intrinsics()).unwrap();
    let before = before.at(*frame.world_from_camera());
    assert_eq!(hindsight.look_again(&before, &shown(&first, None)).unwrap().segments, first);
    let small = SegmentMap::filled(3, 3, 1);
    assert!(matches!(hindsight.look_again(&frame, &shown(&small, None)), Err(TrackingError::MaskSize { .. })));
    assert!(crate::exact_masks::method(features()).hindsight().is_none());
}

/// Processes the first frame `seen_frames` times with its masks and then `blind_frames` times without masks. Returns
/// the fraction of the labelled pixels that still have a segment for each of the latter.
fn shown_when_blind(memory: MemorySettings, seen_frames: usize, blind_frames: usize) -> Vec<f32> {
    let scene = room(4);
    let mut method = method(memory);
    let frame = scene.read_frame(0).unwrap();
    let labelled = |map: &SegmentMap| map.pixels().iter().filter(|id| **id != 0).count();
    let mut known = 0;
    for index in 0..seen_frames {
        let all = masks(&truth(&scene, 0), index);
        known = labelled(&method.process_masks(&frame, &all).unwrap().segments);
        assert_eq!(method.memory().unwrap().segment_count(), all.len());
    }
    let mut fraction = || labelled(&method.process_masks(&frame, &[]).unwrap().segments) as f32 / known as f32;
    (0..blind_frames).map(|_| fraction()).collect()
}

#[test]
fn features_fill_in_missing_masks_and_fade() {
    // C_conf = 0.1 per frame lowers a confidence of 1 below 0.5.
    let shown = shown_when_blind(features(), 1, 8);
    assert!(shown[..3].iter().all(|fraction| *fraction > 0.9), "{shown:?}");
    assert_eq!(shown[7], 0.0, "{shown:?}");
}

/// Returns the number of frames without masks in which a segment is still shown, after `seen_frames` with its mask, at
/// a pixel that sees a single Gaussian.
///
/// The segment gets one vote per frame, scaled down to `max_votes`. "No segment" gets `no_segment_weight` votes per
/// frame without a mask, plus the current frame's own vote.
fn frames_remembered(settings: &MemorySettings, seen_frames: usize) -> usize {
    let (mut votes, mut against) = ((seen_frames as f32).min(settings.max_votes), 0.0);
    let mut frames = 0;
    while votes > against + settings.no_segment_weight {
        frames += 1;
        against += settings.no_segment_weight;
        let scale = (settings.max_votes / (votes + against)).min(1.0);
        (votes, against) = (votes * scale, against * scale);
    }
    frames
}

#[test]
fn votes_fill_in_missing_masks_until_they_are_outvoted() {
    assert_eq!([1, 30].map(|seen_frames| frames_remembered(&evidence(), seen_frames)), [9, 28]);
    for seen_frames in [1, 30] {
        let remembered = frames_remembered(&evidence(), seen_frames);
        let shown = shown_when_blind(evidence(), seen_frames, remembered + 6);
        // The vote is close in the last of these frames and in the next: blended neighbours decide.
        assert!(shown[..remembered - 1].iter().all(|fraction| *fraction > 0.9), "seen {seen_frames} times: {shown:?}");
        // Gaussians smaller than a pixel get less than one vote per frame, so they remember for longer.
        assert!(shown[remembered + 1..].iter().all(|fraction| *fraction < 0.1), "seen {seen_frames} times: {shown:?}");
    }
}

#[test]
fn every_feature_dimension_works() {
    let scene = room(48);
    for feature_dim in [1, 4, 7, 14, 28, 5] {
        let mut method = method(features().with(|settings| settings.feature_dim = feature_dim));
        let mut pairs = BTreeMap::new();
        for index in 0..5 {
            let truth = truth(&scene, index);
            let output = method.process_masks(&scene.read_frame(index).unwrap(), &masks(&truth, index)).unwrap();
            count_pairs(&mut pairs, &truth, &output.segments);
        }
        // One channel cannot distinguish a mixture of two ids from a third id; the paper's ablation shows the same.
        let expected = if feature_dim == 1 { 0.5 } else { 0.95 };
        assert!(consistency(&pairs) > expected, "D = {feature_dim}: {}", consistency(&pairs));
    }
}

#[test]
fn more_objects_than_codes_still_get_ids() {
    let scene = room(2);
    let mut method = method(features().with(|settings| {
        settings.num_codes = 3;
        settings.feature_dim = 8;
    }));
    let truth = truth(&scene, 0);
    let all = masks(&truth, 0);
    let output = method.process_masks(&scene.read_frame(0).unwrap(), &all).unwrap();
    assert_eq!(output.segments.areas().len(), all.len());
    let file = tempfile::NamedTempFile::new().unwrap();
    method.memory().unwrap().save(file.path()).unwrap();
    let SplatContent::Features { codebook, .. } = SplatFile::load(file.path()).unwrap().content else {
        panic!("a memory of features")
    };
    assert!(all.len() > 3 && codebook.len() >= all.len());
}

#[test]
fn frames_without_depth_or_masks_are_accepted() {
    let scene = room(2);
    let frame = scene.read_frame(0).unwrap();
    let blind = RgbdFrame::new(
        "blind",
        frame.color().clone(),
        Image::filled(frame.width(), frame.height(), 0.0),
        *frame.intrinsics(),
        *frame.world_from_camera(),
    )
    .unwrap();
    for memory in [evidence(), features()] {
        let mut method = method(memory);
        let output = method.process_masks(&blind, &masks(&truth(&scene, 0), 0)).unwrap();
        assert!(output.segments.areas().len() > 3, "segments are shown without depth");
        // Nothing is remembered, or only far behind the surfaces that the next frame shows.
        assert!(method.process_masks(&frame, &[]).unwrap().segments.areas().is_empty());
    }
}

#[test]
fn masks_of_another_size_are_rejected() {
    let scene = room(1);
    let wrong = ScoredMask { mask: Mask::empty(10, 10), score: 1.0 };
    let error = method(evidence()).process_masks(&scene.read_frame(0).unwrap(), &[wrong]).unwrap_err();
    assert!(matches!(error, TrackingError::MaskSize { found: (10, 10), expected: (112, 84) }));
}

#[test]
fn whole_masks_or_visible_parts_are_matched() {
    let ids = |whole: bool| {
        let settings = FastSamSplatSettings::default().with(|settings| {
            settings.match_whole_masks = whole;
            settings.memory = features();
            settings.min_area = 1;
        });
        let mut method = FastSamSplat::new(settings, 0, &mut |_| {}).unwrap();
        let scene = room(1);
        let frame = scene.read_frame(0).unwrap();
        let (width, height) = (frame.width(), frame.height());
        let upto = |end: usize| ScoredMask { mask: Mask::from_fn(width, height, |column, _| column < end), score: 1.0 };
        let wide = method.process_masks(&frame, &[upto(80)]).unwrap().segments[(70, 40)];
        // The larger mask is more similar to the remembered segment, but of the visible parts the smaller mask's is.
        let second = method.process_masks(&frame, &[upto(80), upto(60)]).unwrap().segments;
        (wide, second[(20, 40)], second[(70, 40)])
    };
    let (known, under_small, under_large) = ids(true);
    assert_eq!(under_large, known);
    assert_ne!(under_small, known);
    let (known, under_small, under_large) = ids(false);
    assert_eq!(under_small, known);
    assert_ne!(under_large, known);
}

#[test]
fn small_predictions_are_ignored_and_small_segments_are_not_shown() {
    let ids = |min_area: usize, predicted: &[(usize, usize)]| {
        let settings = FastSamSplatSettings::default().with(|settings| settings.min_area = min_area);
        let mut method = FastSamSplat::new(settings, 0, &mut |_| {}).unwrap();
        let frame = room(1).read_frame(0).unwrap();
        let (width, height) = (frame.width(), frame.height());
        let masks = predicted.iter().map(|(columns, rows)| {
            let mask = Mask::from_fn(width, height, |column, row| column < *columns && row < *rows);
            ScoredMask { mask, score: 1.0 }
        });
        let output = method.process_masks(&frame, &masks.collect::<Vec<_>>()).unwrap();
        (output.predictions, output.segments.areas().into_keys().collect::<Vec<_>>())
    };
    assert_eq!(ids(31, &[(6, 5)]), (0, vec![]));
    assert_eq!(ids(30, &[(6, 5)]), (1, vec![1]));
    // The smaller prediction leaves 30 of the 60 pixels of the larger one.
    assert_eq!(ids(30, &[(6, 10), (6, 5)]), (2, vec![1, 2]));
    assert_eq!(ids(31, &[(6, 10), (6, 5)]), (1, vec![1]), "an ignored prediction covers nothing");
    assert_eq!(ids(35, &[(6, 10), (6, 6)]), (1, vec![1]), "24 pixels of the larger one are visible");
}

/// Returns the number of predictions that count, of a mask of 40x10 pixels and a second mask that leaves `visible`
/// columns of it visible.
fn counted(visible: usize, least: usize) -> usize {
    let settings = FastSamSplatSettings::default().with(|settings| settings.min_area = least);
    let mut method = FastSamSplat::new(settings, 0, &mut |_| {}).unwrap();
    let frame = room(1).read_frame(0).unwrap();
    let (width, height) = (frame.width(), frame.height());
    let columns = |from: usize, to: usize| {
        let mask = Mask::from_fn(width, height, |column, row| (from..to).contains(&column) && row < 10);
        ScoredMask { mask, score: 1.0 }
    };
    method.process_masks(&frame, &[columns(0, 40), columns(visible, 40)]).unwrap().predictions
}

#[test]
fn a_prediction_counts_only_if_enough_pixels_and_a_large_enough_fraction_are_visible() {
    assert_eq!(counted(13, 100), 2, "130 pixels and more than three tenths");
    assert_eq!(counted(11, 100), 1, "110 pixels, but less than three tenths");
    assert_eq!(counted(13, 131), 1, "more than three tenths, but less than 131 pixels");
}

#[test]
fn a_contradicted_prediction_shows_the_expected_segment_and_has_one_id() {
    let settings = FastSamSplatSettings::default().with(|settings| settings.min_area = 1);
    let mut method = FastSamSplat::new(settings, 0, &mut |_| {}).unwrap();
    let frame = room(1).read_frame(0).unwrap();
    let mask = |from: usize, to: usize| {
        let is_inside = |column, row| (from..to).contains(&column) && (from..to).contains(&row);
        ScoredMask { mask: Mask::from_fn(frame.width(), frame.height(), is_inside), score: 1.0 }
    };
    let ids = |masks: &[ScoredMask], method: &mut FastSamSplat| {
        method.process_masks(&frame, masks).unwrap().segments.areas().into_keys().collect::<Vec<_>>()
    };
    for _ in 0..10 {
        assert_eq!(ids(&[mask(5, 80)], &mut method), [1]);
    }
    for number in 0..6 {
        assert_eq!(ids(&[mask(5, 80), mask(30, 50)], &mut method), [1], "frame {number} of two masks");
    }
    assert_eq!(method.memory().unwrap().segment_count(), 2, "the second mask has the same id in each frame");
    let shown = (0..20).map(|_| ids(&[mask(5, 80), mask(30, 50)], &mut method)).last().unwrap();
    assert_eq!(shown, [1, 2], "enough frames convince the memory");
}

#[test]
fn methods_have_the_names_of_the_command_line() {
    assert_eq!(method(evidence()).name(), "fastsam-splat");
    assert_eq!(FastSamBaseline::new(FastSamBaselineSettings::default()).unwrap().name(), "fastsam");
    assert_eq!(FastSpamBaseline::new(FastSpamBaselineSettings::default(), 0).unwrap().name(), "fastspam");
}

#[test]
fn a_result_from_segments_has_confidence_1() {
    let segments = SegmentMap::from_pixels(3, 1, vec![7, 0, 2]).unwrap();
    let output = FrameOutput::from_segments(segments.clone());
    assert_eq!((output.confidence.pixels(), output.segments), (&[1.0, 0.0, 1.0][..], segments));
}
