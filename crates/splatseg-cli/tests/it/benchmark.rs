//! `splatseg bench`: results are complete, resumable, and independent of the number of jobs.

use crate::support::{CLIP_PARTS, FEATURES, OTHER_ROOM, ROOM, bench, finish, read_json, splatseg};
use serde_json::Value;
use splatseg_test_scenes::copy_demo_clip;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

const SEEDS: [&str; 2] = ["--seeds", "2"];

/// Returns the rows without measured times and memory use.
fn timeless_rows(out: &Path) -> Vec<Value> {
    let Value::Array(mut rows) = read_json(&out.join("results.json")) else { panic!("no list") };
    for row in &mut rows {
        let row = row.as_object_mut().unwrap();
        row.remove("fps").unwrap();
        row.remove("stage_ms").unwrap();
        if let Some(again) = row["final_pass"].as_object_mut() {
            again.remove("seconds").unwrap();
        }
    }
    rows
}

fn saved(out: &Path) -> BTreeMap<String, SystemTime> {
    let entries = fs::read_dir(out.join("results")).unwrap().map(Result::unwrap);
    entries
        .map(|entry| (entry.file_name().into_string().unwrap(), entry.metadata().unwrap().modified().unwrap()))
        .collect()
}

#[test]
fn results_are_complete_resumable_and_the_same_for_any_number_of_jobs() {
    let folder = tempfile::tempdir().unwrap();
    let (one, two) = (folder.path().join("one"), folder.path().join("two"));
    let ended = bench(&[ROOM, OTHER_ROOM], &one, &SEEDS);
    assert_eq!(ended.code, 0, "{}", ended.err);
    check_rows(&one);

    let ended = bench(&[ROOM, OTHER_ROOM], &two, &["--seeds", "2", "--jobs", "2"]);
    assert_eq!(ended.code, 0, "{}", ended.err);
    assert_eq!(timeless_rows(&one), timeless_rows(&two));

    let before = saved(&one);
    let (gone, _) = before.iter().nth(3).unwrap();
    fs::remove_file(one.join("results").join(gone)).unwrap();
    let rows = timeless_rows(&one);
    let ended = bench(&[ROOM, OTHER_ROOM], &one, &SEEDS);
    assert_eq!((ended.code, ended.out.matches(": reused").count()), (0, 7), "{}", ended.out);
    let after = saved(&one);
    assert_eq!(before.keys().collect::<Vec<_>>(), after.keys().collect::<Vec<_>>());
    let renewed: Vec<&String> =
        after.iter().filter(|(name, time)| before[*name] != **time).map(|(name, _)| name).collect();
    assert_eq!(renewed, [gone]);
    assert_eq!(timeless_rows(&one), rows);

    // A truncated result is measured again, and so is a result of a version without counts by size. With other settings,
    // everything is measured again.
    fs::write(one.join("results").join(gone), "{").unwrap();
    make_older(&one.join("results").join(before.keys().next().unwrap()));
    let ended = bench(&[ROOM, OTHER_ROOM], &one, &SEEDS);
    assert_eq!((ended.code, ended.out.matches(": reused").count()), (0, 6), "{}", ended.err);
    assert_eq!(timeless_rows(&one), rows);
    let ended = bench(&[ROOM], &one, &["--set", "memory.max_votes=3"]);
    // The baseline has no memory: its result stays the same.
    assert_eq!((ended.code, ended.out.matches(": reused").count()), (0, 1));
}

/// Removes the counts by size from a result, as in results of earlier versions.
fn make_older(result: &Path) {
    let mut value = read_json(result);
    for protocol in ["paper", "strict"] {
        value[protocol]["counts"].as_object_mut().unwrap().remove("by_size").unwrap();
    }
    fs::write(result, value.to_string()).unwrap();
}

/// Asserts that the rows of two scenes, two methods and two seeds are complete.
fn check_rows(out: &Path) {
    let rows = timeless_rows(out);
    let key = |row: &Value| [&row["scene"], &row["method"], &row["seed"]].map(Value::to_string).join(" ");
    let mut keys: Vec<String> = rows.iter().map(key).collect();
    keys.sort();
    keys.dedup();
    assert_eq!((rows.len(), keys.len()), (8, 8));
    for row in &rows {
        for key in ["vsq", "stq", "aq", "sq"] {
            assert!(row[key].is_f64() && row["strict"][key].is_f64(), "{key}: {row}");
        }
        assert!(["1", "5", "10", "15"].iter().all(|length| row["vsq_k"][length].is_f64()));
        check_sizes(row);
        let again = &row["final_pass"];
        assert_eq!(again["vsq"].is_f64() && again["strict"]["stq"].is_f64(), row["method"] == "fastsam-splat", "{row}");
        assert_eq!((&row["segmenter"], &row["protocol"]), (&"oracle".into(), &"paper".into()));
        assert!(out.join(row["file"].as_str().unwrap()).is_file());
    }
    let first = &read_json(&out.join("results.json"))[0];
    assert!(first["fps"]["total"].as_f64().unwrap() > 0.0 && first["fps"]["without_segmenter"].is_f64());
    assert_eq!(read_json(&out.join("failures.json")), Value::Array(Vec::new()));
    let csv = fs::read_to_string(out.join("results.csv")).unwrap();
    assert_eq!(csv.lines().count(), 9);
    assert!(csv.starts_with("scene,method,variant,seed,segmenter,protocol,vsq_1,"));
    let last_columns = ",frames_boundary_f,frames_over_segmentation,frames_under_segmentation,frames_segments";
    assert!(csv.lines().next().unwrap().ends_with(last_columns));
    assert!(csv.contains(",parameters,small_objects,small_aq,"));
    // The only other commas are in quoted scene names.
    let columns = |line: &str| line.split('"').step_by(2).map(|part| part.matches(',').count()).sum::<usize>();
    assert!(csv.lines().all(|line| columns(line) == columns(csv.lines().next().unwrap())));
    let tables = fs::read_to_string(out.join("tables.md")).unwrap();
    for protocol in ["paper", "strict"] {
        assert!(tables.contains(&format!("## By size of the object, protocol {protocol}\n")));
    }
    assert!(tables.contains("| method | size | objects | AQ | found | ids per object | main id |"));
    assert_eq!(tables.matches("| fastsam-splat | small (under 400 px) | ").count(), 2);
    assert!(tables.contains("| method | k=1 | k=5 | k=10 | k=15 | VSQ | STQ | AQ | SQ |"));
    assert!(tables.contains("*FastSAM-Splat (paper, ScanNet-MV: other data)*") && tables.contains(" ± "));
}

/// Asserts that both protocols have the same objects, and that AQ is the mean over all of them.
fn check_sizes(row: &Value) {
    const CLASSES: [&str; 3] = ["small", "medium", "large"];
    for scores in [row, &row["strict"]] {
        let (mut sum, mut objects) = (0.0, 0.0);
        for class in CLASSES {
            let sizes = &scores["by_size"][class];
            assert_eq!(sizes["objects"], row["by_size"][class]["objects"]);
            if sizes["objects"] == 0 {
                assert!(sizes["aq"].is_null());
                continue;
            }
            let count = sizes["objects"].as_f64().unwrap();
            sum += sizes["aq"].as_f64().unwrap() * count;
            objects += count;
            assert!(sizes["found"].is_f64() && sizes["main_id"].is_f64(), "{sizes}");
            assert!(sizes["found"] == 0.0 || sizes["ids_per_object"].as_f64().unwrap() >= 1.0, "{sizes}");
        }
        assert!((sum / objects - scores["aq"].as_f64().unwrap()).abs() < 1e-9, "{scores}");
    }
}

#[test]
fn a_broken_scene_is_listed_and_the_others_are_measured() {
    let folder = tempfile::tempdir().unwrap();
    let broken = folder.path().join("broken");
    fs::create_dir(&broken).unwrap();
    let out = folder.path().join("out");
    let ended = bench(&[broken.to_str().unwrap(), ROOM], &out, &[]);
    assert_eq!(ended.code, 1, "{}", ended.err);
    assert!(ended.err.contains("2 of 4 results are missing") && ended.err.contains("broken"), "{}", ended.err);
    let failures = read_json(&out.join("failures.json"));
    assert_eq!(failures.as_array().unwrap().len(), 2);
    assert_eq!(failures[0]["scene"], "broken");
    assert!(failures[0]["error"].as_str().unwrap().contains("broken"));
    assert_eq!(timeless_rows(&out).len(), 2);
    assert!(fs::read_to_string(out.join("tables.md")).unwrap().contains("(1 of 2 results)"));
    assert!(fs::read_to_string(out.join("report.html")).unwrap().contains("2 results are missing"));

    let ended = bench(&[broken.to_str().unwrap()], &folder.path().join("none"), &[]);
    assert_eq!(ended.code, 2, "{}", ended.err);
}

#[test]
fn ablated_settings_have_their_own_rows() {
    let folder = tempfile::tempdir().unwrap();
    let ablated = [&FEATURES[..], &["--ablate", "memory.num_steps=0,20"]].concat();
    let ended = bench(&[OTHER_ROOM], folder.path(), &ablated);
    assert_eq!(ended.code, 0, "{}", ended.err);
    let rows = timeless_rows(folder.path());
    let variants: Vec<&Value> = rows.iter().map(|row| &row["variant"]).collect();
    // The baseline has no memory, so it has one row.
    let expected = [Value::Null, Value::Null, "memory.num_steps=0".into(), "memory.num_steps=20".into()];
    assert_eq!(variants, expected.iter().collect::<Vec<_>>());
    // 20 is the default: the same settings are measured once.
    assert_eq!(rows[1]["file"], rows[3]["file"]);
    assert_ne!(rows[1]["file"], rows[2]["file"]);
    for wrong in ["memory.num_steps", "memory.num_steps=", "memory.nothing=1", "seed=1,2"] {
        let ended = bench(&[OTHER_ROOM], folder.path(), &["--ablate", wrong]);
        assert_eq!((ended.code, ended.err.lines().count()), (2, 1), "{wrong}: {}", ended.err);
    }
}

#[test]
fn a_tracker_that_no_scene_can_use_is_rejected_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let of_sim = ["reprompt.clicks=0", "max_detection_iou=2", "sim_tracker.swap_rate=2"];
    let of_sim = of_sim.map(|wrong| (vec!["--tracker", "sim", "--set", wrong], wrong.split('=').next().unwrap()));
    for (arguments, named) in of_sim.into_iter().chain([(Vec::new(), "--tracker-weights")]) {
        let arguments = [vec!["--methods", "sam2-splat"], arguments].concat();
        let ended = bench(&[OTHER_ROOM], folder.path(), &arguments);
        assert_eq!((ended.code, ended.err.lines().count()), (2, 1), "{arguments:?}: {}", ended.err);
        assert!(ended.err.contains(named), "{}", ended.err);
    }
}

#[test]
fn folders_with_other_files_are_left_alone() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("thesis.tex"), "mine").unwrap();
    let ended = bench(&[OTHER_ROOM], folder.path(), &[]);
    assert_eq!((ended.code, ended.err.lines().count()), (2, 1), "{}", ended.err);
    assert_eq!(bench(&[OTHER_ROOM], folder.path(), &["--overwrite"]).code, 0);
    assert_eq!(fs::read_to_string(folder.path().join("thesis.tex")).unwrap(), "mine");
}

/// Copies the first frames of the demo's scene with their ground truth, and writes masks for them.
fn copied_scene(folder: &Path) -> (PathBuf, PathBuf) {
    let (scene, masks) = (folder.join("scene"), folder.join("masks"));
    copy_demo_clip(&[&CLIP_PARTS[..], &["instance-filt"]].concat(), 3, &scene);
    copy_demo_clip(&["instance-filt"], 3, folder);
    fs::rename(folder.join("instance-filt"), &masks).unwrap();
    (scene, masks)
}

/// Changes the last byte of a file, but neither its size nor its modification time.
fn change_secretly(path: &Path) {
    let modified = fs::metadata(path).unwrap().modified().unwrap();
    let mut bytes = fs::read(path).unwrap();
    *bytes.last_mut().unwrap() ^= 1;
    fs::write(path, bytes).unwrap();
    fs::File::options().append(true).open(path).unwrap().set_modified(modified).unwrap();
}

#[test]
fn results_are_measured_again_when_an_input_has_changed() {
    let folder = tempfile::tempdir().unwrap();
    let (scene, masks) = copied_scene(folder.path());
    let out = folder.path().join("out");
    let bench = || {
        let mut command = splatseg();
        command.arg("bench").arg("--scenes").arg(&scene).args(["--methods", "fastsam", "--segmenter", "masks"]);
        command.arg("--masks").arg(&masks).args(["--resize", "80x60", "--threads", "1", "--out"]).arg(&out);
        let ended = finish(&mut command);
        assert_eq!(ended.code, 0, "{}", ended.err);
        ended.out
    };
    let first = bench();
    assert!(first.contains("of 1 result, 0 reused, 1 measured\n"), "{first}");
    let second = bench();
    assert!(second.contains("of 1 result, 1 reused, 0 measured\n"), "{second}");
    // The last byte is in the checksum of the PNG's end chunk, so no pixel changes.
    for changed in [masks.join("1.png"), scene.join("instance-filt/2.png")] {
        change_secretly(&changed);
        let input = changed.parent().unwrap().strip_prefix(folder.path()).unwrap().iter().next().unwrap();
        let again = bench();
        assert!(again.contains(&format!("{} has changed", folder.path().join(input).display())), "{again}");
        assert!(again.contains("of 1 result, 0 reused, 1 measured, 1 of them again"), "{again}");
        assert!(bench().contains(": reused"));
    }
    // A file with a different time but the same content is the same input.
    let pose = scene.join("pose/0.txt");
    fs::File::options().append(true).open(&pose).unwrap().set_modified(SystemTime::UNIX_EPOCH).unwrap();
    assert!(bench().contains(": reused"));
}

#[test]
fn only_what_an_earlier_benchmark_wrote_is_replaced() {
    let folder = tempfile::tempdir().unwrap();
    let mine = folder.path().join("tables.md");
    fs::write(&mine, "mine").unwrap();
    for options in [&[][..], &["--overwrite"]] {
        let ended = bench(&[OTHER_ROOM], folder.path(), options);
        assert_eq!((ended.code, ended.err.lines().count()), (2, 1), "{}", ended.err);
        assert_eq!(fs::read_to_string(&mine).unwrap(), "mine");
    }
    assert!(bench(&[OTHER_ROOM], folder.path(), &["--overwrite"]).err.contains("tables.md: is in the way"));
    fs::remove_file(&mine).unwrap();
    assert_eq!(bench(&[OTHER_ROOM], folder.path(), &[]).code, 0);
    assert_eq!(bench(&[OTHER_ROOM], folder.path(), &["--overwrite"]).code, 0);
    assert!(fs::read_to_string(&mine).unwrap().contains("fastsam-splat"));

    let out = folder.path().join("run");
    assert_eq!(finish(splatseg().args(["run", OTHER_ROOM, "--max-frames", "1", "--out"]).arg(&out)).code, 0);
    let ended = bench(&[OTHER_ROOM], &out, &["--overwrite"]);
    assert!(ended.code == 2 && ended.err.contains("has the results of a run"), "{}", ended.err);
    assert!(out.join("summary.json").exists() && !out.join("results").exists());
}

#[cfg(unix)]
#[test]
fn scenes_whose_paths_are_not_utf8_are_measured_and_scored() {
    use std::os::unix::ffi::OsStrExt;
    let folder = tempfile::tempdir().unwrap();
    let (scene, _) = copied_scene(folder.path());
    let renamed = folder.path().join(std::ffi::OsStr::from_bytes(b"scene-\xff"));
    fs::rename(&scene, &renamed).unwrap();
    let out = folder.path().join("bench");
    let bench = || {
        let mut command = splatseg();
        command.arg("bench").arg("--scenes").arg(&renamed).args(["--methods", "fastsam", "--resize", "80x60"]);
        finish(command.arg("--out").arg(&out))
    };
    assert_eq!(bench().code, 0);
    assert!(bench().out.contains("of 1 result, 1 reused"));
    let run = folder.path().join("run");
    assert_eq!(finish(splatseg().arg("run").arg(&renamed).args(["--resize", "80x60", "--out"]).arg(&run)).code, 0);
    let ended = finish(splatseg().arg("eval").arg("--gt").arg(&renamed).arg("--pred").arg(&run));
    assert_eq!(ended.code, 0, "{}", ended.err);
}

#[test]
fn results_of_another_build_are_measured_again() {
    let folder = tempfile::tempdir().unwrap();
    assert_eq!(bench(&[OTHER_ROOM], folder.path(), &[]).code, 0);
    let name = saved(folder.path()).into_keys().next().unwrap();
    let path = folder.path().join("results").join(name);
    let mut result = read_json(&path);
    result["program"] = "0123".into();
    fs::write(&path, result.to_string()).unwrap();
    let ended = bench(&[OTHER_ROOM], folder.path(), &[]);
    assert!(ended.out.contains("measured again: it was measured by another build"), "{}", ended.out);
    let summary = "of 2 results, 1 reused, 1 measured, 1 of them again";
    assert!(ended.out.contains(summary), "{}", ended.out);
}

#[test]
fn numbers_of_seeds_and_jobs_have_a_range() {
    let folder = tempfile::tempdir().unwrap();
    for (options, expected) in [
        (["--seeds", "1000000000"], "1000000000 is not in 1..=1000"),
        (["--seeds", "18446744073709551616"], "--seeds"),
        (["--seeds", "0"], "0 is not in 1..=1000"),
        (["--jobs", "1000000000"], "1000000000 is not in 1..=256"),
    ] {
        let ended = bench(&[OTHER_ROOM], folder.path(), &options);
        assert_eq!(ended.code, 2, "{options:?}: {}", ended.err);
        assert!(ended.err.contains(expected), "{options:?}: {}", ended.err);
    }
    let ended = bench(&[OTHER_ROOM], folder.path(), &["--seed", "9223372036854775807", "--seeds", "2"]);
    assert_eq!((ended.code, ended.err.lines().count()), (2, 1), "{}", ended.err);
    assert!(ended.err.contains("the last is beyond 9223372036854775807"), "{}", ended.err);
    let many: Vec<String> = (1..=60).map(|value| format!("{value}")).collect();
    let many = format!("memory.max_votes={}", many.join(","));
    let ended = bench(&[OTHER_ROOM], folder.path(), &["--seeds", "1000", "--ablate", &many]);
    assert_eq!((ended.code, ended.err.lines().count()), (2, 1), "{}", ended.err);
    assert!(ended.err.contains("come to 62000 results, expected at most 50000"), "{}", ended.err);
}

#[test]
fn options_that_no_method_uses_are_errors_that_name_their_requirement() {
    let folder = tempfile::tempdir().unwrap();
    for (options, expected) in [
        (
            ["--weights", "x.pt"],
            "weights is not used here: it needs segmenter = affinity or fastsam, but segmenter is oracle",
        ),
        (["--prompts", "ground-truth"], "prompts is not used here: it needs method = sam2 or sam2-splat"),
        (["--scannet", "x"], "--scannet is not used here: it needs --preset paper"),
        (["--weights-dir", "x"], "--weights-dir is not used here: it needs --preset paper"),
        (["--preset", "paper"], "--methods is not used here: the paper's tables define the methods"),
    ] {
        let ended = bench(&[OTHER_ROOM], &folder.path().join("out"), &options);
        assert_eq!((ended.code, ended.err.lines().count()), (2, 1), "{options:?}: {}", ended.err);
        assert!(ended.err.contains(expected), "{options:?}: {}", ended.err);
    }
}
