//! `splatseg batch`: many scenes, resumable and independent of killed workers.

#![cfg(unix)]

use crate::support::{Ended, finish, read_json, splatseg, stoppable_splatseg};
use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::record::RowAccessor;
use serde_json::Value;
use splatseg_test_scenes::file_contents;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

fn scene(seed: usize) -> String {
    format!("synthetic:frames=8,seed={seed},width=64,height=48,objects=5")
}

fn batch(scenes: &[String], out: &Path, more: &[&str]) -> Ended {
    finish(
        splatseg()
            .arg("batch")
            .args(scenes)
            .arg("--out")
            .arg(out)
            .args(["--no-page", "--protocol", "strict"])
            .args(more),
    )
}

/// Returns the result files of all scenes, except files that contain times.
fn result_files(out: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let has_times = |path: &Path| ["summary.json", "manifest.jsonl"].iter().any(|name| path.ends_with(name));
    let files = file_contents(&out.join("scenes")).into_iter().filter(|(path, _)| !has_times(path));
    files.map(|(path, bytes)| (Path::new("scenes").join(path), bytes)).collect()
}

/// Returns scene, frames and STQ of each row.
fn rows(out: &Path) -> Vec<(String, i64, f64)> {
    let file = SerializedFileReader::new(fs::File::open(out.join("results.parquet")).unwrap()).unwrap();
    let names: Vec<String> =
        file.metadata().file_metadata().schema().get_fields().iter().map(|field| field.name().to_owned()).collect();
    let place = |name: &str| names.iter().position(|found| found == name).unwrap();
    let row = |row: parquet::record::Row| {
        let scene = row.get_string(place("scene")).unwrap().clone();
        (scene, row.get_long(place("frames")).unwrap(), row.get_double(place("stq")).unwrap())
    };
    file.get_row_iter(None).unwrap().map(|found| row(found.unwrap())).collect()
}

#[test]
fn every_scene_has_the_results_of_its_run() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("batch");
    let list = folder.path().join("scenes.txt");
    fs::write(&list, format!("{}\n\n  nowhere\n{}\n", scene(2), scene(3))).unwrap();
    let given = [scene(1), list.to_str().unwrap().to_owned()];
    let ended = batch(&given, &out, &["--jobs", "2"]);
    assert_eq!(ended.code, 1, "{}", ended.err);
    assert!(ended.err.contains("1 scene failed"), "{}", ended.err);
    assert_eq!(
        fs::read_to_string(out.join("failed.csv")).unwrap(),
        "scene,error\n\"nowhere\",\"nowhere: does not exist\"\n"
    );

    let mut stq = Vec::new();
    for seed in 1..=3 {
        let alone = folder.path().join(format!("run-{seed}"));
        let ended = finish(splatseg().args(["run", &scene(seed), "--no-page", "--out"]).arg(&alone));
        assert_eq!(ended.code, 0, "{}", ended.err);
        let name = scene(seed).replace([':', ','], "_");
        for (path, bytes) in
            result_files(&out).iter().filter(|(path, _)| path.starts_with(Path::new("scenes").join(&name)))
        {
            let path = path.strip_prefix(Path::new("scenes").join(&name)).unwrap();
            assert!(fs::read(alone.join(path)).unwrap() == *bytes, "{} differs", path.display());
        }
        let json = folder.path().join(format!("{seed}.json"));
        let mut eval = splatseg();
        eval.args(["eval", "--gt", &scene(seed), "--protocol", "strict", "--pred"])
            .arg(&alone)
            .arg("--json")
            .arg(&json);
        assert_eq!(finish(&mut eval).code, 0);
        stq.push(read_json(&json)["stq"].as_f64().unwrap());
    }
    let expected: Vec<(String, i64, f64)> = (1..=3).map(|seed| (scene(seed), 8, stq[seed - 1])).collect();
    assert_eq!(rows(&out), expected);
    let scores = read_json(&out.join("scores.json"));
    assert_eq!((&scores["videos"], &scores["protocol"]), (&Value::from(3), &Value::from("strict")));
    let (least, most) = stq.iter().fold((f64::MAX, f64::MIN), |(least, most), stq| (least.min(*stq), most.max(*stq)));
    let total = scores["stq"].as_f64().unwrap();
    assert!(least <= total && total <= most, "{total} of {stq:?}");
}

#[test]
fn finished_scenes_are_skipped() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("batch");
    assert_eq!(batch(&[scene(1), scene(2)], &out, &[]).code, 0);
    let written = |seed: usize| {
        let summary = out.join("scenes").join(scene(seed).replace([':', ','], "_")).join("summary.json");
        fs::metadata(summary).unwrap().modified().unwrap()
    };
    let before = [written(1), written(2)];
    // A missing or damaged row is measured again, the other is not.
    fs::write(out.join("rows").join(scene(2).replace([':', ','], "_") + ".json"), "{").unwrap();
    let ended = batch(&[scene(1), scene(2), scene(3)], &out, &["--jobs", "1", "--threads", "1"]);
    assert_eq!(ended.code, 0, "{}", ended.err);
    assert!(ended.err.contains("3 scenes, 1 done before"), "{}", ended.err);
    assert_eq!(written(1), before[0]);
    assert!(written(2) > before[1]);
    assert_eq!(rows(&out).len(), 3);
    // Results with other settings must not be mixed in.
    let ended = batch(&[scene(1)], &out, &["--seed", "5"]);
    assert!(ended.code == 2 && ended.err.contains("with other settings"), "{}", ended.err);
    let ended = batch(&[scene(1)], &out, &["--seed", "5", "--overwrite"]);
    assert_eq!((ended.code, rows(&out).len()), (0, 1), "{}", ended.err);
}

/// Returns the child processes of a process.
fn children(parent: u32) -> Vec<u32> {
    let found = Command::new("pgrep").args(["-P", &parent.to_string()]).output().unwrap();
    String::from_utf8(found.stdout).unwrap().lines().map(|line| line.parse().unwrap()).collect()
}

#[test]
fn a_worker_that_is_killed_is_replaced() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("batch");
    let scenes: Vec<String> = (1..=6).map(scene).collect();
    let mut command = stoppable_splatseg();
    command.arg("batch").args(&scenes).arg("--out").arg(&out).args([
        "--no-page",
        "--jobs",
        "2",
        "--protocol",
        "strict",
    ]);
    let mut process = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    let rows_so_far = || fs::read_dir(out.join("rows")).map_or(0, Iterator::count);
    let started = Instant::now();
    while rows_so_far() == 0 {
        assert!(started.elapsed() < Duration::from_secs(60));
        std::thread::sleep(Duration::from_millis(2));
    }
    let victim = children(process.id())[0];
    assert!(Command::new("kill").args(["-KILL", &victim.to_string()]).status().unwrap().success());
    assert!(process.wait().unwrap().success());
    assert_eq!(rows(&out).len(), 6);

    let undisturbed = folder.path().join("undisturbed");
    assert_eq!(batch(&scenes, &undisturbed, &["--jobs", "1"]).code, 0);
    assert!(result_files(&out) == result_files(&undisturbed), "results differ");
}

#[test]
fn ctrl_c_ends_a_batch_and_the_same_command_resumes_it() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("batch");
    let scenes = [scene(1), scene(2).replace("frames=8", "frames=3000")];
    let mut command = stoppable_splatseg();
    command.arg("batch").args(&scenes).arg("--out").arg(&out).args([
        "--no-page",
        "--jobs",
        "1",
        "--protocol",
        "strict",
    ]);
    let process = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    let started = Instant::now();
    while fs::read_dir(out.join("rows")).map_or(0, Iterator::count) == 0 {
        assert!(started.elapsed() < Duration::from_secs(60));
        std::thread::sleep(Duration::from_millis(2));
    }
    let workers = children(process.id());
    assert!(Command::new("kill").args(["-INT", &process.id().to_string()]).status().unwrap().success());
    let ended = process.wait_with_output().unwrap();
    let message = String::from_utf8(ended.stderr).unwrap();
    assert_eq!(ended.status.code(), Some(130), "{message}");
    assert!(message.contains("interrupted by SIGINT after 1 of 2 scenes"), "{message}");
    assert!(workers.iter().all(|worker| !Path::new(&format!("/proc/{worker}/stat")).exists()), "workers live on");
    let ended = batch(&scenes[..1], &out, &[]);
    assert!(ended.code == 0 && ended.err.contains("1 scene, 1 done before"), "{}", ended.err);
}

#[test]
fn wrong_usage_is_reported_before_anything_starts() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("batch");
    fs::write(folder.path().join("empty.txt"), "\n").unwrap();
    let taken = folder.path().join("taken");
    fs::create_dir(&taken).unwrap();
    fs::write(taken.join("thesis.tex"), "").unwrap();
    let empty = folder.path().join("empty.txt").to_str().unwrap().to_owned();
    for (scenes, out, more, expected) in [
        (vec![empty], &out, &[][..], "the lists contain no scene"),
        (vec!["missing.txt".to_owned()], &out, &[], "missing.txt: "),
        (vec![scene(1)], &taken, &[], "is not empty and has no batch.json"),
        (vec![scene(1), scene(1)], &out, &[], "would both write their results to"),
        (vec![scene(1)], &out, &["--seed", "x"], "seed is"),
        (vec![scene(1)], &out, &["--ray", "auto"], "--ray needs the Python package"),
    ] {
        let ended = batch(&scenes, out, more);
        assert_eq!((ended.code, ended.err.lines().count()), (2, 1), "{expected}: {}", ended.err);
        assert!(ended.err.contains(expected), "{expected}: {}", ended.err);
    }
    assert!(taken.join("thesis.tex").exists() && fs::read_dir(&taken).unwrap().count() == 1);
}
