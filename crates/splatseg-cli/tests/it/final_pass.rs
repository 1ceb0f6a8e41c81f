//! After the last frame, the map decides the ids of all frames again.

#![cfg(unix)]

use crate::support::{finish, read_json, splatseg, stoppable_splatseg};
use splatseg_dataset::read_segments_png;
use splatseg_geometry::SegmentId;
use splatseg_test_scenes::file_contents;
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

const ROOM: &str = "synthetic:frames=40,width=128,height=96,objects=8,noise=kinect,seed=4";

fn run(out: &Path, more: &[&str]) {
    let ended = finish(splatseg().args(["run", ROOM, "--out"]).arg(out).args(more));
    assert_eq!(ended.code, 0, "{}", ended.err);
}

/// Every file of a run with its content, except those that contain times or the order of writing.
fn files(out: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = file_contents(out);
    for file in ["manifest.jsonl", "summary.json"] {
        found.remove(Path::new(file)).unwrap();
    }
    found
}

fn names_in(folder: &Path) -> BTreeSet<String> {
    fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect()
}

/// For each id, the number of images that show it, and the largest area.
fn shown(out: &Path) -> BTreeMap<SegmentId, (u64, u64)> {
    let mut shown: BTreeMap<SegmentId, (u64, u64)> = BTreeMap::new();
    for image in names_in(&out.join("segments")) {
        let segments = read_segments_png(&out.join("segments").join(image)).unwrap();
        for (id, area) in segments.areas() {
            let (frames, largest) = shown.entry(id).or_default();
            (*frames, *largest) = (*frames + 1, (*largest).max(area as u64));
        }
    }
    shown
}

#[test]
fn all_results_follow_the_final_ids() {
    let folder = tempfile::tempdir().unwrap();
    let (out, online, coco) =
        (folder.path().join("out"), folder.path().join("online"), folder.path().join("coco.json"));
    run(&out, &["--save-coco", coco.to_str().unwrap()]);
    run(&online, &["--online"]);
    assert!(read_json(&out.join("summary.json"))["final_pass_s"].as_f64() > Some(0.0));
    assert!(read_json(&online.join("summary.json"))["final_pass_s"].is_null());
    let [found, before] = [&out, &online].map(|out| file_contents(&out.join("segments")));
    assert!(found.len() == 40 && found != before, "the map of the end knows more");

    let (shown, list) = (shown(&out), read_json(&out.join("objects.json")));
    assert_eq!(read_json(&out.join("summary.json"))["segments"].as_u64(), Some(shown.len() as u64));
    let mut crops = BTreeSet::new();
    for object in ["objects", "not_counted"].iter().flat_map(|key| list[key].as_array().unwrap()) {
        let id = object["id"].as_u64().unwrap() as SegmentId;
        let (frames, largest) = shown.get(&id).copied().unwrap_or_default();
        assert_eq!(object["frames"].as_u64(), Some(frames), "{object}");
        if frames > 0 {
            assert!(object["best_view"]["area_px"].as_u64() <= Some(largest), "{object}");
            crops.insert(format!("{id}.jpg"));
        }
    }
    assert_eq!(crops.len(), shown.len(), "every id of an image is an object");
    assert_eq!(names_in(&out.join("objects")), crops, "objects that no image shows any more have no picture");
    let masks = read_json(&coco)["annotations"].as_array().unwrap().len() as u64;
    assert_eq!(masks, shown.values().map(|(frames, _)| frames).sum::<u64>());
}

/// Starts a run, waits until the final pass has decided a frame, and sends the signal.
fn stop_in_final_pass(signal: &str, out: &Path, more: &[&str]) {
    let mut command = stoppable_splatseg();
    command.args(["run", ROOM, "--out"]).arg(out).args(more).stdout(Stdio::null()).stderr(Stdio::null());
    let mut child = command.spawn().unwrap();
    let first = out.join(".splatseg-new/segments/frame-000000.png");
    let started = Instant::now();
    // The list of objects is written before the pass begins.
    while !(out.join("objects.json").exists() && first.exists()) {
        assert!(started.elapsed() < Duration::from_secs(60), "the final pass does not begin");
        std::thread::sleep(Duration::from_millis(1));
    }
    assert!(Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap().success());
    child.wait().unwrap();
}

#[test]
fn a_stopped_pass_is_finished_by_resuming() {
    let folder = tempfile::tempdir().unwrap();
    let [whole, online, out] = ["whole", "online", "out"].map(|name| folder.path().join(name));
    run(&whole, &[]);
    run(&online, &["--online"]);
    for signal in ["-KILL", "-INT"] {
        let _ = fs::remove_dir_all(&out);
        stop_in_final_pass(signal, &out, &["--save-every", "7"]);
        // Until then, all results are those of the time.
        for folder in ["segments", "overlay", "objects"] {
            let [expected, found] = [&online, &out].map(|out| file_contents(&out.join(folder)));
            assert!(found == expected, "{folder} after {signal}");
        }
        run(&out, &["--resume", "--threads", "1"]);
        let (expected, found) = (files(&whole), files(&out));
        assert_eq!(found.keys().collect::<Vec<_>>(), expected.keys().collect::<Vec<_>>());
        for (path, bytes) in &expected {
            assert!(found[path] == *bytes, "{} differs after {signal}", path.display());
        }
    }
}
