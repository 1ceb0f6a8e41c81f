//! `splatseg eval`: the same scores for the same predictions in any form, and clear errors for invalid ones.

use crate::support::{CLIP_PARTS, Ended, ROOM, finish, read_json, splatseg};
use serde_json::{Value, json};
use splatseg_annotations::write_segments_png;
use splatseg_geometry::{Mask, RunLengths, SegmentId, SegmentMap};
use splatseg_test_scenes::{copy_demo_clip, recording, room};
use std::fs;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

fn eval(prediction: &Path, more: &[&str]) -> Ended {
    finish(splatseg().args(["eval", "--gt", ROOM, "--pred"]).arg(prediction).args(more))
}

/// Scores a prediction with `--json`. The command must succeed.
fn scores(prediction: &Path, more: &[&str]) -> Value {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("scores.json");
    let ended = eval(prediction, &[&["--json", file.to_str().unwrap()], more].concat());
    assert_eq!(ended.code, 0, "{}", ended.err);
    read_json(&file)
}

/// Returns the name and true segments of every frame.
fn truth() -> Vec<(String, SegmentMap)> {
    recording(ROOM).into_iter().map(|(frame, truth)| (frame.name().to_owned(), truth)).collect()
}

/// Writes the truth as a folder of id images.
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

/// Returns the truth as tracks of YouTube-VIS results.
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

/// The paths in a summary are relative to its folder, so that it can be read from elsewhere, and moved with its scene.
#[test]
fn results_are_scored_from_any_folder_and_after_a_move() {
    let folder = tempfile::tempdir().unwrap();
    let [work, moved] = ["work", "moved"].map(|name| folder.path().join(name));
    fs::create_dir(&work).unwrap();
    let absolute = work.join("scenes/kitchen");
    copy_demo_clip(&[&CLIP_PARTS[..], &["instance-filt"]].concat(), 16, &absolute);
    let run = |scene: &str, out: &str| {
        let mut run = splatseg();
        run.current_dir(&work).args(["run", scene, "--out", out, "--resize", "96x72", "--segmenter", "oracle"]);
        let ended = finish(&mut run);
        assert_eq!(ended.code, 0, "{}", ended.err);
        read_json(&work.join(out).join("summary.json"))
    };
    let summary = run("scenes/kitchen", "results/relative");
    assert_eq!(summary["scene"], "../../scenes/kitchen");
    assert_eq!(summary["paths"], "relative to this file");
    let summary = run(absolute.to_str().unwrap(), "results/absolute");
    assert_eq!(summary["scene"], absolute.to_str().unwrap());

    let scored = |predictions: &Path| {
        let ended = finish(splatseg().arg("eval").arg("--pred").arg(predictions).arg("--json"));
        assert_eq!(ended.code, 0, "{}", ended.err);
        let found: Value = serde_json::from_str(&ended.out).unwrap();
        assert_eq!(found["frames"], json!(16));
        found["vsq"].clone()
    };
    let score = scored(&work.join("results/relative"));
    assert_eq!(scored(&work.join("results/absolute/segments")), score);
    fs::rename(&work, &moved).unwrap();
    assert_eq!(scored(&moved.join("results/relative")), score);
    let lost = finish(splatseg().arg("eval").arg("--pred").arg(moved.join("results/absolute")));
    assert_eq!((lost.code, lost.err.lines().count()), (2, 1), "{}", lost.err);
    assert!(lost.err.contains(absolute.to_str().unwrap()), "{}", lost.err);
    let none = finish(splatseg().arg("eval").arg("--pred").arg(moved.join("scenes")));
    assert!(none.code == 2 && none.err.contains("give the scene with --gt"), "{}", none.err);
}

/// Files named in settings, too.
#[test]
fn settings_of_a_moved_run_find_their_files() {
    let folder = tempfile::tempdir().unwrap();
    let [work, moved] = ["work", "moved"].map(|name| folder.path().join(name));
    let small = "synthetic:frames=2,width=64,height=48,objects=3";
    let run = |here: &Path, more: &[&str]| {
        let ended = finish(splatseg().current_dir(here).args(["run", small]).args(more));
        assert_eq!(ended.code, 0, "{}", ended.err);
    };
    fs::create_dir(&work).unwrap();
    run(&work, &["--out", "first", "--segmenter", "oracle"]);
    run(&work, &["--out", "second", "--segmenter", "masks", "--masks", "first/segments"]);
    assert_eq!(read_json(&work.join("second/summary.json"))["settings"]["masks"], "../first/segments");
    fs::rename(&work, &moved).unwrap();
    run(folder.path(), &["--out", "third", "--config", "moved/second/summary.json"]);
    assert_eq!(read_json(&folder.path().join("third/summary.json"))["settings"]["masks"], "../moved/first/segments");
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
    assert!(ended.err.contains("1 frame predicted but not in the scene: elsewhere"), "{}", ended.err);
    assert_eq!(scores(strange.path(), &["--allow-missing"])["unknown_predictions"], json!(1));
}

/// Writes an RGB image of ids, R + 256 G + 65536 B.
fn write_panoptic(path: &Path, map: &SegmentMap) {
    let image = image::RgbImage::from_fn(map.width() as u32, map.height() as u32, |x, y| {
        let [red, green, blue, _] = map[(x as usize, y as usize)].to_le_bytes();
        image::Rgb([red, green, blue])
    });
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    image.save(path).unwrap();
}

#[test]
fn tracks_of_one_video_are_taken_from_the_results_of_many() {
    let folder = tempfile::tempdir().unwrap();
    let wrong = |video: Value| json!({"video_id": video, "segmentations": [rle(&Mask::from_fn(64, 48, |_, _| true))]});
    let list = [vec![wrong(json!(7))], tracks(), vec![wrong(json!("other"))]].concat();
    let path = written(&folder, &Value::Array(list.clone()));
    let strict = ["--protocol", "strict"];
    let ended = eval(&path, &strict);
    assert_eq!((ended.code, ended.err.lines().count()), (2, 1), "{}", ended.err);
    assert!(ended.err.contains("has several videos (7, 1, other): choose one with --video"), "{}", ended.err);
    let found = scores(&path, &["--protocol", "strict", "--video", "1"]);
    assert_eq!((&found["vsq"], &found["stq"]), (&json!(100.0), &json!(100.0)));
    let ended = eval(&path, &["--video", "3"]);
    assert!(ended.code == 2 && ended.err.contains("has no video 3; its first videos are 7, 1, other"), "{}", ended.err);

    // By name: from a list of videos as in the YouTube-VIS data sets, or the scene's name if entries are named.
    let videos = json!([{"id": 7, "file_names": ["one/0.jpg"]}, {"id": 1, "file_names": ["two/0.jpg", "two/1.jpg"]}]);
    let document = json!({"videos": videos, "annotations": list});
    let path = written(&folder, &document);
    assert_eq!(scores(&path, &["--protocol", "strict", "--video", "two"])["vsq"], json!(100.0));
    let mut named = tracks();
    let name = room(ROOM).name().to_owned();
    named.iter_mut().for_each(|track| track["video_id"] = name.clone().into());
    named.push(wrong(json!("other")));
    assert_eq!(scores(&written(&folder, &Value::Array(named)), &strict)["vsq"], json!(100.0));

    // Tracks with low scores are left out.
    let mut unsure = tracks();
    unsure.push(
        json!({"video_id": 1, "score": 0.2, "segmentations": vec![rle(&Mask::from_fn(64, 48, |_, _| true)); 18]}),
    );
    let path = written(&folder, &Value::Array(unsure));
    assert!(scores(&path, &strict)["vsq"].as_f64().unwrap() < 100.0);
    assert_eq!(scores(&path, &["--protocol", "strict", "--min-score", "0.5"])["vsq"], json!(100.0));
}

#[test]
fn panoptic_images_are_scored_with_and_without_their_list_of_segments() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path();
    // Ids of three bytes, in a folder named after the video.
    let far = |map: &SegmentMap| map.map(|id| if *id == 0 { 0 } else { id + 70_000 });
    for (name, map) in truth() {
        write_panoptic(&root.join("pan_pred/video-3").join(format!("{name}.png")), &far(&map));
    }
    let strict = ["--protocol", "strict"];
    for prediction in [root.join("pan_pred/video-3"), root.to_owned()] {
        let more: &[&str] = if prediction == root { &["--video", "video-3"] } else { &[] };
        let found = scores(&prediction, &[&strict[..], more].concat());
        assert_eq!((&found["vsq"], &found["stq"]), (&json!(100.0), &json!(100.0)));
    }
    let ended = eval(root, &["--video", "video-4"]);
    assert!(ended.code == 2 && ended.err.contains("has no folder video-4"), "{}", ended.err);

    // With the list of segments of each image, for all videos of a data set.
    let frame = |(name, map): &(String, SegmentMap)| {
        let infos: Vec<Value> =
            map.areas().into_keys().map(|id| json!({"id": id + 70_000, "category_id": 1, "score": 0.9})).collect();
        json!({"file_name": format!("{name}.png"), "image_id": name, "segments_info": infos})
    };
    let frames: Vec<Value> = truth().iter().map(frame).collect();
    let video = |name: &str, frames: &[Value]| json!({"video_id": name, "annotations": frames});
    let document = json!({"annotations": [video("video-1", &[]), video("video-3", &frames)]});
    let file = root.join("pred.json");
    let write = |document: &Value| fs::write(&file, document.to_string()).unwrap();
    // If the first video has no frames, the format is recognised from the second.
    write(&json!({"annotations": [video("video-3", &frames), video("video-1", &[])]}));
    let chosen = ["--protocol", "strict", "--video", "video-3"];
    assert_eq!(scores(&file, &chosen)["stq"], json!(100.0));
    write(&document);
    assert_eq!(scores(&file, &chosen)["stq"], json!(100.0));
    write(&json!({"annotations": frames}));
    assert_eq!(scores(&file, &chosen)["stq"], json!(100.0));
    // Segments with low scores are left out.
    let mut unsure = frames.clone();
    for frame in &mut unsure {
        frame["segments_info"][0]["score"] = json!(0.1);
    }
    write(&json!({"annotations": unsure}));
    assert_eq!(scores(&file, &chosen)["stq"], json!(100.0));
    assert!(scores(&file, &[&chosen[..], &["--min-score", "0.5"]].concat())["stq"].as_f64().unwrap() < 100.0);

    let broken = |change: &dyn Fn(&mut Value)| {
        let mut document = json!({"annotations": frames});
        change(&mut document["annotations"][0]);
        write(&document);
        let ended = eval(&file, &chosen);
        assert_eq!((ended.code, ended.err.lines().count()), (2, 1), "{}", ended.err);
        ended.err
    };
    let error = broken(&|frame| frame["segments_info"][0]["id"] = json!(5));
    assert!(error.contains("expected one of the segments_info of the image"), "{error}");
    let error = broken(&|frame| frame["segments_info"][1] = frame["segments_info"][0].clone());
    assert!(error.contains("segments_info lists the id") && error.contains("twice"), "{error}");
    let error = broken(&|frame| frame["file_name"] = json!("nowhere.png"));
    assert!(error.contains("nowhere.png: not found beside the file, nor in pred/ or pan_pred/"), "{error}");
    let error = broken(&|frame| frame["file_name"] = json!("../pan_pred/video-3/0.png"));
    assert!(error.contains("leads out of the folder"), "{error}");
    let error = broken(&|frame| frame["segments_info"][0]["id"] = json!("chair"));
    assert!(error.contains("annotation 0: "), "{error}");
}

#[test]
fn photos_are_not_id_images() {
    let folder = perfect_images();
    let name = &truth()[0].0;
    let picture = SegmentMap::from_fn(64, 96, |column, row| 1 + (column + 64 * row) as u32);
    write_panoptic(&folder.path().join(format!("{name}.png")), &picture);
    let ended = eval(folder.path(), &[]);
    assert_eq!((ended.code, ended.err.lines().count()), (2, 1), "{}", ended.err);
    assert!(ended.err.contains("has 6144 ids, expected at most 4096: is it an id image?"), "{}", ended.err);
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
        (json!([{"segmentations": 5}]), "annotation 0: expected an object; segmentations, if present"),
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
        (
            json!([{"segmentations": [], "video_id": 1}, {"segmentations": [], "video_id": 2}]),
            "has several videos (1, 2)",
        ),
        (json!([{"segmentations": [], "score": "sure"}]), "annotation 0: score: found \"sure\", expected a number"),
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
    let replace = ["--json", file.to_str().unwrap(), "--overwrite"];
    let ended = eval(images.path(), &replace);
    assert!(ended.code == 2 && ended.err.contains("is not a file of scores by `splatseg eval`"), "{}", ended.err);
    assert_eq!(fs::read_to_string(&file).unwrap(), "mine");
    fs::remove_file(&file).unwrap();
    for _ in 0..2 {
        assert_eq!(eval(images.path(), &replace).code, 0);
    }
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
fn masks_that_are_submitted_three_times_are_reported() {
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
fn videos_that_are_too_short_for_a_window_are_reported() {
    let images = perfect_images();
    let printed = |more: &[&str]| eval(images.path(), more).out;
    let paper = "no window of 1, 5, 10, 15 frames in a video of 10: under the protocol paper a video needs 16 frames";
    assert!(printed(&["--max-frames", "10"]).contains(paper), "{}", printed(&["--max-frames", "10"]));
    let strict = printed(&["--max-frames", "10", "--protocol", "strict"]);
    assert!(strict.contains("no window of 15 frames in a video of 10: the video is too short"), "{strict}");
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
    // A sparse file takes no disk space.
    fs::File::create(&huge).unwrap().set_len(3_000_000_000).unwrap();
    assert!(eval(&huge, &[]).err.contains("at most 1000000000 are read"));
    assert!(eval(Path::new("/dev/zero"), &[]).err.contains("/dev/zero: it is a device, expected a regular file"));
    let run = folder.path().join("run");
    fs::create_dir_all(run.join("segments")).unwrap();
    fs::File::create(run.join("summary.json")).unwrap().set_len(3_000_000_000).unwrap();
    assert!(eval(&run, &[]).err.contains("at most 16000000 are read"));
}
