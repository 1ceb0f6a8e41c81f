//! Runs that are stopped and resumed: the results equal those of an uninterrupted run.

#![cfg(unix)]

use crate::support::nearly_full::save_nearly_full_memory;
use crate::support::{Ended, FEATURES, finish, read_json, splatseg, stoppable_splatseg};
use crate::tiny_clip::{write_network, write_vocabulary};
use splatseg_test_scenes::file_contents;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

const ROOM: &str = "synthetic:frames=36,width=96,height=72,objects=8,noise=kinect";

fn run(out: &Path, more: &[&str]) -> Ended {
    finish(splatseg().args(["run", ROOM, "--out"]).arg(out).args(more))
}

/// Starts a run, sends it a signal once the images of a frame exist, and waits for it to exit.
fn stop_at(frame: usize, signal: &str, out: &Path, more: &[&str]) {
    let mut command = stoppable_splatseg();
    command.args(["run", ROOM, "--out"]).arg(out).args(more).stdout(Stdio::null()).stderr(Stdio::null());
    let mut child = command.spawn().unwrap();
    let image = out.join(format!("segments/frame-{frame:06}.png"));
    let started = Instant::now();
    while !image.exists() {
        assert!(started.elapsed() < Duration::from_secs(60), "{} does not appear", image.display());
        std::thread::sleep(Duration::from_millis(1));
    }
    assert!(Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap().success());
    child.wait().unwrap();
}

fn path_text(path: &Path) -> String {
    path.to_str().unwrap().to_owned()
}

/// Returns every file in a folder with its content, except files that contain times or the order of writing.
fn files(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = file_contents(folder);
    found.remove(Path::new("manifest.jsonl")).unwrap();
    found.remove(Path::new("summary.json")).unwrap();
    found
}

/// Returns the files that the manifest lists, sorted.
fn listed(out: &Path) -> Vec<String> {
    let mut lines: Vec<String> =
        fs::read_to_string(out.join("manifest.jsonl")).unwrap().lines().map(str::to_owned).collect();
    lines.sort_unstable();
    lines
}

#[test]
fn a_run_killed_before_its_first_state_starts_anew() {
    let folder = tempfile::tempdir().unwrap();
    let (whole, out, memory) = (folder.path().join("whole"), folder.path().join("out"), folder.path().join("map.ply"));
    assert_eq!(run(&whole, &[]).code, 0);
    let saving = ["--save-every", "1000", "--save-memory", memory.to_str().unwrap()];
    stop_at(3, "-KILL", &out, &saving);
    // Also of a run that was killed while it wrote.
    let leftovers = [".writing-manifest.jsonl-aB3dE6", ".splatseg-resume/.writing-state.json-aB3dE6"];
    for (file, text) in leftovers.map(|file| (file, "part")).into_iter().chain([("notes.txt", "mine")]) {
        fs::write(out.join(file), text).unwrap();
    }
    fs::write(folder.path().join(".writing-map.ply-aB3dE6"), "part").unwrap();
    let ended = run(&out, &[&["--resume"][..], &saving].concat());
    assert_eq!(ended.code, 0, "{}", ended.err);
    assert!(ended.err.contains("out: stopped before its state was saved: it starts anew"), "{}", ended.err);
    assert_eq!(fs::read_to_string(out.join("notes.txt")).unwrap(), "mine");
    fs::remove_file(out.join("notes.txt")).unwrap();
    let (expected, found) = (files(&whole), files(&out));
    assert!(found == expected, "{:?}", found.keys().find(|file| expected.get(*file) != found.get(*file)));
    assert!(listed(&out).windows(2).all(|two| two[0] != two[1]), "each file is listed once");
    let beside = fs::read_dir(folder.path()).unwrap().count();
    assert_eq!(beside, 3, "nothing else is left beside the folders and the map");
    // Files of others are not replaced.
    let other = folder.path().join("other");
    stop_at(3, "-KILL", &other, &saving[..2]);
    fs::write(other.join("index.html"), "mine").unwrap();
    let ended = run(&other, &["--resume"]);
    assert!(ended.code == 2 && ended.err.contains("index.html: is in the way"), "{}", ended.err);
    assert_eq!(fs::read_to_string(other.join("index.html")).unwrap(), "mine");
}

#[test]
fn a_resumed_run_of_a_loaded_map_has_its_changes_and_its_files() {
    let folder = tempfile::tempdir().unwrap();
    let [map, later, saved, coco] =
        ["map.ply", "later.ply", "saved.ply", "coco.json"].map(|name| path_text(&folder.path().join(name)));
    let [first, whole, out] = ["first", "whole", "out"].map(|name| folder.path().join(name));
    let ended = run(&first, &["--max-frames", "12", "--save-memory", &map]);
    assert_eq!(ended.code, 0, "{}", ended.err);
    let with = |memory: &str| ["--load-memory", &map, "--save-memory", memory].map(str::to_owned);
    let expected = with(&later);
    assert_eq!(run(&whole, &expected.each_ref().map(String::as_str)).code, 0);
    let more = ["--save-coco", &coco, "--save-every"].map(str::to_owned);
    let options: Vec<String> = with(&saved).into_iter().chain(more).collect();
    let options: Vec<&str> = options.iter().map(String::as_str).collect();

    // Killed before its first state, and after it; the second time with the map named again.
    stop_at(3, "-KILL", &out, &[&options[..], &["1000"]].concat());
    let refused = run(&out, &["--resume", "--load-memory", &later]);
    assert!(refused.code == 2 && refused.err.contains("the run was started with"), "{}", refused.err);
    assert_eq!(run(&out, &["--resume", "--save-memory", &saved]).code, 0);
    let same = |what: &str| {
        assert!(fs::read(&saved).unwrap() == fs::read(&later).unwrap(), "{what}: the map differs");
        let [expected, found] = [&whole, &out].map(|out| files(out));
        assert!(found == expected, "{what}: {:?}", found.keys().find(|file| expected.get(*file) != found.get(*file)));
    };
    same("started anew");
    for (name, again) in [("killed", &["--resume"][..]), ("and named", &["--resume", "--load-memory", &map])] {
        for file in [&saved, &coco] {
            let _ = fs::remove_file(file);
        }
        fs::remove_dir_all(&out).unwrap();
        stop_at(9, "-KILL", &out, &[&options[..], &["4"]].concat());
        assert!(out.join(".splatseg-resume/state.json").exists());
        let ended = run(&out, again);
        assert_eq!(ended.code, 0, "{}", ended.err);
        assert!(ended.err.contains("since the loaded map: "), "{}", ended.err);
        same(name);
        assert!(Path::new(&coco).exists(), "its options need not be given again");
    }
    // Without saving any more; and the loaded map is another one by now.
    fs::remove_dir_all(&out).unwrap();
    stop_at(9, "-INT", &out, &[&options[..], &["4", "--overwrite"]].concat());
    fs::copy(&later, &map).unwrap();
    let ended = run(&out, &["--resume", "--save-every", "0"]);
    assert_eq!(ended.code, 0, "{}", ended.err);
    assert!(ended.err.contains("is not the file that the run was started with any more"), "{}", ended.err);
    assert!(!out.join("changes.json").exists());
    assert!(fs::read(&saved).unwrap() == fs::read(&later).unwrap(), "the map differs");
}

#[test]
fn a_resumed_run_writes_the_same_bytes() {
    resumed_runs_write_the_same_bytes([&["--set", "memory.kind=evidence"], &["--poses", "track"]]);
}

#[test]
fn a_resumed_run_of_features_or_of_all_new_things_writes_the_same_bytes() {
    resumed_runs_write_the_same_bytes([&FEATURES, &["--set", "min_new_fraction=0"]]);
}

fn resumed_runs_write_the_same_bytes(kinds: [&[&str]; 2]) {
    let folder = tempfile::tempdir().unwrap();
    for kind in kinds {
        let (whole, memory) = (folder.path().join("whole"), folder.path().join("whole.ply"));
        let [whole_mcap, mcap] = ["whole.mcap", "out.mcap"].map(|name| folder.path().join(name));
        let [whole_coco, coco] = ["whole.json", "out.json"].map(|name| folder.path().join(name));
        let files_of =
            |mcap: &Path, coco: &Path| ["--save-mcap".into(), path_text(mcap), "--save-coco".into(), path_text(coco)];
        let (whole_files, recording) = (files_of(&whole_mcap, &whole_coco), files_of(&mcap, &coco));
        let [whole_files, recording] = [&whole_files, &recording].map(|files| files.each_ref().map(String::as_str));
        let saved = ["--overwrite", "--save-memory", memory.to_str().unwrap()];
        assert_eq!(run(&whole, &[kind, &saved, &whole_files].concat()).code, 0);

        let (out, last) = (folder.path().join("out"), folder.path().join("out.ply"));
        let _ = fs::remove_dir_all(&out);
        let _ = fs::remove_file(&last);
        let _ = fs::remove_file(&mcap);
        let _ = fs::remove_file(&coco);
        let saving = ["--save-every", "7", "--save-memory", last.to_str().unwrap()];
        stop_at(9, "-KILL", &out, &[kind, &saving, &recording].concat());
        assert!(out.join(".splatseg-resume/state.json").exists());
        let resumed = [&["--resume", "--save-memory", last.to_str().unwrap()][..], &recording].concat();
        stop_at(18, "-INT", &out, &resumed);
        stop_at(25, "-KILL", &out, &resumed);
        let ended = run(&out, &[&resumed[..], &["--threads", "1"]].concat());
        assert_eq!(ended.code, 0, "{}", ended.err);
        assert!(ended.err.contains("going on after frame"), "{}", ended.err);

        assert!(listed(&out).windows(2).all(|two| two[0] != two[1]), "each file is listed once");
        let (expected, found) = (files(&whole), files(&out));
        assert_eq!(found.keys().collect::<Vec<_>>(), expected.keys().collect::<Vec<_>>());
        for (path, bytes) in &expected {
            assert!(found[path] == *bytes, "{} differs", path.display());
        }
        assert!(fs::read(&memory).unwrap() == fs::read(&last).unwrap(), "the memory differs");
        assert!(fs::read(&whole_mcap).unwrap() == fs::read(&mcap).unwrap(), "the recording differs");
        assert!(fs::read(&whole_coco).unwrap() == fs::read(&coco).unwrap(), "the masks differ");
        let (expected, found) = (read_json(&whole.join("summary.json")), read_json(&out.join("summary.json")));
        for key in [
            "frames",
            "skipped_frames",
            "segments",
            "objects",
            "tentative_objects",
            "gaussians",
            "error",
            "interrupted",
        ] {
            assert_eq!(found[key], expected[key], "{key}");
        }
        assert!(found["resumed_frames"].as_u64() >= Some(18), "{found}");
    }
}

#[test]
fn a_resumed_run_with_ids_above_16_bits_writes_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let memory = folder.path().join("full.ply");
    save_nearly_full_memory(&memory, 2);
    let loaded = ["--load-memory", memory.to_str().unwrap()];
    let (whole, out) = (folder.path().join("whole"), folder.path().join("out"));
    assert_eq!(run(&whole, &loaded).code, 0);
    stop_at(9, "-KILL", &out, &[&loaded[..], &["--save-every", "4"]].concat());
    let ended = run(&out, &["--resume"]);
    assert_eq!(ended.code, 0, "{}", ended.err);
    let (expected, found) = (files(&whole), files(&out));
    assert!(expected == found, "{:?}", expected.keys().find(|file| found.get(*file) != expected.get(*file)));
    let rgb_images = |out: &Path| read_json(&out.join("summary.json"))["rgb_id_images"].as_u64();
    assert_eq!(rgb_images(&whole), rgb_images(&out));
    assert!(rgb_images(&out) > Some(0), "no id is above 65535");
}

#[test]
fn objects_of_a_resumed_run_have_the_same_names() {
    let folder = tempfile::tempdir().unwrap();
    let [network, things, map, last] =
        ["tiny.safetensors", "things.txt", "whole.ply", "out.ply"].map(|name| folder.path().join(name));
    write_network(&network);
    write_vocabulary(&things, &[]);
    let [network, things, map_text, last_text] = [&network, &things, &map, &last].map(|path| path_text(path));
    let names = ["--names", &network, "--vocabulary", &things, "--set", "clip.min_score=0.05"];
    let (whole, out) = (folder.path().join("whole"), folder.path().join("out"));
    assert_eq!(run(&whole, &[&names[..], &["--save-memory", &map_text]].concat()).code, 0);
    stop_at(9, "-KILL", &out, &[&names[..], &["--save-every", "7", "--save-memory", &last_text]].concat());
    let ended = run(&out, &[&names[..], &["--resume", "--save-memory", &last_text]].concat());
    assert!(ended.code == 0 && ended.err.contains("going on after frame"), "{}", ended.err);
    assert!(files(&whole) == files(&out), "the results differ");
    assert!(fs::read(&map).unwrap() == fs::read(&last).unwrap(), "the map differs");
    let list = fs::read_to_string(out.join("objects.csv")).unwrap();
    let named = list.lines().filter(|line| ["ball", "box", "cone"].iter().any(|shape| line.contains(shape))).count();
    assert!(named >= 3, "{list}");
}

#[test]
fn a_run_is_resumed_only_with_its_own_options_and_intact_state() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    stop_at(6, "-INT", &out, &["--save-every", "3"]);
    for (options, expected) in [
        (&["--resume", "--set", "memory.max_votes=3"][..], "memory.max_votes is 3.0, but was 4.0"),
        (&["--resume", "--stride", "2"], "dataset.stride is 2, but was 1"),
        (&["--resume", "--overwrite"], "cannot be used with"),
        (&["--resume", "--save-coco", "new.json"], "it was started without --save-coco"),
        (&[], "or --resume to go on"),
    ] {
        let ended = run(&out, options);
        assert_eq!(ended.code, 2, "{options:?}: {}", ended.err);
        assert!(ended.err.contains(expected), "{options:?}: {}", ended.err);
    }
    let mut other = splatseg();
    other.args(["run", "synthetic:frames=39", "--resume", "--out"]).arg(&out);
    assert!(finish(&mut other).err.contains("the scene is synthetic:frames=39, but was"));
    // Damaged states.
    let saved = out.join(".splatseg-resume");
    let state = fs::read_to_string(saved.join("state.json")).unwrap();
    let next = read_json(&saved.join("state.json"))["next"].as_u64().unwrap();
    let [objects, page] = ["objects", "page"].map(|name| format!("{name}-{next}.json"));
    let camera = format!("camera-{next}.safetensors");
    for (file, text) in [
        ("state.json", "{"),
        ("state.json", &state.replace("\"frames\": ", "\"frames\": 9")),
        ("state.json", &state.replace("\"next\": ", "\"next\": 9")),
        ("state.json", &state.replace("\"form\": ", "\"form\": 9")),
        (&camera, "{}"),
        ("frames.jsonl", "{\"index\": 0}\n"),
        ("frames.jsonl", ""),
        ("page.jsonl", "{}\n"),
        ("objects.jsonl", ""),
        ("poses.jsonl", ""),
        ("poses.jsonl", "{}\n"),
        (&objects, "{\"objects\": 3}"),
        (&page, "{}"),
    ] {
        let whole = fs::read(saved.join(file)).unwrap();
        fs::write(saved.join(file), text).unwrap();
        let ended = run(&out, &["--resume"]);
        assert_eq!((ended.code, ended.err.lines().count()), (2, 1), "{file} {text}: {}", ended.err);
        fs::write(saved.join(file), whole).unwrap();
    }
    let image = out.join("segments/frame-000002.png");
    let moved = fs::read(&image).unwrap();
    fs::remove_file(&image).unwrap();
    let ended = run(&out, &["--resume"]);
    assert!(ended.code == 2 && ended.err.contains("frame-000002.png: missing"), "{}", ended.err);
    fs::write(&image, moved).unwrap();
    let ended = run(&out, &["--resume"]);
    assert_eq!(ended.code, 0, "{}", ended.err);
    assert!(!saved.exists());
    let ended = run(&out, &["--resume"]);
    assert_eq!((ended.code, ended.out.contains("complete already")), (0, true), "{}", ended.err);
}

#[test]
fn resume_without_an_earlier_run_starts_one() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let ended = run(&out, &["--resume", "--save-every", "2", "--max-frames", "3"]);
    assert_eq!((ended.code, out.join(".splatseg-resume").exists()), (0, false), "{}", ended.err);
    let ended = run(&folder.path().join("other"), &["--save-every", "2", "--method", "fastsam"]);
    assert_eq!((ended.code, ended.err.lines().count()), (2, 1), "{}", ended.err);
    assert!(ended.err.contains("save_every is not used here: it needs method = fastsam-splat"), "{}", ended.err);
    // A stopped run without a saved state cannot be resumed, and is not complete.
    let other = folder.path().join("third");
    stop_at(3, "-INT", &other, &[]);
    let ended = run(&other, &["--resume"]);
    assert!(ended.code == 2 && ended.err.contains("the folder is not empty"), "{}", ended.err);
}
