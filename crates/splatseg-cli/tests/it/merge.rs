//! Two maps that become one.

use crate::support::{Ended, finish, splatseg};
use serde_json::Value;
use splatseg::Settings;
use splatseg::pipeline::NamedMap;
use splatseg_memory::SplatMemory;
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

/// Makes a map of a synthetic room with true masks; the camera is tracked.
fn room(folder: &Path, name: &str, scene: &str, options: &[&str]) -> PathBuf {
    let map = folder.join(format!("{name}.ply"));
    let scene = format!("synthetic:{scene},width=160,height=120");
    let mut command = splatseg();
    command.args(["run", &scene, "--segmenter", "oracle", "--set", "min_area=12", "--no-page", "--poses", "track"]);
    let ended = finish(command.arg("--out").arg(folder.join(name)).arg("--save-memory").arg(&map).args(options));
    assert_eq!(ended.code, 0, "{}", ended.err);
    map
}

fn visit(folder: &Path, which: &str) -> PathBuf {
    room(folder, which, &format!("frames=96,speed=0.5,seed=202,visit={which}"), &[])
}

fn merge(earlier: &Path, later: &Path, out: &Path, options: &[&str]) -> Ended {
    finish(splatseg().arg("merge").args([earlier, later]).arg("--out").arg(out).args(options))
}

fn list<'a>(report: &'a Value, name: &str) -> &'a [Value] {
    report[name].as_array().unwrap()
}

#[test]
fn two_visits_of_a_room_become_one_map_without_the_things_that_are_gone() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let (before, after, home) = (visit(folder, "before"), visit(folder, "after"), folder.join("home.ply"));
    name(&before, &[("1", "thing")]);
    let ended = merge(&before, &after, &home, &["--json"]);
    assert_eq!(ended.code, 0, "{}", ended.err);
    let report: Value = serde_json::from_str(&ended.out).unwrap();
    assert_fits(&report);
    assert_objects(&report, &home);
    // The same bytes with one thread.
    let again = folder.join("again.ply");
    let mut command = splatseg();
    command.env("RAYON_NUM_THREADS", "1").arg("merge").args([&before, &after]).arg("--out").arg(&again);
    assert_eq!(finish(&mut command).code, 0);
    assert!(fs::read(&home).unwrap() == fs::read(&again).unwrap());
    let refused = merge(&before, &after, &home, &[]);
    assert!(refused.code == 2 && refused.err.contains("give --overwrite"), "{}", refused.err);
    let scan = folder.join("scan.ply");
    fs::write(&scan, "ply\nformat ascii 1.0\n").unwrap();
    let refused = merge(&before, &after, &scan, &["--overwrite"]);
    assert!(refused.code == 2 && refused.err.contains("is not a saved memory"), "{}", refused.err);
    assert_eq!(fs::read_to_string(&scan).unwrap(), "ply\nformat ascii 1.0\n");

    // The merged map is one like any other: frames of both visits are found in it as in their own maps.
    for (which, own) in [("before", &before), ("after", &after)] {
        let (found, of_own) = (frames_found(&home, which), frames_found(own, which));
        assert!(found >= 4 && found + 1 >= of_own, "{which}: {found}, {of_own} in its own map");
    }
}

/// How many of six frames of a visit are found in a map.
fn frames_found(map: &Path, which: &str) -> usize {
    let scene = format!("synthetic:frames=96,speed=0.5,width=160,height=120,seed=202,visit={which}");
    let located = finish(splatseg().arg("locate").arg(map).args([&scene, "--stride", "16"]));
    let count = located.err.lines().find_map(|line| line.split_once(" of 6 frames found")?.0.parse().ok());
    count.unwrap_or_else(|| panic!("{}", located.err))
}

/// Gives objects labels by hand.
fn name(map: &Path, labels: &[(&str, &str)]) {
    let mut command = splatseg();
    let named = finish(command.arg("name").arg(map).args(labels.iter().map(|(id, label)| format!("{id}={label}"))));
    assert_eq!(named.code, 0, "{}", named.err);
}

fn assert_fits(report: &Value) {
    let number = |value: &Value| value.as_f64().unwrap();
    let keyframes = &report["keyframes"];
    assert!(number(&keyframes["later_recognised"]) > 10.0 && number(&keyframes["aligned"]) > 10.0, "{keyframes}");
    assert!(number(&report["residual_m"]) < 0.01 && number(&report["agreement"]) > 0.8);
    assert!(list(report, "seen_through_percent").iter().all(|share| number(share) < 12.0));
    // Tracking begins with a true pose, so both worlds are the same.
    for (row, entries) in list(report, "transform").iter().enumerate() {
        for (column, entry) in entries.as_array().unwrap().iter().enumerate() {
            assert!((number(entry) - f64::from(u8::from(row == column))).abs() < 0.03, "{}", report["transform"]);
        }
    }
}

fn assert_objects(report: &Value, home: &Path) {
    let changes = &report["changes"];
    let counts = ["gone", "new", "moved"].map(|kind| list(changes, kind).len());
    assert_eq!(counts, [3, 2, 2]);
    let objects = list(report, "objects");
    let has = |object: &Value, side: &str, id: &Value| list(object, side).contains(id);
    for moved in list(changes, "moved") {
        let object = objects.iter().find(|object| has(object, "earlier", &moved["before"]["id"])).unwrap();
        assert!(has(object, "later", &moved["after"]["id"]), "a thing that has moved keeps its id: {object}");
    }
    for gone in list(changes, "gone") {
        let object = objects.iter().find(|object| has(object, "earlier", &gone["id"])).unwrap();
        assert!(object["id"].is_null() && list(object, "later").is_empty(), "{object}");
    }
    let in_both =
        objects.iter().filter(|object| !list(object, "earlier").is_empty() && !list(object, "later").is_empty());
    let unchanged = list(changes, "unchanged").len();
    assert!(in_both.count() * 100 >= 90 * unchanged, "{unchanged}");
    let map = NamedMap::load(home).unwrap();
    let present: BTreeSet<u32> = map.object_list().objects.iter().map(|object| object.id).collect();
    assert!(map.names.label(1) == Some("thing") && present.len() > 15);
    for object in objects.iter().filter_map(|object| object["id"].as_u64()) {
        assert!(map.memory.map().carried_ids().contains(&(object as u32)), "{object}");
    }
}

#[test]
fn maps_that_do_not_fit_are_refused_in_one_line_and_no_file_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let one = room(folder, "one", "frames=16,seed=4", &[]);
    let other = room(folder, "other", "frames=16,seed=9", &[]);
    let out = folder.join("home.ply");
    let refuse = |earlier: &Path, later: &Path, options: &[&str], code: i32, what: &str| {
        let ended = merge(earlier, later, &out, options);
        assert!(ended.code == code && ended.err.contains(what), "{} {}", ended.code, ended.err);
        assert!(ended.err.lines().count() == 1 && ended.out.is_empty() && !out.exists(), "{}", ended.err);
    };
    refuse(&one, &other, &[], 1, "the maps show no common place: 0 of ");
    let features = ["--set", "memory.kind=features", "--set", "memory.feature_dim=8", "--set", "memory.num_codes=64"];
    let features = room(folder, "features", "frames=3,seed=4", &features);
    refuse(&one, &features, &[], 2, "only maps of votes can be joined, memory.kind = \"evidence\"");
    let memory = SplatMemory::load(&one, Settings::default().method.memory().unwrap().clone()).unwrap();
    let old = folder.join("old.ply");
    memory.save(&old).unwrap();
    refuse(&old, &one, &[], 2, "the earlier map has no keyframes");
    let mut bytes = fs::read(&one).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    fs::write(&old, bytes).unwrap();
    refuse(&one, &old, &[], 2, "old.ply");
    refuse(&one, &folder.join("missing.ply"), &[], 2, "missing.ply");
    refuse(&one, &other, &["--transform", "1 2 3"], 2, "expected 7 numbers");
    refuse(&one, &other, &["--transform", "0 0 0 0 0 0 0"], 2, "--transform: ");

    // With a known transform the maps need not overlap.
    let ended = merge(&one, &other, &out, &["--transform", "-20 0 0 0 0 1 0"]);
    assert!(ended.code == 0 && ended.out.contains("0 in both maps"), "{} {}", ended.err, ended.out);
    let count = |path: &Path| NamedMap::load(path).unwrap().memory.gaussian_count();
    assert_eq!(count(&out), count(&one) + count(&other));
}
