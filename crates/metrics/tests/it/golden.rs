//! Comparison of scores with reference numbers from the paper's evaluation code, SciPy and deeplab2.
//!
//! `tools/make_metrics_test_data.py` checks the reference numbers in `tests/data` and documents their origin.

use crate::videos::{LabelledFrame, PredictionForm, read_video, score};
use serde_json::Value;
use splatseg_geometry::SegmentMap;
use splatseg_metrics::{
    DatasetScore, FramePrediction, MetricsError, Protocol, RawCounts, ScoreSettings, Scores, VideoScore, VideoScorer,
    Void, WindowLength,
};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Tolerance for sums in f32, in deeplab2 and the paper's code.
const SINGLE: f64 = 1e-6;
const DOUBLE: f64 = 1e-9;

fn data() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data")
}

fn json(path: PathBuf) -> Value {
    let text = std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    serde_json::from_str(&text).unwrap()
}

fn settings(protocol: Protocol, void: Void) -> ScoreSettings {
    ScoreSettings { protocol, void, ..ScoreSettings::default() }
}

/// Compares a percentage with a fraction that may be null.
#[track_caller]
fn assert_percent(found: Option<f64>, expected: &Value, tolerance: f64, what: &str) {
    match (found, expected.as_f64()) {
        (Some(found), Some(expected)) => {
            assert!((found / 100.0 - expected).abs() <= tolerance, "{what}: {found} % against {expected}");
        }
        (found, expected) => assert_eq!(found, expected, "{what}"),
    }
}

#[track_caller]
fn assert_vsq(counts: &RawCounts, scores: &Scores, expected: &Value, what: &str) {
    for length in WindowLength::ALL {
        let expected = &expected["per_k"][length.frames().to_string()];
        let found = &counts.vsq_k[&length];
        for (name, count) in [
            ("tp", found.true_positives),
            ("fp", found.false_positives),
            ("fn", found.false_negatives),
            ("windows", found.windows),
        ] {
            assert_eq!(Some(count), expected[name].as_u64(), "{what}: {name} at k = {}", length.frames());
        }
        let sum_iou = expected["sum_iou"].as_f64().unwrap();
        assert!((found.sum_iou - sum_iou).abs() <= DOUBLE, "{what}: {} against {sum_iou}", found.sum_iou);
        assert_percent(scores.vsq_k[&length], &expected["VSQ"], DOUBLE, what);
    }
    if let Some(vsq) = expected.get("VSQ") {
        assert_percent(scores.vsq, vsq, DOUBLE, what);
    }
}

/// Scores every video in `expected`, checks each with `check` and returns the sum.
fn over_videos(
    root: &Path,
    expected: &Value,
    score_video: impl Fn(&[LabelledFrame]) -> VideoScore,
    check: impl Fn(&VideoScore, &Value, &str),
) -> DatasetScore {
    let videos = expected["videos"].as_object().unwrap();
    let mut dataset: Option<DatasetScore> = None;
    for (name, expected) in videos {
        let score = score_video(&read_video(&root.join("stq").join(name)));
        check(&score, expected, name);
        dataset.get_or_insert_with(|| DatasetScore::new(*score.settings())).add(&score).unwrap();
    }
    dataset.unwrap()
}

fn check_strict_vsq(root: &Path) {
    let variants = &json(root.join("vsq/expected.json"))["variants"];
    for (name, void) in [("void_counted", Void::Counted), ("void_excluded", Void::Excluded)] {
        for form in [PredictionForm::Ids, PredictionForm::Masks] {
            let expected = &variants[format!("{name}/full_windows/iou_gt_0.5")];
            let dataset = over_videos(
                root,
                expected,
                |frames| score(frames, form, settings(Protocol::Strict, void)),
                |score, expected, video| {
                    assert_vsq(score.counts(), &score.scores(), expected, &format!("{name}, {form:?}, {video}"))
                },
            );
            if expected.get("per_k").is_some() {
                assert_vsq(dataset.counts(), &dataset.total(), expected, name);
            }
        }
    }
}

fn check_paper_vsq(root: &Path) {
    let authors = &json(root.join("vsq/authors_protocol.json"))["vsq"];
    for (name, form) in
        [("ids", PredictionForm::Ids), ("ids", PredictionForm::Masks), ("no_ids", PredictionForm::Unlinked)]
    {
        let expected = &authors[name];
        let dataset = over_videos(
            root,
            expected,
            |frames| score(frames, form, settings(Protocol::Paper, Void::Counted)),
            |score, expected, video| {
                assert_vsq(score.counts(), &score.scores(), expected, &format!("{name}, {form:?}, {video}"))
            },
        );
        if expected.get("per_k").is_some() {
            assert_vsq(dataset.counts(), &dataset.total(), expected, name);
        }
    }
}

fn check_paper_stq(root: &Path) {
    let authors = &json(root.join("vsq/authors_protocol.json"))["stq"];
    let check = |counts: &RawCounts, scores: &Scores, expected: &Value, what: &str| {
        assert_percent(scores.aq, &expected["AQ"], SINGLE, what);
        assert_percent(scores.sq, &expected["SQ"], SINGLE, what);
        if let Some(stq) = expected.get("STQ") {
            assert_percent(scores.stq, stq, SINGLE, what);
        }
        let stq = &counts.stq;
        let pixels = |key: &str| expected[key].as_array().unwrap().iter().map(|n| n.as_f64().unwrap()).collect();
        let (intersections, unions): (Vec<f64>, Vec<f64>) = (pixels("intersection"), pixels("union"));
        assert_eq!(intersections, [stq.labelled_predicted as f64, 0.0], "{what}");
        assert_eq!(
            unions,
            [(stq.labelled_predicted + stq.labelled_missed) as f64, stq.labelled_missed as f64],
            "{what}"
        );
        if let Some(tracks) = expected.get("gt_tracks") {
            assert_eq!(Some(stq.tracks), tracks.as_u64(), "{what}");
        }
    };
    for (name, form) in
        [("ids", PredictionForm::Ids), ("ids", PredictionForm::Masks), ("no_ids", PredictionForm::Unlinked)]
    {
        let expected = &authors[name];
        let dataset = over_videos(
            root,
            expected,
            |frames| score(frames, form, settings(Protocol::Paper, Void::Counted)),
            |score, expected, video| check(score.counts(), &score.scores(), expected, &format!("{name}, {video}")),
        );
        if expected.get("AQ").is_some() {
            check(dataset.counts(), &dataset.total(), expected, name);
        }
    }
}

fn check_strict_stq(root: &Path) {
    let expected = json(root.join("stq/expected.json"));
    let check = |counts: &RawCounts, scores: &Scores, expected: &Value, what: &str| {
        for (found, key) in [(scores.aq, "AQ"), (scores.sq, "SQ"), (scores.stq, "STQ")] {
            assert_percent(found, &expected["float64"][key], DOUBLE, &format!("{what}: {key}"));
            assert_percent(found, &expected[key], SINGLE, &format!("{what}: deeplab2's {key}"));
        }
        let stq = &counts.stq;
        let union = stq.labelled_predicted + stq.labelled_missed + stq.unlabelled_predicted;
        assert_eq!(Some(stq.tracks), expected["gt_tracks"].as_u64(), "{what}");
        assert_eq!(Some(stq.labelled_predicted), expected["float64"]["intersection"].as_u64(), "{what}");
        assert_eq!(Some(union), expected["float64"]["union"].as_u64(), "{what}");
    };
    let sections =
        [("void_counted", Void::Counted), ("void_excluded", Void::Excluded), ("extra_void_counted", Void::Counted)];
    for (name, void) in sections {
        let Some(expected) = expected.get(name) else { continue };
        for form in [PredictionForm::Ids, PredictionForm::Masks] {
            let dataset = over_videos(
                root,
                expected,
                |frames| score(frames, form, settings(Protocol::Strict, void)),
                |score, expected, video| check(score.counts(), &score.scores(), expected, &format!("{name}, {video}")),
            );
            if expected.get("AQ").is_some() {
                check(dataset.counts(), &dataset.total(), expected, name);
            }
        }
    }
}

#[test]
fn strict_vsq() {
    check_strict_vsq(&data());
}

#[test]
fn paper_vsq() {
    check_paper_vsq(&data());
}

#[test]
fn paper_stq() {
    check_paper_stq(&data());
}

#[test]
fn strict_stq() {
    check_strict_stq(&data());
}

fn map_of_nested(rows: &Value) -> SegmentMap {
    let rows: Vec<Vec<u32>> = serde_json::from_value(rows.clone()).unwrap();
    SegmentMap::from_pixels(rows[0].len(), rows.len(), rows.concat()).unwrap()
}

#[test]
fn deeplab2_unit_vectors() {
    let file = json(data().join("stq/unit_vectors.json"));
    let vectors = file["vectors"].as_array().unwrap();
    assert_eq!(vectors.len(), 13);
    for vector in vectors {
        let name = vector["name"].as_str().unwrap();
        let frames: Vec<LabelledFrame> = vector["gt"]
            .as_array()
            .unwrap()
            .iter()
            .zip(vector["pred"].as_array().unwrap())
            .map(|(truth, prediction)| LabelledFrame {
                truth: map_of_nested(truth),
                prediction: map_of_nested(prediction),
            })
            .collect();
        let by_void = [(Void::Counted, vector), (Void::Excluded, &vector["void_excluded"])];
        for (void, expected) in by_void.into_iter().filter(|(_, expected)| !expected.is_null()) {
            let scores = score(&frames, PredictionForm::Ids, settings(Protocol::Strict, void)).scores();
            for (found, key) in [(scores.aq, "AQ"), (scores.sq, "SQ"), (scores.stq, "STQ")] {
                assert_percent(found, &expected[key], SINGLE, &format!("{name}, {void:?}: {key}"));
            }
        }
    }
}

#[test]
fn matching_comes_before_the_threshold() {
    let case = &json(data().join("vsq/expected.json"))["matching_order_case"];
    let map = |key: &str| {
        let runs: Vec<(u32, usize)> = serde_json::from_value(case[key].clone()).unwrap();
        let ids: Vec<u32> = runs.into_iter().flat_map(|(id, length)| vec![id; length]).collect();
        SegmentMap::from_pixels(ids.len(), 1, ids).unwrap()
    };
    let frames = [LabelledFrame { truth: map("gt_runs_id_length"), prediction: map("pred_runs_id_length") }];
    let score = score(&frames, PredictionForm::Ids, settings(Protocol::Strict, Void::Counted));
    let counts = &score.counts().vsq_k[&WindowLength::One];
    let expected = &case["iou_gt_0.5"];
    for (name, count) in [("tp", counts.true_positives), ("fp", counts.false_positives), ("fn", counts.false_negatives)]
    {
        assert_eq!(Some(count), expected[name].as_u64(), "{name}");
    }
    assert_percent(score.scores().vsq, &expected["VSQ"], DOUBLE, "VSQ");
}

#[test]
fn scores_are_json_with_the_documented_keys() {
    let frames = read_video(&data().join("stq/v5_hard"));
    let scores = score(&frames, PredictionForm::Ids, settings(Protocol::Strict, Void::Counted)).scores();
    let value = serde_json::to_value(&scores).unwrap();
    let keys = |value: &Value| value.as_object().unwrap().keys().cloned().collect::<BTreeSet<String>>();
    assert_eq!(
        keys(&value),
        ["aq", "by_size", "overcounted_tracks", "single_frames", "sq", "stq", "vsq", "vsq_k"].map(String::from).into()
    );
    assert_eq!(keys(&value["vsq_k"]), ["1", "5", "10", "15"].map(String::from).into());
    assert_eq!(keys(&value["by_size"]), ["large", "medium", "small"].map(String::from).into());
    let of_size = ["aq", "found", "ids_per_object", "main_id", "objects"];
    assert_eq!(keys(&value["by_size"]["small"]), of_size.map(String::from).into());
    assert_eq!(serde_json::from_value::<Scores>(value).unwrap(), scores);
    let settings = serde_json::to_string(&settings(Protocol::Paper, Void::Excluded)).unwrap();
    assert_eq!(settings, r#"{"protocol":"paper","void":"excluded","min_ground_truth_area":0.0}"#);
}

#[test]
fn unusable_input_is_named_and_not_counted() {
    use splatseg_geometry::Mask;
    let map = |width, height| SegmentMap::filled(width, height, 3);
    let mut scorer = VideoScorer::new(ScoreSettings::default());
    let mut push = |truth: &SegmentMap, prediction: FramePrediction| scorer.push(truth, &prediction);
    push(&map(4, 3), FramePrediction::Ids(&map(4, 3))).unwrap();
    let error = push(&map(4, 3), FramePrediction::Ids(&map(3, 4))).unwrap_err();
    assert_eq!(error, MetricsError::PredictionSize { frame: 1, found: (3, 4), expected: (4, 3) });
    assert_eq!(error.to_string(), "frame 1: the prediction is 3x4 but the ground truth is 4x3");
    let error = push(&map(5, 3), FramePrediction::Ids(&map(5, 3))).unwrap_err();
    assert_eq!(error, MetricsError::SizeChanged { frame: 1, found: (5, 3), expected: (4, 3) });
    let mask = Mask::empty(4, 3);
    let error = push(&map(4, 3), FramePrediction::Unlinked(std::slice::from_ref(&mask))).unwrap_err();
    assert_eq!(error, MetricsError::MixedPredictions { frame: 1 });
    let error = push(&map(4, 3), FramePrediction::Masks(&[(1, mask.clone()), (1, mask.clone())])).unwrap_err();
    assert_eq!(error, MetricsError::RepeatedId { frame: 1, id: 1 });
    let error = push(&map(4, 3), FramePrediction::Masks(&[(0, mask)])).unwrap_err();
    assert_eq!(error, MetricsError::MaskWithoutId { frame: 1 });
    let error = push(&map(4, 3), FramePrediction::Masks(&[(1, Mask::empty(4, 4))])).unwrap_err();
    assert_eq!(error, MetricsError::PredictionSize { frame: 1, found: (4, 4), expected: (4, 3) });
    assert_eq!(scorer.frames(), 1);
    let paper = scorer.finish();
    let mut dataset = DatasetScore::new(settings(Protocol::Strict, Void::Counted));
    assert!(matches!(dataset.add(&paper), Err(MetricsError::SettingsDiffer { .. })));
    assert_eq!((dataset.videos(), dataset.counts().frames), (0, 0));
}
