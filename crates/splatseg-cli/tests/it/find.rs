//! `splatseg find`.

use crate::support::{Ended, ROOM, finish, read_json, splatseg};
use splatseg::dataset::{FrameStream, GroundTruth, open_scene};
use splatseg::objects::ObjectName;
use splatseg::{Pipeline, Settings};
use std::fs;
use std::path::Path;

/// Saves a map of the room whose first object is a mug and whose others are tables.
fn save_map(path: &Path) {
    let settings = Settings::default();
    let mut pipeline = Pipeline::builder(&settings).keep_views().build().unwrap();
    let scene = open_scene(ROOM, &settings.dataset).unwrap();
    for processed in pipeline.run(FrameStream::open(scene, &settings.dataset, GroundTruth::Skip).unwrap()) {
        processed.unwrap().result.unwrap();
    }
    let mut first = true;
    let named = pipeline.name_objects(|_| {
        let (label, embedding) = if std::mem::take(&mut first) { ("Mug", [1.0, 0.0]) } else { ("table", [0.0, 1.0]) };
        Ok(ObjectName { label: Some(label.to_owned()), embedding: embedding.to_vec(), ..ObjectName::default() })
    });
    assert!(named.unwrap() >= 2);
    pipeline.save_memory(path).unwrap();
}

fn find(map: &Path, text: &str, more: &[&str]) -> Ended {
    finish(splatseg().arg("find").arg(map).arg(text).args(more))
}

#[test]
fn objects_are_found_by_their_labels() {
    let folder = tempfile::tempdir().unwrap();
    let map = folder.path().join("map.ply");
    save_map(&map);
    let ended = find(&map, "mug", &[]);
    assert_eq!((ended.code, ended.out.lines().count()), (0, 1), "{}{}", ended.out, ended.err);
    assert!(ended.out.contains(" Mug, score 1.00 (label): ") && ended.out.contains(" m at "), "{}", ended.out);
    let ended = find(&map, "sofa", &[]);
    assert!(ended.code == 0 && ended.out.contains("the labels are Mug, table"), "{}", ended.out);

    // A later run with the map lists the labels.
    let out = folder.path().join("out");
    let mut command = splatseg();
    command.args(["run", ROOM, "--no-page"]).arg("--out").arg(&out).arg("--load-memory").arg(&map);
    let ended = finish(&mut command);
    assert_eq!(ended.code, 0, "{}", ended.err);
    let list = read_json(&out.join("objects.json"));
    assert!(list["objects"].as_array().unwrap().iter().any(|object| object["label"] == "Mug"), "{list}");
}

#[test]
fn maps_without_names_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let (map, out) = (folder.path().join("map.ply"), folder.path().join("out"));
    let mut command = splatseg();
    command.args(["run", ROOM, "--no-page"]).arg("--out").arg(&out).arg("--save-memory").arg(&map);
    assert_eq!(finish(&mut command).code, 0);
    let ended = find(&map, "mug", &[]);
    assert!(ended.code == 2 && ended.err.contains("no names") && ended.err.lines().count() == 1, "{}", ended.err);
    for nothing in ["", " \t", "where is the"] {
        let ended = find(&map, nothing, &[]);
        assert!(ended.code == 2 && ended.err.contains("says nothing of an object"), "{}{}", ended.out, ended.err);
    }
    fs::write(&map, "ply\nnothing").unwrap();
    assert_eq!(find(&map, "mug", &[]).code, 2);
}

#[cfg(unix)]
#[test]
fn a_text_encoder_finds_the_most_similar_objects() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().unwrap();
    let (map, encoder) = (folder.path().join("map.ply"), folder.path().join("encoder.sh"));
    save_map(&map);
    let with = |script: &str| {
        fs::write(&encoder, format!("#!/bin/sh\n{script}\n")).unwrap();
        fs::set_permissions(&encoder, fs::Permissions::from_mode(0o755)).unwrap();
        find(&map, "something to drink from", &["--text-encoder", encoder.to_str().unwrap(), "--top", "1"])
    };
    let ended = with("test \"$1\" = 'something to drink from' && echo '[2.0, 0.2]'");
    assert_eq!((ended.code, ended.out.lines().count()), (0, 1), "{}{}", ended.out, ended.err);
    assert!(ended.out.contains(" Mug, score 1.00 (similarity): "), "{}", ended.out);
    for (script, problem) in
        [("exit 3", "exit status: 3"), ("echo mug", "JSON list"), ("echo '[1, 2, 3]'", "3 numbers")]
    {
        let ended = with(script);
        assert!(ended.code == 2 && ended.err.contains(problem), "{script}: {}", ended.err);
    }
}
