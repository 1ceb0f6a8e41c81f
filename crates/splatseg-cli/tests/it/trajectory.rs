//! Poses of a run, and their comparison with the true ones.

use crate::support::{Ended, finish, read_json, splatseg};
use serde_json::Value;
use std::fs;
use std::path::Path;

const ROOM: &str = "synthetic:frames=24,width=64,height=48,objects=4";

fn eval(truth: &Path, pred: &Path, more: &[&str]) -> Ended {
    finish(splatseg().arg("eval").arg("--trajectory").arg(truth).arg("--pred").arg(pred).args(more))
}

/// Runs a method on every second frame of a room.
fn run(out: &Path) {
    let more = ["--segmenter", "oracle", "--stride", "2", "--no-page"];
    let ended = finish(splatseg().args(["run", ROOM, "--out"]).arg(out).args(more));
    assert_eq!(ended.code, 0, "{}", ended.err);
}

#[test]
fn errors_equal_those_of_evo() {
    let cases = Path::new(env!("CARGO_MANIFEST_DIR")).join("../metrics/tests/data/trajectories.json");
    let cases = read_json(&cases);
    let folder = tempfile::tempdir().unwrap();
    let [truth, estimate, json] = ["truth.txt", "estimate.txt", "scores.json"].map(|name| folder.path().join(name));
    for case in cases.as_array().unwrap() {
        for (path, lines) in [(&truth, &case["truth"]), (&estimate, &case["estimate"])] {
            let lines = lines.as_array().unwrap().iter().map(|line| format!("{}\n", line.as_str().unwrap()));
            fs::write(path, lines.collect::<String>()).unwrap();
        }
        let frames = case["rpe_frames"].to_string();
        let options = ["--rpe-frames", &frames, "--json", json.to_str().unwrap(), "--overwrite"];
        let ended = eval(&truth, &estimate, &options);
        if case["name"] == "no pairs" {
            assert_eq!((ended.code, ended.err.lines().count()), (2, 1), "{}", ended.err);
            assert!(
                ended.err.contains("estimate.txt: none of the 20 estimated poses is within 0.01 s"),
                "{}",
                ended.err
            );
            continue;
        }
        assert_eq!(ended.code, 0, "{}", ended.err);
        let found = read_json(&json);
        for (key, count) in [("ate_m", "pairs"), ("rpe_m", "rpe_motions"), ("rpe_deg", "rpe_motions")] {
            check(&found, &case[key], (key, count));
        }
        for (key, note) in [("ate_m", "no ATE: "), ("rpe_m", "no RPE: ")] {
            assert_eq!(ended.out.contains(note), case[key].is_null(), "{}", ended.out);
        }
    }
}

/// Compares statistics with those of `evo`, which are null where it refuses.
fn check(found: &Value, expected: &Value, (key, count): (&str, &str)) {
    if expected.is_null() {
        assert!(found[key].is_null(), "{found}");
        return;
    }
    assert_eq!(found[count], expected["count"], "{found}");
    for statistic in ["rmse", "mean", "median", "std", "min", "max"] {
        let [found, expected] = [&found[key], expected].map(|statistics| statistics[statistic].as_f64().unwrap());
        assert!((found - expected).abs() < 1e-8 * expected.max(1.0), "{key} {statistic}: {found} {expected}");
    }
}

#[test]
fn a_run_writes_the_poses_of_its_frames() {
    let folder = tempfile::tempdir().unwrap();
    let [out, json] = ["out", "scores.json"].map(|name| folder.path().join(name));
    run(&out);
    let poses = fs::read_to_string(out.join("poses.txt")).unwrap();
    let lines: Vec<&str> = poses.lines().collect();
    assert_eq!((lines.len(), lines[0]), (13, "# timestamp tx ty tz qx qy qz qw"));
    assert!(lines[3].starts_with("0.133333333 "), "{}", lines[3]);
    assert!(fs::read_to_string(out.join("manifest.jsonl")).unwrap().contains("\"poses.txt\""));

    let ended = eval(ROOM.as_ref(), &out, &["--rpe-frames", "5", "--json", json.to_str().unwrap()]);
    assert_eq!(ended.code, 0, "{}", ended.err);
    let found = read_json(&json);
    // The stride is that of the run.
    assert_eq!((&found["pairs"], &found["true_poses"], &found["rpe_motions"]), (&12.into(), &12.into(), &7.into()));
    assert!(found["ate_m"]["max"].as_f64().unwrap() < 1e-6, "{found}");
    assert!(found["rpe_deg"]["max"].as_f64().unwrap() < 1e-4, "{found}");
    assert!(ended.out.contains("12 pairs") && ended.out.contains("RPE over 5 frames, °"), "{}", ended.out);

    let ended = eval(ROOM.as_ref(), &out, &["--stride", "1", "--json", json.to_str().unwrap(), "--overwrite"]);
    assert_eq!(ended.code, 0, "{}", ended.err);
    let found = read_json(&json);
    assert_eq!((&found["pairs"], &found["true_poses"], &found["rpe_m"]), (&12.into(), &24.into(), &Value::Null));
    // The poses of a run may be the truth.
    let ended = eval(&out.join("poses.txt"), &out.join("poses.txt"), &["--rpe-frames", "1"]);
    assert_eq!(ended.code, 0, "{}", ended.err);
}

#[test]
fn bad_input_is_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let [out, empty, damaged, good, binary] =
        ["out", "empty", "damaged.txt", "good.txt", "binary.bin"].map(|name| folder.path().join(name));
    run(&out);
    fs::create_dir(&empty).unwrap();
    fs::write(&good, "0 0 0 0 0 0 0 1\n").unwrap();
    fs::write(&damaged, "0 0 0 0 0 0 0 1\n1 2 3\n").unwrap();
    fs::write(&binary, [0xff, 0xfe, 0x00]).unwrap();
    let other_room = "synthetic:frames=24,width=64,height=48,objects=5";
    let missing = folder.path().join("missing.txt");
    for (truth, pred, message) in [
        (good.as_path(), empty.as_path(), "empty: found no poses.txt, expected the folder of a run"),
        (&good, &damaged, "damaged.txt: line 2: found \"1 2 3\", expected 8 numbers"),
        (&damaged, &good, "damaged.txt: line 2: found"),
        (&good, &missing, "missing.txt"),
        (&missing, &good, "missing.txt"),
        (&binary, &good, "binary.bin"),
        (&empty, &good, "empty"),
        (Path::new(other_room), &out, "if these are the same scene, give --allow-other-scene"),
        (Path::new("synthetic:frames=x"), &good, "frames"),
    ] {
        let ended = eval(truth, pred, &[]);
        assert_eq!((ended.code, ended.err.lines().count()), (2, 1), "{truth:?} {pred:?}: {}", ended.err);
        assert!(ended.err.contains(message), "{truth:?} {pred:?}: {}", ended.err);
    }
    let ended = eval(&good, &good, &["--rpe-frames", "0"]);
    assert_eq!(ended.code, 2, "{}", ended.err);
    let ended = eval(&good, &good, &["--gt", ROOM]);
    assert_eq!(ended.code, 2, "{}", ended.err);
    let ended = finish(splatseg().args(["eval", "--gt", ROOM, "--rpe-frames", "3", "--pred"]).arg(&good));
    assert_eq!(ended.code, 2, "{}", ended.err);
}
