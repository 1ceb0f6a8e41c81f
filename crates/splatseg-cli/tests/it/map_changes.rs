//! Changes between two visits of a room.

use crate::support::{finish, read_json, splatseg};
use splatseg_dataset::read_segments_png;
use std::fs;
use std::path::Path;

/// A visit; the camera is tracked in both.
fn visit(which: &str, folder: &Path, options: &[&str]) {
    let scene = format!("synthetic:frames=96,speed=0.5,width=160,height=120,seed=202,visit={which}");
    let (out, map) = (folder.join(which), folder.join(format!("{which}.ply")));
    let mut command = splatseg();
    command.args(["run", &scene, "--segmenter", "oracle", "--set", "min_area=12", "--no-page", "--poses", "track"]);
    let ended = finish(command.arg("--out").arg(&out).arg("--save-memory").arg(&map).args(options));
    assert_eq!(ended.code, 0, "{}", ended.err);
}

/// The first frame was taken before the camera had found its place. Its objects have the same ids as in later frames.
fn assert_first_frame_has_the_ids_of_the_map(out: &Path) {
    assert!(read_json(&out.join("summary.json"))["pose_states"]["lost"].as_u64().unwrap() > 0);
    let ids = |frame: &str| read_segments_png(&out.join(format!("segments/frame-{frame}.png"))).unwrap().areas();
    let later = ids("000008");
    for (id, area) in ids("000000") {
        assert!(area < 300 || id == 0 || later.contains_key(&id), "{id} with {area} pixels is unknown later");
    }
}

#[test]
fn things_that_came_went_and_moved_are_found_by_a_run_and_by_diff() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    visit("before", folder, &[]);
    assert!(!folder.join("before/changes.json").exists());
    let before = folder.join("before.ply");
    visit("after", folder, &["--load-memory", before.to_str().unwrap()]);
    let changes = read_json(&folder.join("after/changes.json"));
    let counts = ["gone", "new", "moved"].map(|kind| changes[kind].as_array().unwrap().len());
    assert_eq!(counts, [3, 2, 2], "{counts:?}");
    assert!(changes["unchanged"].as_array().unwrap().len() > 10);
    assert_first_frame_has_the_ids_of_the_map(&folder.join("after"));

    let out = folder.join("changes.json");
    let diff_with = |before: &Path, after: &Path, more: &[&str]| {
        let mut command = splatseg();
        finish(command.arg("diff").arg(before).arg(after).arg("--out").arg(&out).args(more))
    };
    let diff = |before: &Path, after: &Path| diff_with(before, after, &[]);
    let printed = diff(&before, &folder.join("after.ply"));
    assert_eq!(printed.code, 0, "{}", printed.err);
    assert!(printed.out.contains("3 gone, 2 new, 2 moved") && printed.out.lines().count() == 8, "{}", printed.out);
    let saved = read_json(&out);
    for kind in ["gone", "new", "moved", "unchanged", "newly_seen", "not_looked_at"] {
        assert_eq!(saved[kind], changes[kind], "{kind}: also after the final pass");
    }
    let refused = diff(&before, &folder.join("after.ply"));
    assert!(refused.code == 2 && refused.err.contains("give --overwrite"), "{}", refused.err);
    assert_eq!(diff_with(&before, &folder.join("after.ply"), &["--overwrite"]).code, 0);
    fs::write(&out, "{\"new\": []}").unwrap();
    let refused = diff_with(&before, &folder.join("after.ply"), &["--overwrite"]);
    assert!(refused.code == 2 && refused.err.contains("is not a file of changes by splatseg"), "{}", refused.err);
    assert_eq!(fs::read_to_string(&out).unwrap(), "{\"new\": []}");
    fs::remove_file(&out).unwrap();
    // A map compared with itself: nothing was looked at since.
    let same = diff(&before, &before);
    assert!(same.code == 2 && same.err.contains("no keyframes besides those of"), "{}", same.err);
    fs::write(&before, "ply\n").unwrap();
    assert_eq!(diff(&before, &before).code, 2);
}
