//! `--segmenter fastsam`, and segmenting one frame ahead.

use crate::support::{Ended, FASTSAM_WEIGHTS, FEATURES, OTHER_ROOM, finish, splatseg};
use std::collections::BTreeMap;
use std::path::Path;

fn run(scene: &str, out: &Path, more: &[&str]) -> Ended {
    let mut command = splatseg();
    finish(command.arg("run").arg(scene).arg("--out").arg(out).args(more))
}

/// Returns the id images of a run, by name.
fn segments(out: &Path) -> BTreeMap<String, Vec<u8>> {
    let entries = std::fs::read_dir(out.join("segments")).unwrap().map(Result::unwrap);
    entries.map(|entry| (entry.file_name().into_string().unwrap(), std::fs::read(entry.path()).unwrap())).collect()
}

/// Asserts that results are the same with and without segmenting ahead, and with one thread and three.
fn assert_same_results(scene: &str, more: &[&str]) {
    let folder = tempfile::tempdir().unwrap();
    let variants = [["segment_ahead=true", "3"], ["segment_ahead=false", "3"], ["segment_ahead=true", "1"]];
    let results = variants.map(|[ahead, threads]| {
        let out = folder.path().join(format!("{ahead}-{threads}"));
        let ended = run(scene, &out, &[more, &["--set", ahead, "--threads", threads]].concat());
        assert_eq!(ended.code, 0, "{}", ended.err);
        segments(&out)
    });
    assert!(!results[0].is_empty());
    assert!(results[0] == results[1] && results[0] == results[2]);
}

#[test]
fn segmenting_ahead_changes_no_result() {
    assert_same_results(OTHER_ROOM, &[]);
    assert_same_results(OTHER_ROOM, &FEATURES);
}

#[test]
fn fastsam_runs_on_its_weights_and_segmenting_ahead_changes_no_result() {
    let options = ["--segmenter", "fastsam", "--weights", FASTSAM_WEIGHTS, "--max-frames", "3"];
    let size = ["--set", "fastsam.image_size=320"];
    assert_same_results("synthetic:frames=3,width=160,height=120,objects=8", &[options.as_slice(), &size].concat());
}

#[test]
fn bad_inputs_of_fastsam_are_one_line_errors() {
    let folder = tempfile::tempdir().unwrap();
    let no_model = folder.path().join("no_model.pt");
    std::fs::write(&no_model, "nothing").unwrap();
    let no_model = no_model.to_str().unwrap();
    for (options, expected) in [
        (vec![], "--weights FastSAM-x.pt"),
        (vec!["--weights", no_model], "no_model.pt"),
        (vec!["--weights", "/nowhere/FastSAM-x.pt"], "/nowhere/FastSAM-x.pt"),
        (vec!["--weights", no_model, "--set", "fastsam.image_size=1000"], "fastsam.image_size is 1000"),
        (vec!["--weights", no_model, "--set", "fastsam.iou=2"], "fastsam.iou is 2"),
        #[cfg(not(feature = "cuda"))]
        (vec!["--weights", no_model, "--device", "cuda"], "build it with --features cuda"),
    ] {
        let ended = run(OTHER_ROOM, &folder.path().join("out"), &[&["--segmenter", "fastsam"], &options[..]].concat());
        assert_eq!((ended.code, ended.err.lines().count()), (2, 1), "{options:?}: {}", ended.err);
        assert!(ended.err.contains(expected), "{options:?}: {}", ended.err);
    }
}
