//! Runs on scenes whose poses are given, missing or ignored.

use crate::support::{Ended, finish, read_json, splatseg};
use splatseg_test_scenes::copy_demo_clip;
use std::fs;
use std::path::Path;

const ROOM: &str = "synthetic:frames=12,width=160,height=120,objects=8,speed=0.1";

fn run(scene: &Path, out: &Path, more: &[&str]) -> Ended {
    finish(splatseg().arg("run").arg(scene).arg("--out").arg(out).args(["--no-page"]).args(more))
}

/// Numbers of frames of a run with a given, a tracked and a lost pose.
fn pose_states(out: &Path) -> [u64; 3] {
    let summary = read_json(&out.join("summary.json"));
    ["given", "tracked", "lost"].map(|state| summary["pose_states"][state].as_u64().unwrap())
}

/// Number of poses in a run's `poses.txt`.
fn listed_poses(out: &Path) -> usize {
    let text = fs::read_to_string(out.join("poses.txt")).unwrap();
    text.lines().filter(|line| !line.starts_with('#')).count()
}

#[test]
fn each_source_of_poses_says_what_it_does() {
    let folder = tempfile::tempdir().unwrap();
    let cases = [
        ("auto", [12, 0, 0], "poses: given; frames without one are tracked"),
        ("given", [12, 0, 0], "poses: given; frames without one are skipped"),
        ("track", [0, 12, 0], "poses: the camera is tracked"),
        ("refine", [0, 12, 0], "poses: given, refined by tracking"),
    ];
    for (source, states, message) in cases {
        let out = folder.path().join(source);
        let ended = run(Path::new(ROOM), &out, &["--poses", source]);
        assert_eq!(ended.code, 0, "{}", ended.err);
        assert!(ended.err.contains(message), "{source}: {}", ended.err);
        assert_eq!((pose_states(&out), listed_poses(&out)), (states, 12), "{source}");
        assert_eq!(ended.out.contains("the camera was tracked in 12 frames"), states[1] == 12, "{}", ended.out);
        let residual = &read_json(&out.join("summary.json"))["pose_residual"];
        assert_eq!(residual.is_null(), states[1] == 0, "{source}: {residual}");
    }
    let (given, tracked) = (folder.path().join("given"), folder.path().join("track"));
    let scored =
        finish(splatseg().args(["eval", "--trajectory"]).arg(given.join("poses.txt")).arg("--pred").arg(tracked));
    assert_eq!(scored.code, 0, "{}", scored.err);
    assert!(scored.out.contains("12 pairs"), "{}", scored.out);
}

#[test]
fn a_scene_without_poses_is_tracked_unless_that_is_forbidden() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("scene");
    copy_demo_clip(&["color", "depth", "intrinsic"], usize::MAX, &scene);
    let out = folder.path().join("out");
    let ended = run(&scene, &out, &["--max-frames", "6"]);
    assert_eq!(ended.code, 0, "{}", ended.err);
    assert!(ended.err.contains("poses: none given, the camera is tracked"), "{}", ended.err);
    let [given, tracked, lost] = pose_states(&out);
    assert_eq!((given, tracked + lost, listed_poses(&out) as u64), (0, 6, tracked));
    assert!(tracked > 0);
    let refused = run(&scene, &folder.path().join("none"), &["--max-frames", "6", "--poses", "given"]);
    assert_eq!(refused.code, 2);
    assert!(refused.err.contains("frame 0 has no pose") && refused.err.contains("none of the frames could be used"));
}

#[test]
fn one_source_of_poses_is_chosen() {
    let folder = tempfile::tempdir().unwrap();
    let ended = run(Path::new(ROOM), &folder.path().join("out"), &["--poses", "given,track"]);
    assert_eq!(ended.code, 2);
    assert!(ended.err.contains("--poses: found given,track, expected one source; only bench compares several"));
    let ended = run(Path::new(ROOM), &folder.path().join("out"), &["--poses", "guess"]);
    assert_eq!(ended.code, 2);
}

#[test]
fn a_benchmark_compares_sources_of_poses() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("bench");
    let arguments = ["bench", "--scenes", ROOM, "--methods", "fastsam-splat", "--poses", "given,track", "--out"];
    let ended = finish(splatseg().args(arguments).arg(&out));
    assert_eq!(ended.code, 0, "{}", ended.err);
    let table = fs::read_to_string(out.join("results.csv")).unwrap();
    assert!(table.contains("poses=track") && table.lines().count() >= 3, "{table}");
}

#[test]
fn poses_that_do_not_fit_the_images_are_told_with_the_setting_that_mends_them() {
    let folder = tempfile::tempdir().unwrap();
    let scene = Path::new("synthetic:frames=30,width=160,height=120,objects=8,speed=0.3");
    let wrong = ["--segmenter", "oracle", "--pose-convention", "opengl"];
    let ended = run(scene, &folder.path().join("warned"), &wrong);
    assert_eq!(ended.code, 0, "{}", ended.err);
    let warning = "warning: the given poses do not fit the images, but they do as camera-to-world poses";
    assert!(ended.err.contains(warning), "{}", ended.err);
    assert!(ended.err.contains("dataset.pose_convention = camera-to-world"), "{}", ended.err);
    let doubts_of = |out: &str| read_json(&folder.path().join(out).join("summary.json"))["input_doubts"].clone();
    let doubts = doubts_of("warned");
    let [doubt] = doubts.as_array().unwrap().as_slice() else { panic!("{doubts}") };
    assert!(ended.err.contains(&format!("warning: {}", doubt.as_str().unwrap())), "{doubt}: {}", ended.err);

    let strict = run(scene, &folder.path().join("strict"), &[&wrong[..], &["--strict-input"]].concat());
    assert_eq!(strict.code, 2, "{}", strict.err);
    assert!(strict.err.contains("(strict_input ends the run)"), "{}", strict.err);

    let right = run(scene, &folder.path().join("right"), &["--segmenter", "oracle", "--strict-input"]);
    assert_eq!(right.code, 0, "{}", right.err);
    assert!(doubts_of("right").is_null(), "nothing was conspicuous");
    let refused = run(scene, &folder.path().join("refused"), &["--pose-convention", "left-handed"]);
    assert!(refused.code == 2 && refused.err.contains("--pose-convention"), "{}", refused.err);
}
