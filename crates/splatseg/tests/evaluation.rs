//! `splatseg eval`: the same scores for the same predictions in any form, and clear errors for wrong ones.

mod support;

use serde_json::{Value, json};
use splatseg_dataset::{Scene, SyntheticScene};
use splatseg_geometry::{Mask, RunLengths, SegmentId, SegmentMap};
use splatseg_output::write_segments_png;
use std::fs;
use std::path::{Path, PathBuf};
use support::{Ended, ROOM, finish, read_json, splatseg};
use tempfile::TempDir;

fn eval(prediction: &Path, more: &[&str]) -> Ended {
    finish(splatseg().args(["eval", "--gt", ROOM, "--pred"]).arg(prediction).args(more))
}

/// Scores with `--json`, which must succeed.
fn scores(prediction: &Path, more: &[&str]) -> Value {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("scores.json");
    let ended = eval(prediction, &[&["--json", file.to_str().unwrap()], more].concat());
    assert_eq!(ended.code, 0, "{}", ended.err);
    read_json(&file)
}

/// The true segments of every frame, by name.
fn truth() -> Vec<(String, SegmentMap)> {
    let scene = SyntheticScene::new(ROOM.parse().unwrap()).unwrap();
    (0..scene.frame_count())
        .map(|index| (scene.frame_name(index), scene.read_ground_truth(index).unwrap().unwrap()))
        .collect()
}

/// The truth, as a folder of id images.
fn perfect_images() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    for (name, map) in truth() {
        write_segments_png(&folder.path().join(format!("{name}.png")), &map).unwrap();
    }
    folder
}

fn rle(mask: &Mask) -> Value {
    let runs = RunLengths::encode(mask);
    json!({"size": [runs.height, runs.width], "counts": runs.to_compressed()})
}

fn uncompressed(mask: &Mask) -> Value {
    let runs = RunLengths::encode(mask);
    json!({"size": [runs.height, runs.width], "counts": runs.counts})
}

fn all_ids(truth: &[(String, SegmentMap)]) -> Vec<SegmentId> {
    let mut ids: Vec<SegmentId> = truth.iter().flat_map(|(_, map)| map.areas().into_keys()).collect();
    ids.sort_unstable();
    ids.dedup();
    ids
}

/// The truth in the form of YouTube-VIS results.
fn tracks() -> Vec<Value> {
    let truth = truth();
    let segmentations = |id: SegmentId| -> Vec<Value> {
        let mask = |map: &SegmentMap| Some(map.mask_of(id)).filter(|mask| !mask.is_empty());
        truth.iter().map(|(_, map)| mask(map).map_or(Value::Null, |mask| rle(&mask))).collect()
    };
    all_ids(&truth)
        .into_iter()
        .map(|id| json!({"video_id": 1, "category_id": 1, "score": 0.9, "segmentations": segmentations(id)}))
        .collect()
}

fn written(folder: &TempDir, document: &Value) -> PathBuf {
    let path = folder.path().join("predictions.json");
    fs::write(&path, document.to_string()).unwrap();
    path
}

#[test]
fn a_perfect_prediction_scores_100_in_every_form() {
    let (images, folder) = (perfect_images(), tempfile::tempdir().unwrap());
    let strict = ["--protocol", "strict"];
    let expected = scores(images.path(), &strict);
    for key in ["vsq", "stq", "aq", "sq"] {
        assert_eq!(expected[key], json!(100.0), "{key}");
    }
    assert_eq!(expected["vsq_k"], json!({"1": 100.0, "5": 100.0, "10": 100.0, "15": 100.0}));
    assert_eq!((&expected["protocol"], &expected["frames"]), (&json!("strict"), &json!(18)));

    let printed = eval(images.path(), &strict).out;
    assert!(printed.contains("ids per object") && printed.contains("small (under 400 px)"), "{printed}");
    let small = &expected["by_size"]["small"];
    assert_eq!(
        (&small["aq"], &small["ids_per_object"], &small["main_id"]),
        (&json!(100.0), &json!(1.0), &json!(100.0))
    );

    let list = Value::Array(tracks());
    let masks: Vec<Value> = truth()
        .iter()
        .flat_map(|(name, map)| {
            let masks = Mask::of_segments(map).into_iter();
            let image = format!("color/{name}.jpg");
            masks.map(move |(id, mask)| json!({"file_name": image, "id": id, "segmentation": uncompressed(&mask)}))
        })
        .collect();
    for document in [list, json!({"annotations": masks})] {
        let found = scores(&written(&folder, &document), &strict);
        assert_eq!((&found["vsq"], &found["stq"]), (&json!(100.0), &json!(100.0)));
    }
    let paper = scores(images.path(), &[]);
    assert_eq!((&paper["protocol"], &paper["vsq"], &paper["aq"]), (&json!("paper"), &json!(100.0), &json!(100.0)));
}

#[test]
fn the_results_of_a_run_are_scored_with_the_settings_of_its_scene() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let mut run = splatseg();
    run.args(["run", ROOM, "--resize", "32x24", "--crop-border", "2", "--stride", "2", "--out"]).arg(&out);
    run.args(["--segmenter", "oracle"]);
    assert_eq!(finish(&mut run).code, 0);
    let found = scores(&out, &["--protocol", "strict"]);
    assert_eq!(found["frames"], json!(9));
    assert!(found["stq"].as_f64().unwrap() > 50.0, "{found}");
    let ended = eval(&out, &["--stride", "1"]);
    assert_eq!(ended.code, 2);
    assert!(ended.err.contains("9 frames without prediction: "), "{}", ended.err);
}

#[test]
fn missing_frames_are_named_or_scored_as_empty() {
    let images = perfect_images();
    let names: Vec<String> = truth().into_iter().map(|(name, _)| name).collect();
    for name in &names[3..10] {
        fs::remove_file(images.path().join(format!("{name}.png"))).unwrap();
    }
    let ended = eval(images.path(), &[]);
    assert_eq!((ended.code, ended.err.lines().count()), (2, 1), "{}", ended.err);
    let listed = names[3..8].join(", ");
    assert!(ended.err.contains(&format!("7 frames without prediction: {listed} and 2 more")), "{}", ended.err);
    let found = scores(images.path(), &["--allow-missing", "--protocol", "strict"]);
    assert_eq!((&found["missing_predictions"], &found["frames"]), (&json!(7), &json!(18)));
    assert!(found["stq"].as_f64().unwrap() < 90.0, "{found}");

    let strange = perfect_images();
    write_segments_png(&strange.path().join("elsewhere.png"), &truth()[0].1).unwrap();
    let ended = eval(strange.path(), &[]);
    assert_eq!(ended.code, 2);
    assert!(ended.err.contains("1 frame predicted that the scene does not have: elsewhere"), "{}", ended.err);
    assert_eq!(scores(strange.path(), &["--allow-missing"])["unknown_predictions"], json!(1));
}

#[test]
fn masks_may_overlap_and_are_penalised_for_it() {
    let folder = tempfile::tempdir().unwrap();
    let mut list = tracks();
    let everything = vec![rle(&Mask::from_fn(64, 48, |_, _| true)); 18];
    list.push(json!({"segmentations": everything}));
    let path = written(&folder, &Value::Array(list));
    let found = scores(&path, &["--protocol", "strict"]);
    let vsq = found["vsq"].as_f64().unwrap();
    assert!(vsq > 50.0 && vsq < 100.0, "{found}");
    let without_ids = scores(&path, &["--no-ids"]);
    assert_eq!(without_ids["ids"], json!(false));
}

#[test]
fn damaged_files_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let good = rle(&Mask::from_fn(64, 48, |column, _| column < 9));
    let name = &truth()[0].0;
    let one = |segmentation: Value| json!([{"frame": name, "id": 1, "segmentation": segmentation}]);
    let lying = json!({"size": [48_000_000, 64_000_000], "counts": [5]});
    let cases = [
        (json!({"images": []}), "expected a list of annotations"),
        (json!([{"id": 1}]), "annotation 0: expected the key segmentation"),
        (json!([3]), "annotation 0: expected an object"),
        (json!([{"segmentations": 5}]), "annotation 0: expected an object, in which segmentations"),
        (json!({"frames": 3, "annotations": []}), "key frames: expected a list of names"),
        (json!({"images": [{"id": 3}], "annotations": []}), "key images: expected a list of objects"),
        (one(json!({"size": [48, 64], "counts": [-5]})), "counts: expected whole numbers from 0 to 4294967295"),
        (json!([{"id": 1, "segmentation": good}]), "expected the key frame"),
        (json!([{"frame": name, "id": 0, "segmentation": good}]), "id: found 0"),
        (one(json!([[1, 2, 3, 4]])), "polygons are not supported"),
        (one(json!({"size": [48, 64], "counts": "\u{1}"})), "damaged at character 0"),
        (one(json!({"size": [48, 64], "counts": [7]})), "add up to 7 pixels"),
        (one(lying), "48000000 pixels, expected 64x48"),
        (json!([{"segmentations": vec![Value::Null; 19]}]), "19 masks, expected at most 18"),
        (json!([{"segmentations": [], "video_id": 1}, {"segmentations": [], "video_id": 2}]), "another video"),
    ];
    for (document, expected) in cases {
        let ended = eval(&written(&folder, &document), &["--allow-missing"]);
        assert_eq!((ended.code, ended.err.lines().count()), (2, 1), "{document}: {}", ended.err);
        assert!(ended.err.contains(expected), "{document}: {}", ended.err);
        for word in ["struct", "u32", "usize", "sequence"] {
            assert!(!ended.err.contains(word), "{word}: {}", ended.err);
        }
    }
    let path = folder.path().join("cut.json");
    fs::write(&path, "[{\"segmentations\": [").unwrap();
    assert!(eval(&path, &[]).err.contains("cut.json: is not JSON"));
    let images = perfect_images();
    fs::write(images.path().join(format!("{name}.png")), b"no image").unwrap();
    let ended = eval(images.path(), &[]);
    assert_eq!(ended.code, 2);
    assert!(ended.err.contains(name), "{}", ended.err);
}

#[test]
fn other_bad_usage_is_an_error_and_nothing_is_overwritten() {
    let images = perfect_images();
    let file = images.path().join("scores.json");
    fs::write(&file, "mine").unwrap();
    let ended = eval(images.path(), &["--json", file.to_str().unwrap()]);
    assert_eq!(ended.code, 2);
    assert!(ended.err.contains("give --overwrite"), "{}", ended.err);
    assert_eq!(fs::read_to_string(&file).unwrap(), "mine");
    assert_eq!(eval(images.path(), &["--json", file.to_str().unwrap(), "--overwrite"]).code, 0);
    let small = tempfile::tempdir().unwrap();
    for (name, _) in truth() {
        write_segments_png(&small.path().join(format!("{name}.png")), &SegmentMap::filled(9, 9, 1)).unwrap();
    }
    let ended = eval(small.path(), &[]);
    assert!(ended.code == 2 && ended.err.contains("9x9 pixels, expected 64x48"), "{}", ended.err);
    assert_eq!(eval(Path::new("/nowhere"), &[]).code, 2);
}

#[test]
fn predictions_stay_within_the_memory_limit() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("masks.json");
    fs::write(&path, format!("[{}[]]", "[],".repeat(400_000))).unwrap();
    let ended = eval(&path, &["--memory-limit", "32MB"]);
    assert_eq!((ended.code, ended.err.lines().count()), (2, 1), "{}", ended.err);
    assert!(
        ended.err.contains("masks.json: takes up to") && ended.err.contains("32 MB are available"),
        "{}",
        ended.err
    );
    let ended = eval(&path, &["--memory-limit", "much"]);
    assert!(ended.code == 2 && ended.err.contains("memory_limit"), "{}", ended.err);
}

#[test]
fn masks_that_are_handed_in_three_times_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let path = written(&folder, &Value::Array([tracks(), tracks(), tracks()].concat()));
    let found = scores(&path, &[]);
    let aq = found["aq"].as_f64().unwrap();
    assert!((aq - 300.0).abs() < 1e-9, "{found}");
    assert_eq!(found["overcounted_tracks"], found["counts"]["stq"]["tracks"]);
    let ended = eval(&path, &[]);
    assert!(ended.err.starts_with("warning: AQ and STQ count some pixels more than once"), "{}", ended.err);
    assert!(ended.out.contains(" 300.00†") && ended.out.contains("\n† overlapping masks cover "), "{}", ended.out);

    let strict = ["--protocol", "strict"];
    assert_eq!(scores(&path, &strict)["overcounted_tracks"], json!(0));
    let ended = eval(&path, &strict);
    assert!(ended.err.is_empty() && !ended.out.contains('†'), "{}{}", ended.out, ended.err);
    let once = eval(&written(&folder, &Value::Array(tracks())), &[]);
    assert!(once.err.is_empty() && !once.out.contains('†'), "{}{}", once.out, once.err);
}

#[test]
fn videos_that_are_too_short_for_a_window_are_told() {
    let images = perfect_images();
    let printed = |more: &[&str]| eval(images.path(), more).out;
    let paper = "no window of 1, 5, 10, 15 frames in a video of 10: under the protocol paper a video needs 16 frames";
    assert!(printed(&["--max-frames", "10"]).contains(paper), "{}", printed(&["--max-frames", "10"]));
    let strict = printed(&["--max-frames", "10", "--protocol", "strict"]);
    assert!(strict.contains("no window of 15 frames in a video of 10: a video needs as many frames"), "{strict}");
    assert!(!printed(&[]).contains("no window"));
}

#[test]
fn results_of_another_scene_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let other = ROOM.replace("objects=6", "objects=5");
    let mut run = splatseg();
    assert_eq!(finish(run.args(["run", &other, "--segmenter", "oracle", "--out"]).arg(&out)).code, 0);
    for predictions in [out.clone(), out.join("segments")] {
        let ended = eval(&predictions, &[]);
        assert_eq!((ended.code, ended.err.lines().count()), (2, 1), "{}", ended.err);
        let expected = format!("summary.json: the predictions are of the scene {other}, not of {ROOM}");
        assert!(ended.err.contains(&expected) && ended.err.contains("--allow-other-scene"), "{}", ended.err);
        assert_eq!(eval(&predictions, &["--allow-other-scene"]).code, 0);
    }
    let mut same = splatseg();
    assert_eq!(finish(same.args(["eval", "--gt", &other, "--pred"]).arg(&out)).code, 0);
}

#[cfg(unix)]
#[test]
fn files_of_gigabytes_and_special_files_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let huge = folder.path().join("huge.json");
    // Sparse: takes no room on the disk.
    fs::File::create(&huge).unwrap().set_len(3_000_000_000).unwrap();
    assert!(eval(&huge, &[]).err.contains("at most 1000000000 are read"));
    assert!(eval(Path::new("/dev/zero"), &[]).err.contains("/dev/zero: it is a device, expected a regular file"));
    let run = folder.path().join("run");
    fs::create_dir_all(run.join("segments")).unwrap();
    fs::File::create(run.join("summary.json")).unwrap().set_len(3_000_000_000).unwrap();
    assert!(eval(&run, &[]).err.contains("at most 16000000 are read"));
}
