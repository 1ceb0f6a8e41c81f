//! Messages about the input: the recognised format, unlikely values, and excessive memory use.

use crate::support::{CLIP_PARTS, Ended, finish, splatseg};
use splatseg_test_scenes::copy_demo_clip;
use std::fs;
use std::path::Path;

fn run(scene: &Path, out: &Path, options: &[&str]) -> Ended {
    finish(splatseg().arg("run").arg(scene).arg("--out").arg(out).args(options))
}

fn lines_with<'a>(text: &'a str, part: &str) -> Vec<&'a str> {
    text.lines().filter(|line| line.contains(part)).collect()
}

#[test]
fn the_recognised_input_is_reported_at_the_start() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("clip");
    copy_demo_clip(&CLIP_PARTS, 4, &scene);
    fs::remove_file(scene.join("color/1.jpg")).unwrap();
    let ended = run(&scene, &folder.path().join("out"), &["--resize", "160x120", "--stride", "2"]);
    assert_eq!(ended.code, 0, "{}", ended.err);
    let lines = lines_with(&ended.err, "clip: format scannet, 3 frames, 2 used; colour ");
    assert!(lines.len() == 1 && lines[0].contains(", used at 160x120; depth of the first frame "), "{}", ended.err);
    assert_eq!(lines_with(&ended.err, "left out: 1 frame without a colour image").len(), 1, "{}", ended.err);
    assert!(!ended.err.contains("WARN"), "the clip is as it should be: {}", ended.err);
}

#[test]
fn unlikely_input_is_reported_once() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("clip");
    copy_demo_clip(&CLIP_PARTS, 4, &scene);
    for frame in 0..4 {
        let pose = format!("1 0 0 {}\n0 1 0 0\n0 0 1 0\n0 0 0 1\n", 400 * frame);
        fs::write(scene.join(format!("pose/{frame}.txt")), pose).unwrap();
    }
    let skewed = "500 3 9000\n0 500 120\n0 0 1\n";
    fs::write(scene.join("intrinsic/intrinsic_depth.txt"), skewed).unwrap();
    let ended = run(&scene, &folder.path().join("out"), &["--resize", "80x60"]);
    assert_eq!(ended.code, 0, "{}", ended.err);
    for (file, what) in [
        (
            "pose/1.txt: ",
            "poses look like millimetres, or tracking was lost: the camera moves 400 m between frames 0 and 1",
        ),
        ("intrinsic_depth.txt: ", "the skew of 3 in row 1, column 2 is ignored"),
        ("intrinsic_depth.txt: ", "the principal point (9000, 120) is outside the image"),
    ] {
        let told = lines_with(&ended.err, what);
        assert!(told.len() == 1 && told[0].contains(file), "{what}: {}", ended.err);
    }
}

#[test]
fn a_recording_without_calibration_needs_a_focal_length() {
    let folder = tempfile::tempdir().unwrap();
    let (scene, out) = (folder.path().join("clip"), folder.path().join("out"));
    copy_demo_clip(&CLIP_PARTS, 2, &scene);
    fs::remove_dir_all(scene.join("intrinsic")).unwrap();
    for (options, expected) in [
        (&["--cx", "9"][..], "dataset.cx is 9, expected no value without dataset.fx (--fx)"),
        (&["--fx", "0"], "dataset.fx is 0, expected more than 0 and at most 1000000"),
        (&[], "clip: the camera is not known: describe it in intrinsic/intrinsic_color.txt and "),
        (&[], "intrinsic_depth.txt, or give its focal length in pixels with --fx"),
    ] {
        let ended = run(&scene, &out, options);
        assert_eq!((ended.code, ended.err.lines().count()), (2, 1), "{}", ended.err);
        assert!(ended.err.contains(expected), "{}", ended.err);
    }
    let ended = run(&scene, &out, &["--fx", "290", "--cy", "-0.5", "--resize", "80x60"]);
    assert_eq!(ended.code, 0, "{}", ended.err);
}

#[test]
fn the_unit_of_depth_is_one_option_for_every_format() {
    let folder = tempfile::tempdir().unwrap();
    let (scene, out) = (folder.path().join("clip"), folder.path().join("out"));
    copy_demo_clip(&CLIP_PARTS, 2, &scene);
    let config = folder.path().join("own.toml");
    fs::write(&config, "\u{FEFF}dataset.depth_scale = 2000\r\n").unwrap();
    let small = ["--resize", "80x60", "--overwrite", "--no-page"];
    let depth_line = |options: &[&str]| {
        let ended = run(&scene, &out, &[&small, options].concat());
        assert_eq!(ended.code, 0, "{}", ended.err);
        lines_with(&ended.err, "depth of the first frame")[0].to_owned()
    };
    let own = depth_line(&[]);
    assert_eq!(depth_line(&["--depth-scale", "1000"]), own);
    let halved = depth_line(&["--depth-scale", "2000"]);
    assert_ne!(halved, own);
    assert_eq!(depth_line(&["--config", config.to_str().unwrap()]), halved);
    for (options, expected) in [
        (["--depth-scale", "1e38"], ".0, expected 0.001 to 1000000"),
        (["--depth-scale", "nan"], "dataset.depth_scale is nan, expected "),
        (
            ["--depth-scale", "1000000"],
            "dataset.depth_scale, --depth-scale: stored units per metre, 1000 for millimetres",
        ),
    ] {
        let ended = run(&scene, &out, &[&small[..], &options].concat());
        assert_eq!((ended.code, ended.err.lines().count()), (2, 1), "{}", ended.err);
        assert!(ended.err.contains(expected), "{}", ended.err);
    }
    fs::write(&config, "[dataset]\nfx = 525,5\n").unwrap();
    let ended = run(&scene, &out, &["--config", config.to_str().unwrap()]);
    assert_eq!((ended.code, ended.err.lines().count()), (2, 1), "{}", ended.err);
    assert!(ended.err.contains("525,5 has a decimal comma, expected 525.5"), "{}", ended.err);
}

#[test]
fn large_frames_are_reduced_or_refused_before_they_take_memory() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let room = Path::new("synthetic:frames=1,width=1920,height=1440,objects=2");
    let ended = run(room, &out, &["--memory-limit", "200MB"]);
    assert_eq!(ended.code, 2, "{}", ended.err);
    assert!(
        ended.err.contains("would take 524 MB of memory, but the limit is 200 MB: make frames smaller with --resize"),
        "{}",
        ended.err
    );
    let ended = run(room, &out, &["--memory-limit", "200MB", "--resize", "320x240"]);
    assert_eq!(ended.code, 0, "{}", ended.err);
    let ended = run(room, &folder.path().join("reduced"), &["--set", "dataset.max_pixels=80000"]);
    assert_eq!((ended.code, lines_with(&ended.err, "are reduced to 326x244").len()), (0, 1), "{}", ended.err);

    for (option, value, expected) in [
        ("--resize", "16384x16384", "sides of 1 to 4096 pixels"),
        ("--memory-limit", "much", "a size such as 4GB or 512MiB, or auto"),
    ] {
        let ended = run(room, &folder.path().join("other"), &[option, value]);
        assert!(ended.code == 2 && ended.err.contains(expected), "{}", ended.err);
    }
}

#[cfg(unix)]
#[test]
fn paths_that_are_not_utf8_are_accepted() {
    use std::os::unix::ffi::OsStringExt;
    let folder = tempfile::tempdir().unwrap();
    let name = |name: &[u8]| folder.path().join(std::ffi::OsString::from_vec(name.to_vec()));
    copy_demo_clip(&CLIP_PARTS, 1, &name(b"sc\xFFne"));
    let ended = run(&name(b"sc\xFFne"), &name(b"\xFF"), &["--resize", "80x60"]);
    assert_eq!((ended.code, name(b"\xFF").join("segments/000000.png").is_file()), (0, true), "{}", ended.err);
}
