//! The purpose of splatseg: on small noisy rooms, a method with a memory beats the same method without one by at least
//! the paper's margin.

use crate::support::{FEATURES, finish, read_json, splatseg};
use serde_json::Value;

/// Rooms long enough for objects to leave the image and return. No choice was based on these seeds.
const ROOMS: [&str; 4] = [
    "synthetic:frames=40,width=96,height=72,objects=10,noise=kinect,seed=41",
    "synthetic:frames=40,width=96,height=72,objects=10,noise=kinect,seed=42",
    "synthetic:frames=40,width=96,height=72,objects=10,noise=kinect,seed=43",
    "synthetic:frames=40,width=96,height=72,objects=10,noise=kinect,seed=44",
];

/// Runs a method without memory and its counterpart with one in the rooms.
fn results(methods: [&str; 2], more: &[&str]) -> Vec<Value> {
    let folder = tempfile::tempdir().unwrap();
    let mut command = splatseg();
    command.arg("bench").arg("--scenes").args(ROOMS).arg("--out").arg(folder.path().join("bench"));
    command.args(["--methods", &methods.join(","), "--protocol", "paper", "--segmenter", "oracle"]);
    command.args(["--set", "oracle.preset=fastsam-like", "--set", "oracle.min_area_px=10"]);
    let ended = finish(command.args(more));
    assert_eq!(ended.code, 0, "{}", ended.err);
    let Value::Array(rows) = read_json(&folder.path().join("bench/results.json")) else { panic!("no list") };
    rows
}

/// Returns the mean of a score over the rooms, percent, in the protocol of the benchmark or in `strict`.
fn mean(rows: &[Value], method: &str, protocol: &str, score: &str) -> f64 {
    let of_method = rows.iter().filter(|row| row["method"] == method);
    let of_protocol =
        |row: &Value| if protocol == "strict" { row["strict"][score].as_f64() } else { row[score].as_f64() };
    of_method.map(|row| of_protocol(row).unwrap()).sum::<f64>() / ROOMS.len() as f64
}

/// Asserts that the memory gains at least these points of VSQ and STQ, in both protocols.
fn assert_gains(methods: [&str; 2], at_least: [f64; 2], more: &[&str]) {
    let rows = results(methods, more);
    for protocol in ["paper", "strict"] {
        for (score, at_least) in ["vsq", "stq"].into_iter().zip(at_least) {
            let [without, with] = methods.map(|method| mean(&rows, method, protocol, score));
            let message = format!("{protocol}: {score} {without:.1} without memory, {with:.1} with it");
            println!("{message}");
            assert!(with - without >= at_least, "{message}: less than {at_least} more");
        }
    }
}

/// The paper's gains over FastSAM on ScanNet-MV.
const OVER_FASTSAM: [f64; 2] = [5.82, 10.22];
/// The paper's gains over SAM 2 with detections on ScanNet-MV.
const OVER_SAM2: [f64; 2] = [2.73, 1.58];

#[test]
fn evidence_beats_the_segmenter_alone() {
    assert_gains(["fastsam", "fastsam-splat"], OVER_FASTSAM, &[]);
}

#[test]
fn features_beat_the_segmenter_alone() {
    assert_gains(["fastsam", "fastsam-splat"], OVER_FASTSAM, &FEATURES);
}

#[test]
fn evidence_beats_the_tracker_alone() {
    assert_gains(["sam2", "sam2-splat"], OVER_SAM2, &["--tracker", "sim"]);
}

#[test]
fn features_beat_the_tracker_alone() {
    let more: Vec<&str> = FEATURES.into_iter().chain(["--tracker", "sim"]).collect();
    assert_gains(["sam2", "sam2-splat"], OVER_SAM2, &more);
}
