//! Output of the command, and its behaviour if it cannot be written.

use crate::support::{Ended, finish, numbered_scene, read_json, splatseg};
use std::fs;
use std::path::Path;

fn run(scene: &Path, out: &Path, more: &[&str]) -> Ended {
    finish(splatseg().arg("run").arg(scene).arg("--out").arg(out).args(["--resize", "96x72"]).args(more))
}

#[cfg(target_os = "linux")]
#[test]
fn output_that_cannot_be_written_is_an_error() {
    let program = assert_cmd::cargo::cargo_bin!("splatseg");
    let to_full_disk = |arguments: &[&str]| {
        let full = || fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
        std::process::Command::new(program).args(arguments).stdout(full()).output().unwrap()
    };
    let arguments: [&[&str]; 4] = [&["settings"], &["--help"], &["--version"], &["help", "run"]];
    for arguments in arguments {
        let output = to_full_disk(arguments);
        let message = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(1), "{arguments:?}: {message}");
        assert_eq!(message.lines().count(), 1, "{message}");
        assert!(message.contains("standard output cannot be written"), "{message}");
    }
}

#[cfg(unix)]
#[test]
fn a_closed_pipe_is_not_an_error_and_a_full_standard_error_does_not_panic() {
    let program = assert_cmd::cargo::cargo_bin!("splatseg");
    let shell = |script: &str| {
        let output = std::process::Command::new("bash").args(["-c", script, "bash"]).arg(program).output().unwrap();
        (String::from_utf8(output.stdout).unwrap(), String::from_utf8(output.stderr).unwrap())
    };
    let (out, err) = shell("\"$1\" settings | head -n 1 >/dev/null; echo ${PIPESTATUS[0]}");
    assert_eq!((out.trim(), err.as_str()), ("0", ""));
    if cfg!(target_os = "linux") {
        assert_eq!(shell("\"$1\" run nowhere --out nothing 2>/dev/full; echo $?").0.trim(), "2");
    }
}

#[cfg(unix)]
#[test]
fn control_characters_in_names_are_escaped() {
    let folder = tempfile::tempdir().unwrap();
    let odd = folder.path().join("\u{1b}[31m\u{9b}2J");
    let scene = numbered_scene(&odd, 2);
    fs::write(scene.join("depth/0.png"), b"no image").unwrap();
    let ended = run(&scene, &folder.path().join("\u{1b}]0;title\u{7}"), &[]);
    assert_eq!(ended.code, 0, "{}", ended.err);
    let ended_badly = run(&odd.join("nothing"), &folder.path().join("out"), &[]);
    assert_eq!(ended_badly.code, 2);
    for text in [&ended.err, &ended.out, &ended_badly.err] {
        assert!(!text.contains(|character: char| character.is_control() && character != '\n'), "{text:?}");
        assert!(text.contains("\\u{1b}"), "{text:?}");
    }
}

#[test]
fn skipped_frames_are_reported_once_per_kind_with_a_count() {
    let folder = tempfile::tempdir().unwrap();
    let scene = numbered_scene(folder.path(), 9);
    (1..6).for_each(|frame| fs::write(scene.join(format!("depth/{frame}.png")), b"no image").unwrap());
    fs::write(scene.join("pose/7.txt"), "-inf ".repeat(16)).unwrap();
    let ended = run(&scene, &folder.path().join("out"), &["--poses", "given"]);
    let warnings: Vec<&str> = ended.err.lines().filter(|line| line.starts_with("warning: ")).collect();
    assert_eq!(warnings.len(), 3, "{}", ended.err);
    assert!(warnings[0].contains("depth/1.png") && warnings[1].contains("frame 7 has no pose"), "{}", ended.err);
    assert!(warnings[2].contains("4 more frames skipped") && warnings[2].contains("depth/1.png"), "{}", ended.err);
    assert_eq!(read_json(&folder.path().join("out/summary.json"))["skipped_frames"], 6);
    assert!(ended.out.starts_with("3 frames (6 skipped), "), "{}", ended.out);
}

#[test]
fn one_frame_is_written_as_one_frame() {
    let folder = tempfile::tempdir().unwrap();
    let scene = numbered_scene(folder.path(), 1);
    let ended = run(&scene, &folder.path().join("out"), &[]);
    assert!(ended.out.starts_with("1 frame, "), "{}", ended.out);
    // Colours and other control sequences are for terminals.
    assert!(!(ended.out + &ended.err).contains('\u{1b}'));
}

#[test]
fn speed_includes_the_time_before_the_first_frame() {
    let folder = tempfile::tempdir().unwrap();
    let scene = numbered_scene(folder.path(), 2);
    let codebook = ["--set", "memory.kind=features", "--set", "memory.num_codes=64", "--threads", "1"];
    let ended = run(&scene, &folder.path().join("out"), &codebook);
    assert_eq!(ended.code, 0, "{}", ended.err);
    let summary = read_json(&folder.path().join("out/summary.json"));
    let start_up = summary["start_up_s"].as_f64().unwrap();
    assert!(start_up > 0.0);
    assert!(summary["fps"]["total"].as_f64().unwrap() <= 2.0 / start_up, "{summary}");
    assert!(ended.out.contains("before the first frame"), "{}", ended.out);
}
