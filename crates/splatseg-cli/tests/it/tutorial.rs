//! The commands of docs/TUTORIAL.md work, one after the other, on recordings of a synthetic room.

use crate::support::splatseg;
use std::env;
use std::ffi::OsString;
use std::fs;
use std::path::Path;
use std::process::Command;

/// The tutorial's commands, in their order.
fn commands() -> Vec<String> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/TUTORIAL.md");
    let text = fs::read_to_string(path).unwrap();
    let blocks = text.split("```sh\n").skip(1).map(|rest| rest.split("```").next().unwrap());
    blocks.flat_map(str::lines).map(str::to_owned).collect()
}

/// `PATH` with the folder of the tested command first.
fn path_to_the_command() -> OsString {
    let program = assert_cmd::cargo::cargo_bin!("splatseg");
    let folders = env::var_os("PATH").unwrap_or_default();
    env::join_paths([program.parent().unwrap().to_owned()].into_iter().chain(env::split_paths(&folders))).unwrap()
}

#[test]
#[cfg(unix)]
fn commands_of_the_tutorial_work() {
    let folder = tempfile::tempdir().unwrap();
    for (day, visit) in [("monday", "before"), ("tuesday", "after")] {
        let scene = format!("synthetic:frames=16,width=96,height=72,visit={visit}");
        let recording = format!("{day}.mcap");
        splatseg().current_dir(&folder).args(["convert", &scene, &recording]).assert().success();
    }
    let commands = commands();
    assert!(commands.len() >= 8, "{commands:?}");
    for command in commands {
        // A phone's recording is replaced with one that can be made here.
        let line = command.replace(".r3d", ".mcap");
        let output = Command::new("sh")
            .args(["-c", &line])
            .current_dir(&folder)
            .env("PATH", path_to_the_command())
            .output()
            .unwrap();
        let (out, err) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
        assert!(output.status.success(), "{line}\n{out}\n{err}");
        if command.contains("find") {
            assert!(out.contains(" m at ("), "{line}: {out}");
        }
    }
    for written in ["monday/index.html", "tuesday/changes.json", "points.ply"] {
        assert!(folder.path().join(written).is_file(), "{written}");
    }
    let objects = fs::read_to_string(folder.path().join("tuesday/objects.csv")).unwrap();
    assert!(objects.contains(",desk,"), "{objects}");
}
