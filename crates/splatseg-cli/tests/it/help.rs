//! The help of the command, its completions and its manual pages.

use crate::support::{finish, splatseg};
use std::fs;
use std::process::Command;

/// Lines of a terminal of a usual size, less one for the prompt.
const SCREEN: usize = 49;

fn printed(arguments: &[&str]) -> String {
    let ended = finish(splatseg().args(arguments));
    assert_eq!(ended.code, 0, "{arguments:?}: {}", ended.err);
    ended.out
}

#[test]
fn the_short_help_of_run_fits_on_a_screen_and_the_long_one_has_groups() {
    let short = printed(&["run", "-h"]);
    assert!(short.lines().count() <= SCREEN, "{} lines:\n{short}", short.lines().count());
    for option in ["--out", "--open", "--stride", "--segmenter", "--set", "--quiet", "splatseg run --help"] {
        assert!(short.contains(option), "{option}\n{short}");
    }
    assert!(!short.contains("--quaternion-order"), "{short}");
    let long = printed(&["run", "--help"]);
    let places = ["Results:", "Reading the scene:", "Camera and topics:", "Method:", "Settings:", "Machine:"];
    for heading in places {
        assert!(long.lines().any(|line| line == heading), "{heading}\n{long}");
    }
    for option in ["--quaternion-order", "--save-every", "--memory-limit", "--strict-input"] {
        assert!(long.contains(option), "{option}");
    }
}

#[test]
fn shells_complete_commands_options_and_values() {
    for shell in ["bash", "zsh", "fish"] {
        let script = printed(&["completions", shell]);
        for word in ["inspect", "--segmenter", "affinity", "--register-depth"] {
            let word = if shell == "fish" { word.trim_start_matches('-') } else { word };
            assert!(script.contains(word), "{shell}: {word}");
        }
        assert!(!script.contains("\\u{"), "{shell}: nothing is escaped");
    }
    let folder = tempfile::tempdir().unwrap();
    let script = folder.path().join("splatseg.bash");
    fs::write(&script, printed(&["completions", "bash"])).unwrap();
    let complete = format!(
        "source {}; COMP_WORDS=(splatseg run --segm); COMP_CWORD=2; _splatseg splatseg --segm run; echo ${{COMPREPLY[@]}}",
        script.display()
    );
    match Command::new("bash").args(["--norc", "-c", &complete]).output() {
        Ok(output) => assert_eq!(String::from_utf8_lossy(&output.stdout).trim(), "--segmenter"),
        Err(error) => println!("skipped: bash cannot be run: {error}"),
    }
    let ended = finish(splatseg().args(["completions", "klingon"]));
    assert_eq!(ended.code, 2, "{}", ended.err);
}

#[test]
fn every_command_has_a_manual_page() {
    let folder = tempfile::tempdir().unwrap();
    let pages = folder.path().join("man1");
    assert_eq!(finish(splatseg().arg("man").arg(&pages)).code, 0);
    for name in ["splatseg.1", "splatseg-run.1", "splatseg-find.1"] {
        let page = fs::read_to_string(pages.join(name)).unwrap();
        assert!(page.contains(".TH"), "{name}: {page}");
    }
    let run = fs::read_to_string(pages.join("splatseg-run.1")).unwrap();
    assert!(run.contains("quaternion") && run.contains("CAMERA AND TOPICS"), "{run}");
    assert!(!pages.join("splatseg-batch-worker.1").exists(), "it is not for users");
}
