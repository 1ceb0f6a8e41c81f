//! Runs that fail or are stopped after their start keep their results so far, and report them.

#![cfg(unix)]

use crate::support::nearly_full::save_nearly_full_memory;
use crate::support::{
    Ended, file_names, finish, numbered_scene, read_json, result_files, splatseg, stoppable_splatseg,
};
use splatseg_annotations::write_segments_png;
use splatseg_dataset::read_segments_png;
use splatseg_geometry::{MAX_16_BIT_ID, SegmentMap};
use splatseg_test_scenes::without_chunks;
use std::fs;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

const ROOM: &str = "synthetic:frames=4,width=96,height=72,objects=8";
const LONG_ROOM: &str = "synthetic:frames=3000,width=160,height=120";

fn run(scene: &str, out: &Path, more: &[&str]) -> Ended {
    finish(splatseg().args(["run", scene, "--out"]).arg(out).args(more))
}

/// Runs with the size of files limited to `kib` KiB. Larger files fail as on a full disk.
fn run_with_small_files(kib: usize, out: &Path, more: &[&str]) -> Ended {
    let mut shell = assert_cmd::Command::new("bash");
    let program = assert_cmd::cargo::cargo_bin!("splatseg");
    shell.args(["-c", &format!("ulimit -f {kib}; exec \"$@\""), "bash"]).arg(program);
    finish(shell.args(["run", ROOM, "--out"]).arg(out).args(more))
}

#[test]
fn a_place_for_the_memory_is_checked_before_the_first_frame() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let file = folder.path().join("file");
    fs::write(&file, b"no folder").unwrap();
    for place in [file.join("memory.ply"), "/proc/memory.ply".into(), folder.path().to_owned()] {
        // Processing the whole scene would take too long.
        let ended = run(LONG_ROOM, &out, &["--overwrite", "--save-memory", place.to_str().unwrap()]);
        assert_eq!(ended.code, 2, "{}", ended.err);
        assert!(ended.err.contains(place.to_str().unwrap()) && !out.exists(), "{}", ended.err);
    }
    // Folders are created, as for --out.
    let memory = folder.path().join("a/b/memory.ply");
    assert_eq!(run(ROOM, &out, &["--save-memory", memory.to_str().unwrap()]).code, 0);
    assert!(memory.is_file());
}

#[test]
fn only_a_saved_memory_is_replaced_by_one() {
    let folder = tempfile::tempdir().unwrap();
    let (out, memory) = (folder.path().join("out"), folder.path().join("memory.ply"));
    fs::write(&memory, b"notes").unwrap();
    let memory = memory.to_str().unwrap();
    let ended = run(ROOM, &out, &["--overwrite", "--save-memory", memory]);
    assert!(ended.code == 2 && ended.err.contains("not a saved memory"), "{}", ended.err);
    assert_eq!(fs::read(memory).unwrap(), b"notes");
    fs::remove_file(memory).unwrap();
    assert_eq!(run(ROOM, &out, &["--save-memory", memory]).code, 0);
    // With --overwrite, the loaded memory may be saved to the same file.
    let same = ["--load-memory", memory, "--save-memory", memory];
    let ended = run(ROOM, &out, &[&same[..], &["--overwrite"]].concat());
    assert_eq!(ended.code, 0, "{}", ended.err);
    let ended = run(ROOM, &folder.path().join("other"), &same);
    assert!(ended.code == 2 && ended.err.contains("--overwrite"), "{}", ended.err);
    // Other inputs and results are never replaced.
    for place in ["out/summary.json", "out/segments/memory.ply"] {
        let place = folder.path().join(place);
        let ended = run(ROOM, &out, &["--overwrite", "--save-memory", place.to_str().unwrap()]);
        assert!(ended.code == 2 && ended.err.contains("reserved for other results"), "{}", ended.err);
    }
}

#[test]
fn a_memory_that_cannot_be_saved_in_the_end_loses_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let (out, memory) = (folder.path().join("out"), folder.path().join("memory.ply"));
    // Images are smaller than 20 KiB, the memory is not.
    let ended = run_with_small_files(20, &out, &["--save-memory", memory.to_str().unwrap()]);
    assert_eq!(ended.code, 1, "{}", ended.err);
    assert!(ended.err.contains("the memory could not be saved"), "{}", ended.err);
    assert!(!ended.err.contains(".writing-"), "{}", ended.err);
    assert_eq!(file_names(folder.path()), ["out"]);
    let summary = read_json(&out.join("summary.json"));
    assert_eq!((summary["frames"].as_u64(), file_names(&out.join("segments")).len()), (Some(4), 4));
    assert!(summary["error"].as_str().unwrap().contains("memory"), "{summary}");
}

#[test]
fn images_that_cannot_be_written_lose_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let (out, memory) = (folder.path().join("out"), folder.path().join("memory.ply"));
    let scene = numbered_scene(folder.path(), 36);
    let arguments = ["run", scene.to_str().unwrap(), "--out"];
    let mut command = stoppable_splatseg();
    command.args(arguments).arg(&out).arg("--save-memory").arg(&memory).stderr(Stdio::piped());
    let child = command.spawn().unwrap();
    wait_for(&out.join("segments/000000.png"));
    // A file cannot replace a folder.
    fs::create_dir_all(out.join("segments/000030.png/in the way")).unwrap();
    let output = child.wait_with_output().unwrap();
    let message = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{message}");
    assert!(message.contains("images of 1 frame could not be written") && message.contains("000030.png"), "{message}");
    assert_eq!(read_json(&out.join("summary.json"))["frames"], 36);
    assert_eq!((file_names(&out.join("segments")).len(), memory.is_file()), (36, true));
    assert!(file_names(&out.join("segments")).iter().all(|name| name.ends_with(".png")));
}

#[test]
fn a_disk_that_is_full_from_the_start_loses_no_earlier_results() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    assert_eq!(run(ROOM, &out, &[]).code, 0);
    let before = fs::read(out.join("summary.json")).unwrap();
    let ended = run_with_small_files(0, &out, &["--overwrite"]);
    assert!(ended.code != 0, "{}", ended.err);
    assert_eq!(fs::read(out.join("summary.json")).unwrap(), before);
    assert_eq!(file_names(&out.join("segments")).len(), 4);
}

/// Starts a long run, and waits for its first frames.
fn start_long_run(out: &Path) -> Child {
    let mut command = stoppable_splatseg();
    command.args(["run", LONG_ROOM, "--out"]).arg(out).arg("--save-memory").arg(out.join("memory.ply"));
    let child = command.stderr(Stdio::piped()).spawn().unwrap();
    wait_for(&out.join("segments/frame-000002.png"));
    child
}

fn wait_for(file: &Path) {
    let start = Instant::now();
    while !file.exists() {
        std::thread::sleep(Duration::from_millis(5));
        assert!(start.elapsed() < Duration::from_secs(15), "{} does not appear", file.display());
    }
}

fn send(signal: &str, child: &Child) {
    assert!(Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap().success());
}

fn message(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

#[test]
fn every_stop_signal_ends_the_run_in_order() {
    for (signal, code) in [("INT", 130), ("TERM", 143), ("HUP", 129)] {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("out");
        let child = start_long_run(&out);
        send(&format!("-{signal}"), &child);
        let output = child.wait_with_output().unwrap();
        let message = message(&output);
        assert_eq!(output.status.code(), Some(code), "{message}");
        assert!(
            message.contains(&format!("SIG{signal}: stopping after this frame; again to end at once")),
            "{message}"
        );
        assert!(message.contains(&format!("interrupted by SIG{signal} after")), "{message}");
        let summary = read_json(&out.join("summary.json"));
        assert_eq!(summary["interrupted"], true);
        let frames = summary["frames"].as_u64().unwrap() as usize;
        for name in file_names(&out.join("segments")) {
            read_segments_png(&out.join("segments").join(&name)).unwrap();
        }
        let images = ["segments", "overlay"].map(|folder| file_names(&out.join(folder)).len());
        assert_eq!(images, [frames, frames]);
        assert_eq!(file_names(&out), result_files(&["memory.ply"]));
    }
}

#[test]
fn a_second_signal_ends_the_run_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    // This many learning steps take minutes, and the first signal waits for the frame.
    let scene = "synthetic:frames=2,width=960,height=720,noise=none";
    let learning = ["--set", "memory.kind=features", "--set", "memory.num_steps=200", "--threads", "1"];
    let mut command = stoppable_splatseg();
    command.args(["run", scene, "--out"]).arg(&out).args(learning);
    let mut child = command.stderr(Stdio::piped()).spawn().unwrap();
    wait_for(&out.join(".splatseg-new/lock"));
    send("-TERM", &child);
    let mut lines = BufReader::new(child.stderr.take().unwrap()).lines();
    assert!(lines.any(|line| line.unwrap().contains("again to end at once")));
    assert!(child.try_wait().unwrap().is_none());
    send("-INT", &child);
    assert_eq!(child.wait().unwrap().code(), Some(130));
    // Its leftovers do not prevent the next run.
    let ended = run(ROOM, &out, &[]);
    assert_eq!(ended.code, 0, "{}", ended.err);
    assert_eq!(file_names(&out), result_files(&[]));
}

#[test]
fn the_files_of_a_killed_run_are_known() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let mut child = start_long_run(&out);
    wait_for(&out.join("segments/frame-000008.png"));
    child.kill().unwrap();
    child.wait().unwrap();
    assert!(!out.join("summary.json").exists());
    assert_eq!(run(ROOM, &out, &[]).code, 2);
    let ended = run(ROOM, &out, &["--overwrite"]);
    assert_eq!(ended.code, 0, "{}", ended.err);
    for results in ["segments", "overlay"] {
        assert_eq!(file_names(&out.join(results)).len(), 4, "{:?}", file_names(&out.join(results)));
    }
}

#[cfg(target_os = "linux")]
#[test]
fn nohup_still_protects_from_a_closed_terminal() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let mut command = Command::new("bash");
    command.args(["-c", "trap '' HUP; exec \"$@\"", "bash"]).arg(assert_cmd::cargo::cargo_bin!("splatseg"));
    command.args(["run", "synthetic:frames=30,width=96,height=72", "--out"]).arg(&out);
    let child = command.stderr(Stdio::piped()).stdout(Stdio::null()).spawn().unwrap();
    wait_for(&out.join("segments/frame-000001.png"));
    send("-HUP", &child);
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", message(&output));
    assert_eq!(read_json(&out.join("summary.json"))["frames"], 30);
}

#[test]
fn two_runs_do_not_write_to_one_folder() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let child = start_long_run(&out);
    let ended = run(ROOM, &out, &["--overwrite"]);
    send("-TERM", &child);
    assert_eq!(child.wait_with_output().unwrap().status.code(), Some(143));
    assert!(ended.code == 2 && ended.err.contains("another run is writing"), "{}", ended.err);
}

#[test]
fn strict_input_ends_the_run_at_the_first_frame_that_cannot_be_used() {
    let folder = tempfile::tempdir().unwrap();
    let scene = numbered_scene(folder.path(), 4);
    fs::write(scene.join("depth/2.png"), b"no image").unwrap();
    let scene = scene.to_str().unwrap();
    let out = folder.path().join("out");
    let ended = run(scene, &out, &["--strict-input"]);
    assert_eq!(ended.code, 2, "{}", ended.err);
    assert!(ended.err.contains("depth/2.png") && ended.err.contains("after 2 frames"), "{}", ended.err);
    assert_eq!(file_names(&out.join("segments")), ["000000.png", "000001.png"]);
    assert_eq!(read_json(&out.join("summary.json"))["frames"], 2);
    let lenient = run(scene, &folder.path().join("lenient"), &[]);
    assert_eq!((lenient.code, lenient.err.matches("frame skipped").count()), (0, 1), "{}", lenient.err);
    // The same as a setting; frames on which the segmenter fails count as well.
    fs::create_dir(folder.path().join("masks")).unwrap();
    write_segments_png(&folder.path().join("masks/1.png"), &SegmentMap::filled(320, 240, 1)).unwrap();
    let masks = folder.path().join("masks");
    let options = ["--segmenter", "masks", "--masks", masks.to_str().unwrap(), "--set", "strict_input=true"];
    let ended = run(scene, &folder.path().join("strict"), &options);
    assert_eq!(ended.code, 2, "{}", ended.err);
    assert!(!folder.path().join("strict").exists());
}

#[test]
fn ids_above_16_bits_are_written_as_rgb_images_that_all_readers_accept() {
    let folder = tempfile::tempdir().unwrap();
    let plain = folder.path().join("plain");
    assert_eq!(run(ROOM, &plain, &[]).code, 0);
    let segments = |out: &Path, file: &str| read_segments_png(&out.join("segments").join(file)).unwrap();
    let files = file_names(&plain.join("segments"));
    let first = segments(&plain, &files[0]).areas().len();
    let memory = folder.path().join("memory.ply");
    save_nearly_full_memory(&memory, first);
    let (coco, mcap) = (folder.path().join("masks.json"), folder.path().join("run.mcap"));
    let options = ["--load-memory", "--save-coco", "--save-mcap"].into_iter().zip([&memory, &coco, &mcap]);
    let options: Vec<&str> = options.flat_map(|(name, path)| [name, path.to_str().unwrap()]).collect();
    let out = folder.path().join("out");
    let ended = run(ROOM, &out, &options);
    assert_eq!(ended.code, 0, "{}", ended.err);

    let used = MAX_16_BIT_ID - first as u32;
    let (mut rgb_files, mut rgb) = (0, Vec::new());
    for file in &files {
        let expected = segments(&plain, file).map(|id| if *id == 0 { 0 } else { id + used });
        assert_eq!(segments(&out, file), expected, "{file}");
        let color_type = fs::read(out.join("segments").join(file)).unwrap()[25];
        let is_large = expected.pixels().iter().any(|id| *id > MAX_16_BIT_ID);
        assert_eq!(color_type, if is_large { 2 } else { 0 }, "{file}: RGB, or grey");
        rgb_files += usize::from(is_large);
        rgb.extend(expected.areas().into_keys().filter(|id| *id > MAX_16_BIT_ID));
    }
    assert!(rgb_files > 0 && rgb_files < files.len());
    assert_eq!(read_json(&out.join("summary.json"))["rgb_id_images"], rgb_files);
    let tracks = read_json(&coco)["annotations"].as_array().unwrap().clone();
    assert!(tracks.iter().any(|track| track["track_id"] == rgb[0]));
    let recording = without_chunks(&fs::read(&mcap).unwrap());
    for encoding in [&b"16UC1"[..], b"32SC1"] {
        assert!(recording.windows(encoding.len()).any(|window| window == encoding));
    }
    // They can be read as masks of another run.
    let images = out.join("segments");
    let options = ["--segmenter", "masks", "--masks", images.to_str().unwrap()];
    assert_eq!(run(ROOM, &folder.path().join("again"), &options).code, 0);
}
