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

/// Warnings of the library look as those of the command.
#[test]
fn warnings_of_the_log_have_the_form_of_all_others() {
    let folder = tempfile::tempdir().unwrap();
    let scene = numbered_scene(folder.path(), 2);
    let camera = ["--fx", "300", "--fy", "300", "--cx", "20", "--cy", "20"];
    let ended = run(&scene, &folder.path().join("out"), &[&camera[..], &["--quiet"]].concat());
    assert_eq!(ended.code, 0, "{}", ended.err);
    assert!(ended.err.lines().any(|line| line.starts_with("warning: dataset.fx, fy, cx and cy: ")), "{}", ended.err);
    assert!(!ended.err.contains("WARN"), "{}", ended.err);
}

#[test]
fn quiet_leaves_warnings_errors_and_results() {
    let folder = tempfile::tempdir().unwrap();
    let scene = numbered_scene(folder.path(), 4);
    fs::write(scene.join("depth/1.png"), b"no image").unwrap();
    let ended = run(&scene, &folder.path().join("out"), &["--quiet"]);
    assert_eq!((ended.code, ended.out.as_str()), (0, ""), "{}", ended.err);
    assert!(
        ended.err.lines().count() > 0 && ended.err.lines().all(|line| line.starts_with("warning: ")),
        "{}",
        ended.err
    );
    let failed = finish(splatseg().args(["-q", "run", "nowhere", "--out", "nothing"]));
    assert_eq!((failed.code, failed.err.lines().count()), (2, 1), "{}", failed.err);
    let inspected = finish(splatseg().arg("inspect").arg(&scene).arg("-q"));
    assert!(inspected.out.contains("frames         4"), "{}", inspected.out);
}

/// Only terminals show colours, unless an option demands them.
#[test]
fn no_color_and_pipes_have_no_colours() {
    let failed = |variables: &[(&str, &str)]| {
        let mut command = splatseg();
        command.env_remove("NO_COLOR").env_remove("CLICOLOR_FORCE").envs(variables.iter().copied());
        finish(command.args(["inspect", "nowhere"])).err
    };
    assert!(failed(&[]).starts_with("error: nowhere"));
    assert!(failed(&[("NO_COLOR", "1")]).starts_with("error: nowhere"));
    let colored = failed(&[("CLICOLOR_FORCE", "1")]);
    assert!(colored.starts_with("\u{1b}[1m\u{1b}[31merror:\u{1b}[0m nowhere"), "{colored:?}");
}

/// A terminal, by the program `script`; `None`, which is reported, if it is missing.
#[cfg(target_os = "linux")]
fn in_terminal(arguments: &str, variables: &[(&str, &str)]) -> Option<String> {
    let mut script = std::process::Command::new("script");
    let program = assert_cmd::cargo::cargo_bin!("splatseg");
    script.args(["-q", "-e", "-c", &format!("{} {arguments}", program.display()), "/dev/null"]);
    script.env_remove("NO_COLOR").env("TERM", "xterm").envs(variables.iter().copied());
    match script.stdin(std::process::Stdio::null()).output() {
        Ok(output) => Some(String::from_utf8_lossy(&output.stdout).replace('\r', "")),
        Err(error) => {
            println!("skipped: script, which makes a terminal, cannot be run: {error}");
            None
        }
    }
}

#[cfg(target_os = "linux")]
#[test]
fn settings_have_no_markdown_in_a_terminal_and_errors_have_colours() {
    let Some(shown) = in_terminal("settings memory", &[]) else { return };
    assert!(shown.contains("memory.max_votes\n  default: 4\n"), "{shown}");
    assert!(!shown.contains('|') && !shown.contains('`'), "{shown}");
    let piped = finish(splatseg().args(["settings", "memory"])).out;
    assert!(piped.starts_with("## memory"), "{piped}");
    let error = in_terminal("inspect nowhere", &[]).unwrap_or_default();
    assert!(error.contains("\u{1b}[31merror:"), "{error:?}");
    let plain = in_terminal("inspect nowhere", &[("NO_COLOR", "1")]).unwrap_or_default();
    assert!(plain.contains("error: nowhere") && !plain.contains('\u{1b}'), "{plain:?}");
}

#[test]
fn settings_are_printed_as_json() {
    let ended = finish(splatseg().args(["settings", "--json"]));
    let settings: Vec<serde_json::Value> = serde_json::from_str(&ended.out).unwrap();
    let votes = settings.iter().find(|setting| setting["key"] == "memory.max_votes").unwrap();
    assert_eq!(votes["default"], "4");
    assert!(votes["help"].as_str().unwrap().contains("votes"), "{votes}");
    let one = finish(splatseg().args(["settings", "memory.max_votes", "--json"]));
    let one: Vec<serde_json::Value> = serde_json::from_str(&one.out).unwrap();
    assert_eq!(one.as_slice(), std::slice::from_ref(votes));
}
