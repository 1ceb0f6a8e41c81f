//! TUM RGB-D sequences, whole and damaged.

mod support;

use glam::DQuat;
use proptest::prelude::*;
use splatseg_dataset::{DatasetError, DatasetSettings, Framing, LeftOut, Scene, TumScene, open_scene};
use splatseg_geometry::{Pose, RgbdFrame, SegmentMap};
use std::fs;
use std::path::Path;
use std::sync::OnceLock;
use support::recording::*;

const START: f64 = 1_305_031_102.175_304;
const SPACING: f64 = 0.033_3;

fn room() -> &'static [(RgbdFrame<'static>, SegmentMap)] {
    static ROOM: OnceLock<Vec<(RgbdFrame<'static>, SegmentMap)>> = OnceLock::new();
    ROOM.get_or_init(|| recording("synthetic:frames=3,width=64,height=48,seed=8"))
}

/// Returns a line of the trajectory. The quaternion is scaled to `length`.
fn pose_line(seconds: f64, pose: &Pose, length: f64) -> String {
    let t = pose.translation();
    let q = (DQuat::from_mat3(&pose.rotation()) * length).to_array();
    format!("{seconds:.4} {} {} {} {} {} {} {}\n", t.x, t.y, t.z, q[0], q[1], q[2], q[3])
}

/// Writes a sequence with depth 6 ms before colour, and a pose every 10 ms.
fn write_tum(folder: &Path) {
    for part in ["rgb", "depth"] {
        fs::create_dir_all(folder.join(part)).unwrap();
    }
    let (mut color, mut depth) = ("# color images\n# timestamp filename\n".to_owned(), "# depth maps\n".to_owned());
    let mut trajectory = "# ground truth trajectory\n# timestamp tx ty tz qx qy qz qw\n".to_owned();
    for (index, (frame, _)) in room().iter().enumerate() {
        let seconds = START + SPACING * index as f64;
        let (color_name, depth_name) = (format!("rgb/{seconds:.6}.png"), format!("depth/{:.6}.png", seconds - 0.006));
        fs::write(folder.join(&color_name), png_color_bytes(frame.color())).unwrap();
        fs::write(folder.join(&depth_name), png_depth_bytes(frame.depth(), 5000.0)).unwrap();
        color += &format!("{seconds:.6} {color_name}\n");
        depth += &format!("{:.6} {depth_name}\n", seconds - 0.006);
        // The nearest pose is the frame's own. Its neighbours are wrong.
        trajectory += &pose_line(seconds - 0.008, &Pose::IDENTITY, 1.0);
        trajectory += &pose_line(seconds + 0.002, frame.world_from_camera(), 1.0 + index as f64);
        trajectory += &pose_line(seconds + 0.012, &Pose::IDENTITY, 1.0);
    }
    fs::write(folder.join("rgb.txt"), color).unwrap();
    fs::write(folder.join("depth.txt"), depth).unwrap();
    fs::write(folder.join("groundtruth.txt"), trajectory).unwrap();
}

fn open(folder: &Path) -> std::sync::Arc<dyn Scene> {
    open_scene(folder, &DatasetSettings::default()).unwrap()
}

#[test]
fn sequences_are_read_back() {
    let folder = tempfile::tempdir().unwrap();
    write_tum(folder.path());
    let scene = open(folder.path());
    assert_eq!((scene.frame_count(), scene.frame_name(0)), (3, "1305031102.175304".to_owned()));
    for (index, (written, _)) in room().iter().enumerate() {
        let read = scene.read_frame(index).unwrap();
        assert_same(&read, written, &Tolerance { depth: 0.000_11, color: 0.0 });
        let seconds = START + SPACING * index as f64;
        assert!((read.timestamp().unwrap().as_secs_f64() - seconds).abs() < 1e-6, "{:?}", read.timestamp());
        let half = Framing { resize: Some("32x24".parse().unwrap()), crop_border: 1, max_pixels: None };
        assert_eq!(half.apply(read.clone().into_camera_frame()).unwrap().timestamp(), read.timestamp());
        // 525 for 640 pixels; these images have 64.
        assert_eq!((read.intrinsics().fx, read.intrinsics().fy), (52.5, 52.5));
    }
    assert!(!scene.has_ground_truth() && scene.read_ground_truth(0).unwrap().is_none());
    assert!(matches!(scene.read_frame(3), Err(DatasetError::NoSuchFrame { .. })));
}

#[test]
fn the_camera_follows_the_sequences_name_or_its_own_file() {
    let parent = tempfile::tempdir().unwrap();
    for (name, fx, cy) in [("freiburg1", 51.73, 25.08), ("freiburg2", 52.09, 24.52), ("freiburg3", 53.54, 24.31)] {
        let folder = parent.path().join(format!("rgbd_dataset_{name}_desk"));
        write_tum(&folder);
        let camera = *open(&folder).read_frame(0).unwrap().intrinsics();
        assert!((camera.fx - fx).abs() < 1e-4 && (camera.cy - cy).abs() < 1e-4, "{name}: {camera:?}");
        fs::write(folder.join("camera-intrinsics.txt"), "50 0 31\n0 51 23\n0 0 1\n").unwrap();
        let camera = *open(&folder).read_frame(0).unwrap().intrinsics();
        assert_eq!((camera.fx, camera.fy, camera.cx, camera.cy), (50.0, 51.0, 31.0, 23.0));
    }
}

#[test]
fn frames_without_depth_are_left_out_and_those_without_a_pose_have_none() {
    let folder = tempfile::tempdir().unwrap();
    write_tum(folder.path());
    let keep_lines = |name: &str, keep: fn(usize) -> bool| {
        let text = fs::read_to_string(folder.path().join(name)).unwrap();
        let kept = text.lines().enumerate().filter(|(index, _)| keep(*index)).map(|(_, line)| format!("{line}\n"));
        fs::write(folder.path().join(name), kept.collect::<String>()).unwrap();
    };
    keep_lines("depth.txt", |line| line != 2);
    let scene = open(folder.path());
    assert_eq!((scene.frame_count(), scene.frame_name(0)), (2, "1305031102.175304".to_owned()));
    let what = "without a depth image within 0.02 s of their colour image".to_owned();
    assert_eq!((scene.left_out(), scene.without_pose()), (&[LeftOut { count: 1, what }][..], &[][..]));
    keep_lines("groundtruth.txt", |line| line < 5);
    let scene = open(folder.path());
    assert_eq!((scene.frame_count(), scene.has_poses()), (2, true));
    assert!(scene.read_frame(0).is_ok());
    assert_eq!(scene.read_recorded(1).unwrap().world_from_camera, None);
    let what = "without a pose within 0.02 s of their colour image".to_owned();
    assert_eq!(scene.without_pose(), [LeftOut { count: 1, what }]);
    let refused = || TumScene::open(folder.path(), &DatasetSettings::default()).unwrap_err().to_string();
    keep_lines("groundtruth.txt", |line| line < 2);
    let expected = "expected those of the images, 1305031102.175 to 1305031102.242 s; without this file, the scene has no \
                    poses";
    assert!(
        refused().ends_with(&format!("groundtruth.txt: times of the poses: found no pose, {expected}")),
        "{}",
        refused()
    );
    fs::write(folder.path().join("groundtruth.txt"), "1 0 0 0 0 0 0 1\n2.5 0 0 0 0 0 0 1\n").unwrap();
    assert!(refused().ends_with(&format!("times of the poses: found 1.000 to 2.500 s, {expected}")), "{}", refused());
    fs::write(folder.path().join("depth.txt"), "1.5 depth/1.png\n").unwrap();
    assert!(matches!(TumScene::open(folder.path(), &DatasetSettings::default()), Err(DatasetError::NoFrames { .. })));
}

fn opening_fails(name: &str, text: &[u8]) -> String {
    let folder = tempfile::tempdir().unwrap();
    write_tum(folder.path());
    fs::write(folder.path().join(name), text).unwrap();
    let error = TumScene::open(folder.path(), &DatasetSettings::default()).unwrap_err().to_string();
    assert!(error.contains(name), "the file is named: {error}");
    error
}

#[test]
fn damaged_lists_are_reported() {
    assert!(
        opening_fails("rgb.txt", b"# fine\n\n1.0 rgb/1.png\nnow rgb/2.png\n")
            .contains("line 4: found \"now rgb/2.png\"")
    );
    assert!(
        opening_fails("depth.txt", b"1.5").contains("line 1: found \"1.5\", expected a time in seconds and a file")
    );
    assert!(opening_fails("rgb.txt", b"inf rgb/1.png").contains("line 1"));
    for path in ["../secret.png", "/etc/passwd", "rgb/../../secret.png"] {
        assert!(opening_fails("rgb.txt", format!("1.0 {path}\n").as_bytes()).contains("inside the folder"));
    }
    let twice = format!("{START} rgb/1.png\n{} other/1.png\n", START + SPACING);
    assert!(opening_fails("rgb.txt", twice.as_bytes()).contains("found \"1\", expected each image once"));
    assert!(opening_fails("groundtruth.txt", b"1 0 0 0 0 0 1\n").contains("expected time tx ty tz qx qy qz qw"));
    assert!(opening_fails("groundtruth.txt", b"1 0 0 0 0 0 0 1 2\n").contains("line 1"));
    assert!(opening_fails("groundtruth.txt", b"1 0 0 zero 0 0 0 1\n").contains("line 1"));
    assert!(opening_fails("groundtruth.txt", &[0xFF; 9]).contains("not text"));
    let folder = tempfile::tempdir().unwrap();
    write_tum(folder.path());
    fs::remove_file(folder.path().join("depth.txt")).unwrap();
    let error = TumScene::open(folder.path(), &DatasetSettings::default()).unwrap_err().to_string();
    assert!(error.ends_with("depth.txt: the list of depth images is missing"), "{error}");
    let error = open_scene(folder.path(), &DatasetSettings::default()).unwrap_err().to_string();
    let expected = "looks like a scene of format tum, but this is missing: depth.txt (found: rgb.txt)";
    assert!(error.ends_with(expected), "{error}");
}

#[test]
fn a_quaternion_without_a_direction_is_an_error_of_its_frame() {
    let folder = tempfile::tempdir().unwrap();
    write_tum(folder.path());
    let second = START + SPACING;
    let text = format!("{START} 0 0 0 0 0 0 0\n{second} 1 2 3 0 0 0 nan\n{} 1 2 3 0 0 0 -2\n", second + SPACING);
    fs::write(folder.path().join("groundtruth.txt"), text).unwrap();
    let scene = open(folder.path());
    let error = scene.read_frame(0).unwrap_err().to_string();
    assert!(error.contains("groundtruth.txt: line 1: the pose's quaternion has length zero"), "{error}");
    assert!(matches!(scene.read_frame(1), Err(DatasetError::NoPose { .. })));
    assert_eq!(scene.read_recorded(1).unwrap().world_from_camera, None);
    let what = "whose pose in groundtruth.txt is NaN or infinite: tracking was lost".to_owned();
    assert_eq!(scene.without_pose(), [LeftOut { count: 1, what }]);
    assert_eq!(scene.read_frame(2).unwrap().world_from_camera().translation().to_array(), [1.0, 2.0, 3.0]);
}

#[test]
fn damaged_images_are_reported() {
    let folder = tempfile::tempdir().unwrap();
    write_tum(folder.path());
    let depth = folder.path().join("depth/1305031102.169304.png");
    support::write_lying_png(&depth, (60_000, 60_000));
    let scene = open(folder.path());
    assert!(matches!(scene.read_frame(0), Err(DatasetError::ImplausibleSize { .. })));
    support::write_png16(&depth, (32, 24), |_, _| 5000);
    assert!(matches!(scene.read_frame(0), Err(DatasetError::SizesDiffer { found: (32, 24), .. })));
    fs::remove_file(&depth).unwrap();
    assert!(matches!(scene.read_frame(0), Err(DatasetError::MissingFile { .. })));
    assert!(scene.read_frame(1).is_ok());
}

#[cfg(unix)]
#[test]
fn special_files_are_not_read() {
    let folder = tempfile::tempdir().unwrap();
    write_tum(folder.path());
    support::assert_special_files_are_refused(folder.path(), folder.path());
}

#[test]
fn lines_that_are_not_utf8_are_counted() {
    let folder = tempfile::tempdir().unwrap();
    write_tum(folder.path());
    let mut list = fs::read(folder.path().join("rgb.txt")).unwrap();
    list.extend(b"1305031109.5 rgb/\xFF.png\n");
    fs::write(folder.path().join("rgb.txt"), list).unwrap();
    let scene = open(folder.path());
    let what = "with names that are not UTF-8 in rgb.txt or depth.txt".to_owned();
    assert_eq!((scene.frame_count(), scene.left_out()), (3, &[LeftOut { count: 1, what }][..]));
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 100, ..ProptestConfig::default() })]

    #[test]
    fn damaged_text_never_panics(
        name in prop::sample::select(vec!["rgb.txt", "depth.txt", "groundtruth.txt", "camera-intrinsics.txt"]),
        lines in prop::collection::vec("([0-9.e#/ -]{0,60}|\\PC{0,40}|1 0 0 0 0 0 0 [01]|1 rgb/[a-z0-9.]{1,9})", 0..8),
    ) {
        let folder = tempfile::tempdir().unwrap();
        write_tum(folder.path());
        fs::write(folder.path().join(name), lines.join("\n")).unwrap();
        if let Ok(scene) = TumScene::open(folder.path(), &DatasetSettings::default()) {
            let _ = scene.read_frame(0);
        }
    }
}
