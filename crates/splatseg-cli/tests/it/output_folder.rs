//! The files that a run writes, replaces and keeps.

use crate::support::{Ended, file_names, finish, numbered_scene, read_json, result_files, splatseg};
use splatseg_annotations::write_segments_png;
use splatseg_dataset::read_segments_png;
use splatseg_geometry::SegmentMap;
use std::fs;
use std::path::Path;

const ROOM: &str = "synthetic:frames=3,width=64,height=48,objects=5";
const OTHER_ROOM: &str = "synthetic:frames=2,width=64,height=48,objects=5,seed=2";

/// Runs on a scene with further options.
fn run(scene: &str, out: &Path, more: &[&str]) -> Ended {
    finish(splatseg().args(["run", scene, "--out"]).arg(out).args(more))
}

/// Returns every file under a folder, with its content.
fn contents(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let mut found = Vec::new();
    for name in file_names(folder) {
        let path = folder.join(&name);
        if path.is_dir() {
            found.extend(contents(&path).into_iter().map(|(inner, bytes)| (format!("{name}/{inner}"), bytes)));
        } else {
            found.push((name, fs::read(path).unwrap()));
        }
    }
    found
}

#[test]
fn a_run_without_overlays_writes_everything_else() {
    let folder = tempfile::tempdir().unwrap();
    let [with, without] = ["with", "without"].map(|name| folder.path().join(name));
    assert_eq!(run(ROOM, &with, &[]).code, 0);
    assert_eq!(run(ROOM, &without, &["--no-overlay"]).code, 0);
    let files = |out: &Path| {
        let mut files = contents(out);
        files.retain(|(name, _)| !["summary.json", "manifest.jsonl"].contains(&name.as_str()));
        files
    };
    let (mut expected, found) = (files(&with), files(&without));
    assert_eq!(expected.iter().filter(|(name, _)| name.starts_with("overlay/")).count(), 3);
    expected.retain(|(name, _)| !name.starts_with("overlay/"));
    assert!(found == expected);
    let listed = fs::read_to_string(without.join("manifest.jsonl")).unwrap();
    assert!(!listed.contains("overlay/"), "{listed}");

    let recording = folder.path().join("out.mcap");
    for option in [&["--no-overlay"][..], &["--set", "overlay=false"]] {
        let saving = ["--overwrite", "--save-mcap", recording.to_str().unwrap()];
        let ended = run(ROOM, &without, &[option, &saving].concat());
        assert!(ended.code == 2 && ended.err.contains("--no-overlay"), "{}", ended.err);
    }
}

#[test]
fn overwrite_removes_what_the_manifest_lists_and_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    assert_eq!(run(ROOM, &out, &[]).code, 0);
    let manifest = fs::read_to_string(out.join("manifest.jsonl")).unwrap();
    let listed: Vec<String> =
        manifest.lines().skip(1).map(|line| serde_json::from_str::<String>(line).unwrap()).collect();
    let mut written: Vec<String> = contents(&out).into_iter().map(|(name, _)| name).collect();
    written.retain(|name| name != "manifest.jsonl");
    written.sort();
    assert_eq!(
        {
            let mut sorted = listed.clone();
            sorted.sort();
            sorted
        },
        written
    );

    let mine = ["segments/mine.png", "overlay/mine.jpg", "notes.txt", "segments/000009.png"];
    mine.iter().for_each(|name| fs::write(out.join(name), name).unwrap());
    assert_eq!(run(OTHER_ROOM, &out, &["--overwrite"]).code, 0);
    mine.iter().for_each(|name| assert_eq!(fs::read(out.join(name)).unwrap(), name.as_bytes(), "{name}"));
    let frames = ["000009.png", "frame-000000.png", "frame-000001.png", "mine.png"];
    assert_eq!(file_names(&out.join("segments")), frames);
    assert_eq!(read_json(&out.join("summary.json"))["frames"], 2);
}

#[test]
fn results_that_no_manifest_lists_are_not_replaced() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    assert_eq!(run(ROOM, &out, &["--no-page"]).code, 0);
    // As written by 0.1.0, which had no manifest.
    fs::remove_file(out.join("manifest.jsonl")).unwrap();
    let before = contents(&out);
    let ended = run(ROOM, &out, &["--overwrite"]);
    assert_eq!(ended.code, 2, "{}", ended.err);
    assert!(ended.err.contains("objects.csv: is in the way"), "{}", ended.err);
    assert_eq!(contents(&out), before);
    // 0.1.0 had no list of objects either.
    fs::remove_dir_all(out.join("objects")).unwrap();
    ["objects.csv", "objects.json", "poses.txt"].iter().for_each(|name| fs::remove_file(out.join(name)).unwrap());
    let ended = run(ROOM, &out, &["--overwrite"]);
    assert!(ended.err.contains("frame-000000.jpg: is in the way"), "{}", ended.err);
    fs::remove_dir_all(out.join("overlay")).unwrap();
    fs::remove_dir_all(out.join("segments")).unwrap();
    let ended = run(ROOM, &out, &["--overwrite"]);
    assert!(ended.code == 2 && ended.err.contains("summary.json: is in the way"), "{}", ended.err);
}

#[test]
fn old_results_stay_until_a_frame_has_new_ones() {
    let folder = tempfile::tempdir().unwrap();
    let scene = numbered_scene(folder.path(), 2);
    let out = folder.path().join("out");
    assert_eq!(run(ROOM, &out, &[]).code, 0);
    let before = contents(&out);
    for frame in 0..2 {
        fs::write(scene.join(format!("depth/{frame}.png")), b"no image").unwrap();
    }
    let ended = run(scene.to_str().unwrap(), &out, &["--overwrite"]);
    assert_eq!(ended.code, 2, "{}", ended.err);
    assert_eq!(contents(&out), before);
}

#[test]
fn a_failed_run_leaves_nothing_that_prevents_the_next() {
    let folder = tempfile::tempdir().unwrap();
    let scene = numbered_scene(folder.path(), 2);
    let out = folder.path().join("new/out");
    let memory = folder.path().join("maps/memory.ply");
    let options = ["--save-memory", memory.to_str().unwrap()];
    let depth: Vec<Vec<u8>> = (0..2).map(|frame| fs::read(scene.join(format!("depth/{frame}.png"))).unwrap()).collect();
    (0..2).for_each(|frame| fs::write(scene.join(format!("depth/{frame}.png")), b"no image").unwrap());
    assert_eq!(run(scene.to_str().unwrap(), &out, &options).code, 2);
    assert_eq!(file_names(folder.path()), ["scene"]);
    // Leftovers of a run that was killed before its first frame.
    fs::create_dir_all(out.join(".splatseg-new/segments")).unwrap();
    fs::write(out.join(".splatseg-new/segments/000000.png"), b"half").unwrap();
    (0..2).for_each(|frame| fs::write(scene.join(format!("depth/{frame}.png")), &depth[frame]).unwrap());
    let ended = run(scene.to_str().unwrap(), &out, &options);
    assert_eq!(ended.code, 0, "{}", ended.err);
    assert_eq!(file_names(&out), result_files(&[]));
    assert!(memory.is_file());
}

#[test]
fn a_failed_demo_leaves_nothing_that_prevents_the_next() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("demo");
    fs::create_dir_all(out.join("memory.ply")).unwrap();
    let demo = |options: &[&str]| finish(splatseg().args(["demo", "--frames", "1", "--out"]).arg(&out).args(options));
    assert_eq!(demo(&["--overwrite"]).code, 2);
    assert_eq!(file_names(&out), ["memory.ply"]);
    fs::remove_dir(out.join("memory.ply")).unwrap();
    assert_eq!(demo(&[]).code, 0);
    // The demo's clip does not replace other files either.
    fs::write(out.join("scene/pose/0.txt"), b"mine").unwrap();
    let ended = demo(&["--overwrite"]);
    assert!(ended.code == 2 && ended.err.contains("scene/pose/0.txt: is not a demo file"), "{}", ended.err);
    assert_eq!(fs::read(out.join("scene/pose/0.txt")).unwrap(), b"mine");
}

#[test]
fn outputs_inside_or_above_an_input_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let scene = numbered_scene(folder.path(), 2);
    let masks = folder.path().join("results/segments");
    fs::create_dir_all(&masks).unwrap();
    for frame in 0..2 {
        write_segments_png(&masks.join(format!("{frame}.png")), &SegmentMap::filled(320, 240, 1)).unwrap();
    }
    let config = folder.path().join("exp/settings.toml");
    fs::create_dir(folder.path().join("exp")).unwrap();
    fs::write(&config, "seed = 1\n").unwrap();
    #[cfg(unix)]
    std::os::unix::fs::symlink("results", folder.path().join("link")).unwrap();
    let before = contents(folder.path());
    let masks = ["--segmenter", "masks", "--masks", masks.to_str().unwrap()];
    let config = ["--config", config.to_str().unwrap()];
    let cases: [(&str, &[&str], &str); 6] = [
        ("scene", &[], "is the scene"),
        ("scene/color/new/out", &[], "is inside the scene"),
        (".", &[], "contains the scene"),
        ("results", &masks, "contains the folder of --masks"),
        ("link", &masks, "contains the folder of --masks"),
        ("exp", &config, "contains the file of --config"),
    ];
    for (out, options, expected) in cases {
        let options = [options, &["--overwrite"]].concat();
        let ended = run(scene.to_str().unwrap(), &folder.path().join(out), &options);
        assert_eq!(ended.code, 2, "{out}: {}", ended.err);
        assert!(ended.err.contains(expected), "{out}: {}", ended.err);
    }
    assert_eq!(contents(folder.path()), before);
}

#[cfg(unix)]
#[test]
fn links_that_lead_out_of_the_folder_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let (out, elsewhere) = (folder.path().join("out"), folder.path().join("elsewhere"));
    fs::create_dir_all(&out).unwrap();
    fs::create_dir_all(&elsewhere).unwrap();
    fs::write(elsewhere.join("frame-000000.png"), b"mine").unwrap();
    fs::write(out.join("manifest.jsonl"), "{\"splatseg\":\"0.1.0\"}\n\"segments/frame-000000.png\"\n").unwrap();
    std::os::unix::fs::symlink(&elsewhere, out.join("segments")).unwrap();
    let ended = run(ROOM, &out, &["--overwrite"]);
    assert_eq!(ended.code, 2, "{}", ended.err);
    assert!(ended.err.contains("segments: is a symbolic link"), "{}", ended.err);
    assert_eq!(contents(&elsewhere), [("frame-000000.png".to_owned(), b"mine".to_vec())]);
    // A link in place of a result is removed; its target stays.
    fs::remove_file(out.join("segments")).unwrap();
    fs::create_dir(out.join("segments")).unwrap();
    std::os::unix::fs::symlink(elsewhere.join("frame-000000.png"), out.join("segments/frame-000000.png")).unwrap();
    assert_eq!(run(ROOM, &out, &["--overwrite"]).code, 0);
    assert_eq!(fs::read(elsewhere.join("frame-000000.png")).unwrap(), b"mine");
}

#[test]
fn numbered_frames_are_padded_and_sort_by_number() {
    let folder = tempfile::tempdir().unwrap();
    let scene = numbered_scene(folder.path(), 12);
    let scene = scene.to_str().unwrap();
    let out = folder.path().join("out");
    assert_eq!(run(scene, &out, &["--start", "8", "--resize", "64x48"]).code, 0);
    assert_eq!(file_names(&out.join("segments")), ["000008.png", "000009.png", "000010.png", "000011.png"]);
    assert_eq!(file_names(&out.join("overlay")), ["000008.jpg", "000009.jpg", "000010.jpg", "000011.jpg"]);
    // They can be used as masks for the same frames.
    let masks = out.join("segments");
    let options = ["--start", "8", "--resize", "64x48", "--segmenter", "masks", "--masks", masks.to_str().unwrap()];
    let again = folder.path().join("again");
    let ended = run(scene, &again, &options);
    assert_eq!((ended.code, read_json(&again.join("summary.json"))["skipped_frames"].as_u64()), (0, Some(0)));
    read_segments_png(&again.join("segments/000010.png")).unwrap();
}

#[test]
fn predictions_are_found_with_and_without_zeros_in_front() {
    let folder = tempfile::tempdir().unwrap();
    let demo = concat!(env!("CARGO_MANIFEST_DIR"), "/demo");
    let out = folder.path().join("out");
    assert_eq!(run(demo, &out, &["--max-frames", "3"]).code, 0);
    let eval = |pred: &Path| finish(splatseg().args(["eval", "--gt", demo, "--max-frames", "3", "--pred"]).arg(pred));
    let padded = eval(&out);
    assert_eq!(padded.code, 0, "{}", padded.err);
    let unpadded = folder.path().join("unpadded");
    fs::create_dir(&unpadded).unwrap();
    for frame in 0..3 {
        fs::copy(out.join(format!("segments/00000{frame}.png")), unpadded.join(format!("{frame}.png"))).unwrap();
    }
    assert_eq!(eval(&unpadded).out, padded.out);
    assert!(padded.out.contains("3 frames, "), "{}", padded.out);
}

/// Makes a video from overlays with the command of docs/RUNNING.md.
#[test]
fn ffmpeg_makes_a_video_of_the_overlays() {
    let folder = tempfile::tempdir().unwrap();
    let scene = numbered_scene(folder.path(), 12);
    // The sides are odd, which the pixel format of most players does not allow.
    assert_eq!(run(scene.to_str().unwrap(), &folder.path().join("out"), &["--resize", "65x49"]).code, 0);
    let arguments = "-loglevel error -framerate 15 -pattern_type glob -i out/overlay/*.jpg \
                     -vf pad=ceil(iw/2)*2:ceil(ih/2)*2 -pix_fmt yuv420p out.mp4";
    let mut ffmpeg = std::process::Command::new("ffmpeg");
    let Ok(output) = ffmpeg.args(arguments.split_whitespace()).current_dir(folder.path()).output() else {
        return splatseg_test_scenes::skipped("ffmpeg_makes_a_video_of_the_overlays", "there is no ffmpeg");
    };
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let mut ffprobe = std::process::Command::new("ffprobe");
    ffprobe
        .args("-v error -count_frames -show_entries stream=nb_read_frames,width,height -of csv=p=0 out.mp4".split(' '));
    let output = ffprobe.current_dir(folder.path()).output().unwrap();
    assert_eq!(String::from_utf8_lossy(&output.stdout).trim(), "66,50,12");
}
