//! Single frames that are located in a saved map.

use crate::support::{Ended, finish, read_json, splatseg};
use splatseg::Settings;
use splatseg_memory::SplatMemory;
use std::fs;
use std::path::Path;

const ROOM: &str = "synthetic:frames=120,speed=0.3,width=160,height=120,seed=4";

fn locate(map: &Path, scene: &str, options: &[&str]) -> Ended {
    finish(splatseg().arg("locate").arg(map).arg(scene).args(options))
}

#[test]
fn frames_of_the_room_are_located_in_its_map_and_wrong_inputs_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let map = folder.join("map.ply");
    let mut command = splatseg();
    command.args(["run", ROOM, "--segmenter", "oracle", "--no-page", "--poses", "track"]);
    let ended = finish(command.arg("--out").arg(folder.join("out")).arg("--save-memory").arg(&map));
    assert_eq!(ended.code, 0, "{}", ended.err);

    // Half a step between the frames of the map.
    let between = "synthetic:frames=60,speed=0.15,width=160,height=120,seed=4";
    let (poses, json) = (folder.join("poses.txt"), folder.join("located.json"));
    let files = ["--out", poses.to_str().unwrap(), "--json", json.to_str().unwrap()];
    let ended = locate(&map, between, &[&files[..], &["--stride", "4", "--start", "2", "--compare"]].concat());
    assert!(ended.code == 0 && ended.out.is_empty(), "{}", ended.err);
    let located = read_json(&json);
    let found = located["found"].as_u64().unwrap();
    assert!(located["frames"] == 15 && found >= 10, "{}", ended.err);
    let wrong = located["comparison"].as_array().unwrap().iter().map(|group| group["wrong"].as_u64().unwrap());
    assert_eq!(wrong.sum::<u64>(), 0, "{}", ended.err);
    let lines = fs::read_to_string(&poses).unwrap();
    assert_eq!(lines.lines().filter(|line| !line.starts_with('#')).count() as u64, found);
    let refused = locate(&map, between, &files);
    assert!(refused.code == 2 && refused.err.contains("--overwrite"), "{}", refused.err);
    let replaced = locate(&map, between, &[&files[..], &["--max-frames", "2", "--overwrite"]].concat());
    assert_eq!(replaced.code, 0, "{}", replaced.err);
    for (file, expected) in
        [(&poses, "is not a file of poses by splatseg"), (&json, "is not a file that `splatseg locate --json` wrote")]
    {
        let ours = fs::read(file).unwrap();
        fs::write(file, "{}").unwrap();
        let refused = locate(&map, between, &[&files[..], &["--overwrite"]].concat());
        assert!(refused.code == 2 && refused.err.contains(expected), "{}", refused.err);
        assert_eq!(fs::read_to_string(file).unwrap(), "{}");
        fs::write(file, ours).unwrap();
    }

    let printed = locate(&map, between, &["--max-frames", "3"]);
    assert!(printed.code == 0 && printed.out.starts_with("# timestamp"), "{}", printed.out);
    assert!(printed.err.contains("of 3 frames found"), "{}", printed.err);

    let elsewhere = locate(&map, "synthetic:frames=8,width=160,height=120,seed=9", &[]);
    assert!(elsewhere.code == 0 && elsewhere.err.contains("0 of 8 frames found"), "{}", elsewhere.err);

    let refuse = |map: &Path, scene: &str, what: &str| {
        let ended = locate(map, scene, &[]);
        assert!(ended.code == 2 && ended.err.contains(what) && ended.err.lines().count() <= 3, "{}", ended.err);
    };
    let no_map = folder.join("no-map.ply");
    fs::write(&no_map, "not a map").unwrap();
    refuse(&no_map, between, "no-map.ply");
    refuse(&folder.join("missing.ply"), between, "missing.ply");
    refuse(&map, "missing-scene", "missing-scene");
    let memory = SplatMemory::load(&map, Settings::default().method.memory().unwrap().clone()).unwrap();
    let without_keyframes = folder.join("old.ply");
    memory.save(&without_keyframes).unwrap();
    refuse(&without_keyframes, between, "has no keyframes");
}
