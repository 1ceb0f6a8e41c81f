//! Depth predicted from colour: what is checked before the first frame, and the whole chain from a plain video.

use crate::support::depth_network::write_depth_network;
use crate::support::{Ended, FASTSAM_WEIGHTS, ROOM, finish, read_json, splatseg};
use serde_json::Value;
use splatseg_test_scenes::copy_demo_clip;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

const FRAMES: usize = 5;

/// Writes a folder of images without depth.
fn images(folder: &Path) -> PathBuf {
    copy_demo_clip(&["color"], FRAMES, &folder.join("clip"));
    folder.join("clip/color")
}

fn recording() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../dataset/tests/data/mcap/room.mcap")
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// Runs a command of splatseg.
fn command(name: &str, arguments: &[&str]) -> Ended {
    finish(splatseg().arg(name).args(arguments))
}

/// Every file in a folder, by name, without those that contain times or paths.
fn files(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(inner) = folders.pop() {
        for entry in fs::read_dir(inner).unwrap() {
            let path = entry.unwrap().path();
            let name = path.strip_prefix(folder).unwrap().to_owned();
            match path.is_dir() {
                true => folders.push(path),
                false if name == Path::new("summary.json") => {}
                false => _ = found.insert(name, fs::read(path).unwrap()),
            }
        }
    }
    found
}

/// Checks the results of a run on colour alone.
fn assert_complete(out: &Path) {
    let summary = read_json(&out.join("summary.json"));
    assert_eq!((&summary["frames"], &summary["scale"]), (&FRAMES.into(), &Value::from("guessed")), "{summary:#}");
    assert_eq!(summary["settings"]["predicted_depth"], "all");
    assert_eq!(summary["guessed_camera"]["fx"].as_f64().unwrap().round(), 277.0);
    let objects = read_json(&out.join("objects.json"));
    assert!(!objects["objects"].as_array().unwrap().is_empty(), "{objects:#}");
    assert_eq!(fs::read_dir(out.join("segments")).unwrap().count(), FRAMES);
    let poses = fs::read_to_string(out.join("poses.txt")).unwrap();
    assert_eq!(poses.lines().filter(|line| !line.starts_with('#')).count(), FRAMES, "{poses}");
}

#[test]
fn a_folder_of_images_becomes_the_same_objects_twice_and_with_any_number_of_threads() {
    let folder = tempfile::tempdir().unwrap();
    let (images, network) = (images(folder.path()), write_depth_network(folder.path()));
    let run = |name: &str, threads: &str| {
        let out = folder.path().join(name);
        let ended = command(
            "run",
            &[text(&images), "--depth-weights", text(&network), "--threads", threads, "--out", text(&out)],
        );
        assert_eq!(ended.code, 0, "{}", ended.err);
        let told = "60 degrees across the long side: a focal length of 277 pixels, 229 to 343";
        assert!(ended.err.contains(told) && ended.err.contains("--fx"), "the guessed camera is told: {}", ended.err);
        out
    };
    let first = run("first", "2");
    assert_complete(&first);
    let expected = files(&first);
    assert!(expected.len() > FRAMES);
    for (name, threads) in [("second", "2"), ("third", "1")] {
        assert!(files(&run(name, threads)) == expected, "{name}");
    }
}

/// Writes a program in place of ffmpeg, which copies images and notes that it was called. Returns the value of `PATH`.
#[cfg(unix)]
fn ffmpeg_stand_in(folder: &Path, images: &Path) -> String {
    use std::os::unix::fs::PermissionsExt;
    let bin = folder.join("bin");
    fs::create_dir(&bin).unwrap();
    let script = format!(
        "#!/bin/sh\nfor last; do true; done\necho called >> '{0}/calls'\nn=0\nfor image in '{1}'/*.jpg; do\n\
         cp \"$image\" \"${{last%/*}}/00000$n.jpg\"\n\
         echo \"[Parsed_showinfo_1 @ 0x5] n:   $n pts:   $n pts_time:0.$n   duration: 1\" >&2\nn=$((n+1))\ndone\n",
        folder.display(),
        images.display()
    );
    fs::write(bin.join("ffmpeg"), script).unwrap();
    fs::set_permissions(bin.join("ffmpeg"), fs::Permissions::from_mode(0o755)).unwrap();
    format!("{}:/usr/bin:/bin", bin.display())
}

#[cfg(unix)]
#[test]
fn a_video_is_decoded_only_if_the_network_can_be_used() {
    let folder = tempfile::tempdir().unwrap();
    let (images, network) = (images(folder.path()), write_depth_network(folder.path()));
    let (video, out) = (folder.path().join("walk.mp4"), folder.path().join("out"));
    fs::write(&video, b"\0\0\0\x20ftypisom").unwrap();
    let path = ffmpeg_stand_in(folder.path(), &images);
    let run =
        |more: &[&str]| finish(splatseg().arg("run").arg(&video).arg("--out").arg(&out).args(more).env("PATH", &path));
    for (more, expected) in [
        (vec![], "--depth-weights"),
        (vec!["--depth-weights", "nothing.pth"], "nothing.pth"),
        (vec!["--depth-weights", FASTSAM_WEIGHTS], "fastsam_rooms_n"),
    ] {
        assert_refused(&run(&more), expected);
        assert!(!out.exists() && !folder.path().join("calls").exists(), "{more:?}");
    }
    let ended = run(&["--depth-weights", text(&network), "--threads", "2"]);
    assert_eq!(ended.code, 0, "{}", ended.err);
    assert_complete(&out);
}

/// With the real `ffmpeg`, if it is installed.
#[test]
fn a_real_video_becomes_objects() {
    let folder = tempfile::tempdir().unwrap();
    let (images, network) = (images(folder.path()), write_depth_network(folder.path()));
    let video = folder.path().join("walk.mp4");
    let mut encode = std::process::Command::new("ffmpeg");
    encode.args(["-v", "error", "-framerate", "5", "-i"]).arg(images.join("%d.jpg")).arg(&video);
    match encode.status() {
        Ok(status) if status.success() => {}
        other => {
            println!("skipped: no ffmpeg that encodes a video: {other:?}");
            return;
        }
    }
    let out = folder.path().join("out");
    let ended = command("run", &[text(&video), "--depth-weights", text(&network), "--out", text(&out)]);
    assert_eq!(ended.code, 0, "{}", ended.err);
    assert_complete(&out);
}

/// Checks that a command was refused in one line.
#[track_caller]
fn assert_refused(ended: &Ended, expected: &str) {
    let errors: Vec<&str> = ended.err.lines().filter(|line| line.starts_with("error: ")).collect();
    assert_eq!((ended.code, errors.len(), ended.err.lines().count()), (2, 1, 1), "{}", ended.err);
    assert!(errors[0].contains(expected), "{expected}: {}", errors[0]);
}

#[test]
fn a_wrong_network_is_told_before_anything_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let (out, notes) = (folder.path().join("out"), folder.path().join("notes.pth"));
    fs::write(&notes, "no checkpoint").unwrap();
    let (out_text, recording) = (text(&out), recording());
    let commands: [&[&str]; 4] = [
        &["run", ROOM, "--out", out_text],
        &["batch", ROOM, "--out", out_text],
        &["bench", "--scenes", ROOM, "--methods", "fastsam-splat", "--out", out_text],
        &["live", text(&recording), "--world-frame", "map", "--map", out_text],
    ];
    for arguments in commands {
        for weights in ["nothing.pth", text(&notes), FASTSAM_WEIGHTS] {
            let ended = finish(splatseg().args(arguments).args(["--depth-weights", weights]));
            assert_refused(&ended, weights);
            assert!(!out.exists(), "{arguments:?} {weights}");
        }
    }
}

#[test]
fn a_true_depth_that_does_not_fit_is_told_before_the_first_frame() {
    let folder = tempfile::tempdir().unwrap();
    let (out, images) = (folder.path().join("out"), images(folder.path()));
    let out_text = text(&out);
    let commands: [&[&str]; 2] = [
        &["run", ROOM, "--out", out_text],
        &["bench", "--scenes", ROOM, "--methods", "fastsam-splat", "--out", out_text],
    ];
    for arguments in commands {
        for (scene, expected) in [
            ("nothing", "nothing"),
            ("synthetic:frames=9,width=64,height=48,objects=6", "has no frame"),
            ("synthetic:frames=18,width=32,height=24,objects=6", "32x24 pixels, expected the frame's 64x48"),
            (text(&images), "has no depth"),
        ] {
            let mut command = splatseg();
            command.args(arguments).args(["--set", "depth_predictor=sim", "--set", &format!("true_depth={scene}")]);
            assert_refused(&finish(&mut command), expected);
            assert!(!out.exists(), "{arguments:?} {scene}");
        }
    }
    let without_truth = ["run", text(&images), "--out", out_text, "--fx", "70", "--set", "depth_predictor=sim"];
    assert_refused(&finish(splatseg().args(without_truth)), "has no depth that could be distorted; true_depth names");
    assert!(!out.exists());
    let first_frames = ["--set", "depth_predictor=sim", "--max-frames", "9", "--set"];
    let truth = "true_depth=synthetic:frames=9,width=64,height=48,objects=6";
    let ended = finish(splatseg().args(commands[0]).args(first_frames).arg(truth));
    assert_eq!(ended.code, 0, "{}", ended.err);
}

#[test]
fn every_command_that_runs_frames_predicts_depth() {
    let folder = tempfile::tempdir().unwrap();
    let (images, network) = (images(folder.path()), write_depth_network(folder.path()));
    let weights = ["--depth-weights", text(&network)];
    let [run, batch, bench] = ["run", "batch", "bench"].map(|name| folder.path().join(name));
    let ended = finish(splatseg().args(["run", text(&images), "--out", text(&run), "--threads", "2"]).args(weights));
    assert_eq!(ended.code, 0, "{}", ended.err);
    let ended =
        finish(splatseg().args(["batch", text(&images), "--out", text(&batch), "--threads", "2"]).args(weights));
    assert_eq!(ended.code, 0, "{}", ended.err);
    let of_batch = batch.join("scenes/color");
    assert_complete(&of_batch);
    for file in ["poses.txt", "objects.csv", "segments/000004.png"] {
        assert!(fs::read(run.join(file)).unwrap() == fs::read(of_batch.join(file)).unwrap(), "{file}");
    }
    // The map is another one than with measured depth, so the scores are, too.
    let score = |more: &[&str]| {
        let mut command = splatseg();
        command.args(["bench", "--scenes", ROOM, "--methods", "fastsam-splat", "--set", "online=true"]);
        let ended = finish(command.args(["--threads", "2", "--overwrite", "--out"]).arg(&bench).args(more));
        assert_eq!(ended.code, 0, "{}", ended.err);
        let results = read_json(&bench.join("results.json"));
        results[0].clone()
    };
    let predicted = score(&[weights.as_slice(), &["--predicted-depth", "all"]].concat());
    assert_ne!(predicted["gaussians"], score(&[])["gaussians"], "{predicted:#}");
}

#[test]
fn a_stream_of_colour_alone_gives_the_map_of_a_run() {
    let folder = tempfile::tempdir().unwrap();
    let network = write_depth_network(folder.path());
    let [color, of_stream, of_run, out] =
        ["color.mcap", "stream.ply", "run.ply", "out"].map(|name| folder.path().join(name));
    let common = ["--depth-weights", text(&network), "--world-frame", "map", "--threads", "2"];
    // A recording of what is used is one without depth.
    let mut command = splatseg();
    command.arg("live").arg(recording()).args(["--every-frame", "--depth", "none", "--record"]).arg(&color);
    let ended = finish(command.args(common));
    assert_eq!(ended.code, 0, "{}", ended.err);
    assert!(ended.out.contains("4 frames, "), "{}", ended.out);
    let ended =
        finish(splatseg().arg("live").arg(&color).args(["--every-frame", "--map"]).arg(&of_stream).args(common));
    assert_eq!(ended.code, 0, "{}", ended.err);
    assert!(ended.out.contains("4 frames, ") && ended.err.contains("depth: none"), "{} {}", ended.out, ended.err);
    let mut command = splatseg();
    command.arg("run").arg(&color).args(["--online", "--save-memory"]).arg(&of_run).arg("--out").arg(&out);
    let ended = finish(command.args(common));
    assert_eq!(ended.code, 0, "{}", ended.err);
    assert!(fs::read(&of_stream).unwrap() == fs::read(&of_run).unwrap(), "the maps differ");
    let summary = read_json(&out.join("summary.json"));
    assert_eq!((&summary["settings"]["dataset"]["depth"], &summary["scale"]), (&"none".into(), &"guessed".into()));

    // Without a predictor one line says what is missing and which option helps.
    for (name, arguments) in [("live", vec!["--every-frame"]), ("live", vec!["--every-frame", "--depth", "none"])] {
        let ended = finish(splatseg().arg(name).arg(&color).args(["--world-frame", "map"]).args(arguments));
        let errors: Vec<&str> = ended.err.lines().filter(|line| line.starts_with("error: ")).collect();
        assert_eq!((ended.code, errors.len()), (2, 1), "{}", ended.err);
        assert!(errors[0].contains("depth") && errors[0].contains("--depth-weights"), "{}", errors[0]);
    }
    let ended = finish(splatseg().arg("run").arg(&color).arg("--out").arg(folder.path().join("refused")));
    assert_refused(&ended, "--depth-weights");
    assert_refused(&finish(splatseg().args(["ros2", "--depth", "none"])), "--depth-weights");
}
