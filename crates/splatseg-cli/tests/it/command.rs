//! The command as users see it: results, exit codes, and a one-line error for each kind of bad input.

use crate::support::{CLIP_PARTS, file_names, result_files, splatseg};
use assert_cmd::Command;
use splatseg_dataset::Scene;
use splatseg_test_scenes::{copy_demo_clip, demo_clip, room};
use std::fs;
use std::path::Path;

const ROOM: &str = "synthetic:frames=4,width=96,height=72,objects=8";

/// The paper's memory, with a small codebook for speed.
const FEATURES: [&str; 4] = ["--set", "memory.kind=features", "--set", "memory.num_codes=64"];

/// Copies the first frames of the demo's scene, for tests that damage them.
fn copied_scene(frames: usize) -> tempfile::TempDir {
    let copy = tempfile::tempdir().unwrap();
    copy_demo_clip(&CLIP_PARTS, frames, copy.path());
    copy
}

fn run(scene: &Path, out: &Path) -> Command {
    let mut command = splatseg();
    command.arg("run").arg(scene).arg("--out").arg(out).args(["--resize", "160x120"]);
    command
}

/// Runs a command; returns its exit code and standard error.
fn finish(command: &mut Command) -> (i32, String) {
    let output = command.output().unwrap();
    (output.status.code().unwrap(), String::from_utf8(output.stderr).unwrap())
}

fn summary(out: &Path) -> serde_json::Value {
    serde_json::from_str(&fs::read_to_string(out.join("summary.json")).unwrap()).unwrap()
}

#[test]
fn a_run_writes_ids_overlays_and_a_summary() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    splatseg().args(["run", ROOM, "--out"]).arg(&out).args(["--seed", "3"]).assert().success();
    assert_eq!(file_names(&out), result_files(&[]));
    assert_eq!(file_names(&out.join("segments")).len(), 4);
    assert_eq!(file_names(&out.join("overlay")).len(), 4);
    let summary = summary(&out);
    assert_eq!(summary["frames"], 4);
    assert_eq!(summary["skipped_frames"], 0);
    assert_eq!(summary["seed"], 3);
    assert_eq!(summary["settings"]["memory"]["kind"], "evidence");
    assert!(summary["segments"].as_u64().unwrap() > 5);
    let gaussians = summary["gaussians"].as_u64().unwrap();
    // One per block of at most 8x8 pixels, not one per pixel.
    assert!((96 * 72 / 64..96 * 72).contains(&gaussians), "{gaussians}");
    // 7 numbers for position, radius and colour, 8 for votes.
    assert_eq!(summary["parameters"], gaussians * 15);
    let stages = ["segment", "project_and_bin", "rasterise", "decode", "match", "fuse", "grow", "learn"];
    for stage in stages {
        assert!(summary["stage_ms"][stage].as_f64().unwrap() >= 0.0, "{stage}");
    }
    assert!(summary["fps"]["total"].as_f64().unwrap() > 0.0);
    assert!(summary["fps"]["without_segmenter"].as_f64().unwrap() > 0.0);
}

#[test]
fn a_run_with_the_papers_memory_has_a_gaussian_for_every_pixel() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    splatseg().args(["run", ROOM, "--out"]).arg(&out).args(FEATURES).assert().success();
    let summary = summary(&out);
    assert_eq!(summary["settings"]["memory"]["kind"], "features");
    assert_eq!(summary["settings"]["memory"]["feature_dim"], 28);
    assert!(summary["segments"].as_u64().unwrap() > 5);
    let gaussians = summary["gaussians"].as_u64().unwrap();
    assert!(gaussians >= 96 * 72);
    assert_eq!(summary["parameters"], gaussians * (7 + 28));
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    let folder = tempfile::tempdir().unwrap();
    let result = |kind: &[&str], threads: &str| {
        let out = folder.path().join(format!("{threads}-{}", kind.len()));
        let memory = out.with_extension("ply");
        let mut command = run(&demo_clip(), &out);
        command.args(["--max-frames", "3", "--threads", threads]).args(kind);
        command.arg("--save-memory").arg(&memory).assert().success();
        let segments = file_names(&out.join("segments"));
        let images: Vec<Vec<u8>> =
            segments.iter().map(|name| fs::read(out.join("segments").join(name)).unwrap()).collect();
        (segments, images, fs::read(memory).unwrap())
    };
    for kind in [&[], &FEATURES[..]] {
        assert!(result(kind, "1") == result(kind, "3"), "{kind:?}");
    }
}

/// Saves a memory after two frames. Asserts that a second run on these frames, with that memory, keeps the ids.
fn assert_memory_continues(folder: &Path, kind: &[&str]) {
    let memory = folder.join("memory.ply");
    let (first, second) = (folder.join("first"), folder.join("second"));
    let run_two_frames = |out: &Path, with_memory: &str| {
        let mut command = run(&demo_clip(), out);
        command.args(kind).args(["--max-frames", "2", with_memory]).arg(&memory).assert().success();
    };
    run_two_frames(&first, "--save-memory");
    run_two_frames(&second, "--load-memory");
    let read = |out: &Path| splatseg_dataset::read_segments_png(&out.join("segments/000001.png")).unwrap();
    let (before, after) = (read(&first), read(&second));
    let same = before.pixels().iter().zip(after.pixels()).filter(|(before, after)| before == after).count();
    assert!(same * 10 > before.pixels().len() * 9, "only {same} of {} pixels keep their id", before.pixels().len());
}

/// Asserts that loading a memory fails with the expected error.
fn assert_not_loaded(folder: &Path, options: &[&str], expected: &str) {
    let (memory, out) = (folder.join("memory.ply"), folder.join("refused"));
    let (code, message) = finish(run(&demo_clip(), &out).args(options).arg("--load-memory").arg(&memory));
    assert_eq!(code, 2, "{message}");
    assert!(message.contains(expected) && !out.exists(), "{message}");
}

#[test]
fn a_saved_memory_continues_with_its_ids() {
    let folder = tempfile::tempdir().unwrap();
    assert_memory_continues(folder.path(), &[]);
    let other_kind = "memory.kind is \"features\", but the memory in ";
    assert_not_loaded(folder.path(), &FEATURES, other_kind);
    fs::write(folder.path().join("memory.ply"), b"ply\nnonsense").unwrap();
    assert_not_loaded(folder.path(), &[], "memory.ply");
}

#[test]
fn a_saved_memory_of_features_continues_with_its_ids() {
    let folder = tempfile::tempdir().unwrap();
    assert_memory_continues(folder.path(), &FEATURES);
    let other_kind = ["--set", "memory.kind=evidence"];
    assert_not_loaded(folder.path(), &other_kind, "memory.kind is \"evidence\", but the memory in ");
    let fewer = [&FEATURES[..], &["--set", "memory.feature_dim=7"]].concat();
    assert_not_loaded(folder.path(), &fewer, "memory.ply has 28: leave the setting out");
}

#[test]
fn masks_of_another_model_get_lasting_ids() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let masks = demo_clip().join("instance-filt");
    let mut command = run(&demo_clip(), &out);
    command.args(["--crop-border", "5", "--max-frames", "3", "--segmenter", "masks", "--masks"]).arg(masks);
    command.assert().success();
    assert_eq!(summary(&out)["frames"], 3);
    let (code, message) = finish(run(&demo_clip(), &folder.path().join("none")).args(["--segmenter", "masks"]));
    assert_eq!(code, 2);
    assert!(message.contains("--masks DIR"), "{message}");
}

#[test]
fn bad_frames_are_skipped_and_counted() {
    let scene = copied_scene(6);
    fs::write(scene.path().join("color/1.jpg"), b"no image").unwrap();
    fs::write(scene.path().join("pose/2.txt"), "-inf ".repeat(16)).unwrap();
    fs::remove_file(scene.path().join("depth/3.png")).unwrap();
    fs::write(scene.path().join("pose/4.txt"), "2 0 0 0 0 2 0 0 0 0 2 0 0 0 0 1").unwrap();
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let (code, messages) = finish(run(scene.path(), &out).args(["--poses", "given"]));
    assert_eq!(code, 0, "{messages}");
    for named in ["color/1.jpg", "frame 2 has no pose", "depth/3.png", "pose/4.txt"] {
        assert!(messages.lines().any(|line| line.starts_with("warning:") && line.contains(named)), "{messages}");
    }
    assert_eq!(file_names(&out.join("segments")), ["000000.png", "000005.png"]);
    assert_eq!((summary(&out)["frames"].clone(), summary(&out)["skipped_frames"].clone()), (2.into(), 4.into()));
}

#[test]
fn bad_scenes_are_one_line_errors_with_exit_code_2() {
    let empty = tempfile::tempdir().unwrap();
    let unknown = tempfile::tempdir().unwrap();
    fs::write(unknown.path().join("notes.txt"), "hello").unwrap();
    let no_intrinsics = copied_scene(2);
    fs::remove_dir_all(no_intrinsics.path().join("intrinsic")).unwrap();
    let all_bad = copied_scene(2);
    for frame in 0..2 {
        fs::write(all_bad.path().join(format!("depth/{frame}.png")), b"no image").unwrap();
    }
    let cases = [
        (Path::new("/nowhere/at/all"), "does not exist"),
        (empty.path(), "empty"),
        (unknown.path(), "7scenes"),
        (no_intrinsics.path(), "intrinsic"),
        (all_bad.path(), "depth/"),
    ];
    for (scene, expected) in cases {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("out");
        let (code, message) = finish(&mut run(scene, &out));
        assert_eq!(code, 2, "{}: {message}", scene.display());
        assert!(message.contains(expected), "{}: {message}", scene.display());
        assert!(!message.contains("panicked"), "{message}");
        assert!(!out.join("summary.json").exists(), "{}", scene.display());
    }
}

#[test]
fn one_frame_and_frames_without_depth_are_enough() {
    let scene = copied_scene(3);
    let room = room("synthetic:frames=1");
    let empty_depth = splatseg_geometry::SegmentMap::filled(320, 240, 0);
    assert_eq!(room.frame_count(), 1);
    splatseg_annotations::write_segments_png(&scene.path().join("depth/1.png"), &empty_depth).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let out = |name: &str| folder.path().join(name);
    run(scene.path(), &out("out")).assert().success();
    assert_eq!(summary(&out("out"))["frames"], 3);
    run(scene.path(), &out("one")).args(["--max-frames", "1"]).assert().success();
    // No segment is large enough in any frame.
    run(scene.path(), &out("none")).args(["--set", "min_area=100000"]).assert().success();
    assert_eq!(summary(&out("none"))["segments"], 0);
    // More objects than codes: a block of codes is added.
    let few = ["--set", "memory.kind=features", "--set", "memory.num_codes=2"];
    run(scene.path(), &out("few")).args(few).assert().success();
    assert!(summary(&out("few"))["segments"].as_u64().unwrap() > 4);
}

#[test]
fn results_are_not_overwritten_unless_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    run(&demo_clip(), &out).args(["--max-frames", "3"]).assert().success();
    let before = fs::read(out.join("summary.json")).unwrap();
    let (code, message) = finish(run(&demo_clip(), &out).args(["--max-frames", "1"]));
    assert_eq!(code, 2);
    assert!(message.contains("--overwrite"), "{message}");
    assert_eq!(fs::read(out.join("summary.json")).unwrap(), before);
    run(&demo_clip(), &out).args(["--max-frames", "1", "--overwrite"]).assert().success();
    assert_eq!(file_names(&out.join("segments")), ["000000.png"]);
    let map = folder.path().join("map.ply");
    fs::write(&map, "ply\n").unwrap();
    for more in [&[][..], &["--overwrite"]] {
        let (code, message) = finish(run(&demo_clip(), &map).args(more));
        assert!(code == 2 && message.contains("map.ply: is a file, expected a folder"), "{message}");
    }
}

#[test]
fn bad_usage_exits_with_2_and_names_the_option() {
    let folder = tempfile::tempdir().unwrap();
    let config = folder.path().join("settings.toml");
    fs::write(&config, "[memory]\nfeature_dim = \"many\"\n").unwrap();
    let config = config.to_str().unwrap();
    let cases: [(&[&str], &str); 13] = [
        (&["--stride", "0"], "stride"),
        (&["--resize", "big"], "resize"),
        (&["--crop-border", "400"], "crop_border"),
        (&["--format", "avi"], "7scenes"),
        (&["--set", "memory.feature_dims=3"], "feature_dims"),
        (&["--set", "memory.feature_dim=0"], "memory.feature_dim"),
        (&["--set", "memory.kind=votes"], "kind"),
        (&["--set", "memory.max_votes=0"], "memory.max_votes"),
        (&["--set", "memory.max_gaussians=0"], "memory.max_gaussians"),
        (&["--set", "min_new_fraction=2"], "min_new_fraction"),
        (&["--set", "min_match_f_score=2"], "min_match_f_score"),
        (&["--config", config], "feature_dim"),
        (&["--start", "99"], "start"),
    ];
    for (options, expected) in cases {
        let out = folder.path().join("out");
        let mut command = splatseg();
        command.args(["run", ROOM, "--out"]).arg(&out).args(options);
        let (code, message) = finish(&mut command);
        assert_eq!(code, 2, "{options:?}: {message}");
        assert!(message.contains(expected), "{options:?}: {message}");
        assert!(!out.exists(), "{options:?} left {}", out.display());
    }
}

#[test]
fn a_system_that_allows_too_little_is_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let (out, map) = (folder.path().join("out"), folder.path().join("map.ply"));
    let (out, map) = (out.to_str().unwrap(), map.to_str().unwrap());
    let room = "synthetic:frames=2,width=32,height=24,objects=2";
    assert_eq!(finish(splatseg().args(["run", room, "--out", out, "--save-memory", map])).0, 0);
    for (name, value, expected) in [
        ("RAYON_NUM_THREADS", "100000", "RAYON_NUM_THREADS is \"100000\", expected a number from 0 to 512"),
        ("RAYON_NUM_THREADS", "many", "RAYON_NUM_THREADS is \"many\", expected"),
        ("SPLATSEG_INSTRUCTIONS", "sse9", "SPLATSEG_INSTRUCTIONS is \"sse9\", expected one that this machine supports"),
    ] {
        for command in [&["run", room, "--overwrite", "--out", out][..], &["diff", map, map], &["settings"]] {
            let (code, text) = finish(splatseg().env(name, value).args(command));
            assert_eq!((code, text.lines().count()), (2, 1), "{command:?}: {text}");
            assert!(text.contains(expected), "{text}");
        }
    }
    let (code, text) = finish(splatseg().env("RAYON_NUM_THREADS", "2").args(["diff", map, map]));
    assert!(code == 2 && text.contains("has no keyframes besides"), "{text}");
}

#[cfg(target_os = "linux")]
#[test]
fn too_little_address_space_is_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let mut shell = Command::new("bash");
    shell.args(["-c", "ulimit -v 2000000; exec \"$@\"", "bash"]).arg(assert_cmd::cargo::cargo_bin!("splatseg"));
    let (code, text) = finish(shell.args(["run", "synthetic:frames=2", "--threads", "512", "--out"]).arg(&out));
    assert_eq!((code, text.lines().count()), (1, 1), "{text}");
    assert!(text.contains("limited to 2.0 GB (ulimit -v), but 512 threads need 4.2 GB and more"), "{text}");
    assert!(!out.exists());
}

#[test]
fn the_demo_needs_no_input() {
    let folder = tempfile::tempdir().unwrap();
    let mut command = splatseg();
    command.args(["demo", "--frames", "3", "--out", "here"]).current_dir(folder.path());
    let output = command.output().unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(text.contains("3 frames, ") && text.contains("overlay"), "{text}");
    assert_eq!(file_names(&folder.path().join("here")), result_files(&["memory.ply", "scene"]));
}
