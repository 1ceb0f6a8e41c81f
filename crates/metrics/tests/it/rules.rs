//! Rules of the scores, on cases small enough to count by hand and on both sides of each threshold.

use splatseg_geometry::{Mask, SegmentMap};
use splatseg_metrics::{
    DatasetScore, FramePrediction, Protocol, ScoreSettings, VideoScore, VideoScorer, Void, WindowLength,
};

fn settings(protocol: Protocol) -> ScoreSettings {
    ScoreSettings { protocol, void: Void::Counted, ..ScoreSettings::default() }
}

fn row(ids: &[u32]) -> SegmentMap {
    SegmentMap::from_pixels(ids.len(), 1, ids.to_vec()).unwrap()
}

/// Scores a video of `frames` equal frames of one row.
fn video(protocol: Protocol, frames: usize, truth: &[u32], prediction: &[u32]) -> VideoScore {
    let mut scorer = VideoScorer::new(settings(protocol));
    for number in 0..frames {
        assert_eq!(scorer.frames(), number);
        scorer.push(&row(truth), &FramePrediction::Ids(&row(prediction))).unwrap();
    }
    scorer.finish()
}

/// True positives, false positives and false negatives in windows of one frame.
fn tubes(score: &VideoScore) -> (u64, u64, u64) {
    let counts = &score.counts().vsq_k[&WindowLength::One];
    (counts.true_positives, counts.false_positives, counts.false_negatives)
}

#[test]
fn strict_matches_need_an_iou_above_one_half() {
    // 2 of 4 pixels, then 3 of 5.
    assert_eq!(tubes(&video(Protocol::Strict, 1, &[1, 1, 0, 0], &[7, 7, 7, 7])), (0, 1, 1));
    assert_eq!(tubes(&video(Protocol::Strict, 1, &[1, 1, 1, 0, 0], &[7; 5])), (1, 0, 0));
    // The paper's code counts every match, and segments without overlap are not matched.
    assert_eq!(tubes(&video(Protocol::Paper, 16, &[1, 1, 0, 0], &[7, 7, 7, 7])), (1, 0, 0));
    assert_eq!(tubes(&video(Protocol::Paper, 16, &[1, 1, 0, 0], &[0, 0, 7, 7])), (0, 1, 1));
}

#[test]
fn a_video_with_the_least_frames_has_one_window() {
    let windows = |protocol, frames, length| {
        video(protocol, frames, &[1, 0], &[1, 0]).counts().vsq_k.get(&length).map_or(0, |counts| counts.windows)
    };
    for (length, frames) in WindowLength::ALL.into_iter().zip([1, 5, 10, 15]) {
        assert_eq!((length.frames(), length.least_frames(Protocol::Strict)), (frames, frames));
        assert_eq!(length.least_frames(Protocol::Paper), 16);
        for protocol in [Protocol::Strict, Protocol::Paper] {
            let least = length.least_frames(protocol);
            assert_eq!((windows(protocol, least - 1, length), windows(protocol, least, length)), (0, 1), "{length:?}");
        }
    }
}

#[test]
fn the_paper_leaves_out_only_videos_without_truth() {
    assert_eq!(tubes(&video(Protocol::Paper, 16, &[0, 0], &[5, 0])), (0, 0, 0));
    assert_eq!(tubes(&video(Protocol::Strict, 16, &[0, 0], &[5, 0])), (0, 2, 0));
    // One object found, one missed.
    assert_eq!(tubes(&video(Protocol::Paper, 16, &[1, 2, 0], &[5, 0, 0])), (1, 0, 1));
}

#[test]
fn a_track_is_overcounted_if_overlapping_masks_cover_more_than_its_area() {
    let mask = |pixels: std::ops::Range<usize>| Mask::from_fn(8, 1, |column, _| pixels.contains(&column));
    let overcounted = |masks: &[std::ops::Range<usize>]| {
        let masks: Vec<(u32, Mask)> = masks.iter().zip(1..).map(|(pixels, id)| (id, mask(pixels.clone()))).collect();
        let mut scorer = VideoScorer::new(settings(Protocol::Paper));
        scorer.push(&row(&[1, 1, 1, 1, 2, 2, 2, 2]), &FramePrediction::Masks(&masks)).unwrap();
        scorer.finish().counts().stq.overcounted_tracks
    };
    assert_eq!(overcounted(&[0..2, 2..4]), 0);
    assert_eq!(overcounted(&[0..3, 1..4]), 1);
    assert_eq!(overcounted(&[0..3, 1..4, 4..7, 5..8]), 2);
}

#[test]
fn videos_add_up() {
    let (first, second) = (
        video(Protocol::Strict, 3, &[1, 1, 2, 0, 0], &[1, 1, 0, 0, 3]),
        video(Protocol::Strict, 5, &[1, 1, 2, 2, 0], &[1, 0, 2, 2, 2]),
    );
    let mut dataset = DatasetScore::new(settings(Protocol::Strict));
    dataset.add(&first).unwrap();
    dataset.add(&second).unwrap();
    let (total, a, b) = (dataset.counts(), first.counts(), second.counts());
    assert_eq!((dataset.videos(), total.frames), (2, 8));
    assert_eq!((a.stq.labelled_predicted, a.stq.labelled_missed, a.stq.unlabelled_predicted), (6, 3, 3));
    assert_eq!((b.stq.labelled_predicted, b.stq.labelled_missed, b.stq.unlabelled_predicted), (15, 5, 5));
    assert_eq!((total.stq.tracks, total.stq.labelled_predicted), (4, 21));
    assert_eq!((total.stq.labelled_missed, total.stq.unlabelled_predicted), (8, 8));
    assert_eq!(total.stq.sum_association, a.stq.sum_association + b.stq.sum_association);
    for (length, counts) in &total.vsq_k {
        let (a, b) = (&a.vsq_k[length], &b.vsq_k[length]);
        assert_eq!(counts.sum_iou, a.sum_iou + b.sum_iou);
        assert_eq!(counts.true_positives, a.true_positives + b.true_positives);
        assert_eq!(counts.false_positives, a.false_positives + b.false_positives);
        assert_eq!(counts.false_negatives, a.false_negatives + b.false_negatives);
        assert_eq!(counts.windows, a.windows + b.windows);
    }
    // Overcounted tracks add up too.
    let whole = Mask::from_fn(2, 1, |_, _| true);
    let mut scorer = VideoScorer::new(settings(Protocol::Paper));
    scorer.push(&row(&[1, 1]), &FramePrediction::Masks(&[(1, whole.clone()), (2, whole)])).unwrap();
    let (video, mut dataset) = (scorer.finish(), DatasetScore::new(settings(Protocol::Paper)));
    dataset.add(&video).unwrap();
    dataset.add(&video).unwrap();
    assert_eq!(dataset.counts().stq.overcounted_tracks, 2);
}

#[test]
fn protocols_have_the_names_that_the_command_takes() {
    assert_eq!((Protocol::Paper.name(), Protocol::Strict.name()), ("paper", "strict"));
}
