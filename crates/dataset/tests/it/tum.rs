//! TUM RGB-D sequences, whole and damaged.

use crate::support;
use crate::support::recording::*;
use glam::DQuat;
use proptest::prelude::*;
use splatseg_dataset::{DatasetError, DatasetSettings, Framing, LeftOut, Scene, TumScene, open_scene};
use splatseg_geometry::{Pose, RgbdFrame, SegmentMap};
use std::fs;
use std::path::Path;
use std::sync::OnceLock;

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
        trajectory += &pose_line(seconds + 0.002, frame.world_from_camera(), 1.0 - 0.005 * index as f64);
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
        let half = Framing { resize: Some("32x24".parse().unwrap()), crop_border: 1, ..Framing::default() };
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
    let expected = "depth.txt: times of the depth images: found 1.500 to 1.500 s, expected times less than 0.02 s from those of \
                    the colour images, 1305031102.175 to 1305031102.242 s (";
    assert!(refused().contains(expected), "{}", refused());
}

fn opening_fails(name: &str, text: &[u8]) -> String {
    let folder = tempfile::tempdir().unwrap();
    write_tum(folder.path());
    fs::write(folder.path().join(name), text).unwrap();
    let error = TumScene::open(folder.path(), &DatasetSettings::default()).unwrap_err().to_string();
    assert!(error.contains(name), "the file is named: {error}");
    error
}

/// Writes the times of a sequence in another unit, with or without the fraction that is left.
fn in_unit(folder: &Path, name: &str, per_second: f64, is_whole: bool) {
    let path = folder.join(name);
    let converted =
        fs::read_to_string(&path).unwrap().lines().fold(String::new(), |text, line| match line.split_once(' ') {
            Some((time, rest)) if !line.starts_with('#') => {
                let (seconds, fraction) = time.split_once('.').unwrap();
                // Exact, unlike the product.
                let nanoseconds = format!("{seconds}{fraction:0<9}").parse::<u64>().unwrap();
                let divisor = (1e9 / per_second) as u64;
                let rest_of_time = nanoseconds % divisor;
                let point = if is_whole { String::new() } else { format!(".{:03}", rest_of_time * 1000 / divisor) };
                text + &format!("{}{point} {rest}\n", nanoseconds / divisor)
            }
            _ => text + line + "\n",
        });
    fs::write(path, converted).unwrap();
}

#[test]
fn times_in_other_units_are_read() {
    let expected = tempfile::tempdir().unwrap();
    write_tum(expected.path());
    let expected = open(expected.path());
    for lists in [&["rgb.txt", "depth.txt", "groundtruth.txt"][..], &["rgb.txt", "depth.txt"], &["groundtruth.txt"]] {
        for (per_second, is_whole) in [(1e9, true), (1e6, true), (1e6, false), (1e3, true), (1e3, false)] {
            let folder = tempfile::tempdir().unwrap();
            write_tum(folder.path());
            lists.iter().for_each(|list| in_unit(folder.path(), list, per_second, is_whole));
            let scene = open(folder.path());
            assert_eq!((scene.frame_count(), scene.without_pose()), (3, &[][..]), "{per_second} {lists:?}");
            for index in 0..3 {
                let (read, written) = (scene.read_frame(index).unwrap(), expected.read_frame(index).unwrap());
                assert_eq!(read.world_from_camera(), written.world_from_camera(), "{per_second} {lists:?}");
                let times = [read, written].map(|frame| frame.timestamp().unwrap().as_secs_f64());
                assert!((times[0] - times[1]).abs() <= 1.0 / per_second + 1e-6, "{per_second}: {times:?}");
            }
        }
    }
}

#[test]
fn impossible_times_are_refused_with_their_line() {
    let told = opening_fails("rgb.txt", b"5000000000.5 rgb/1.png\n1.5 rgb/2.png\n2.0 rgb/3.png\n");
    assert!(told.contains("rgb.txt: line 1: found the time 5000000000.5, which is after 2038"), "{told}");
    let told = opening_fails("groundtruth.txt", b"1.0 0 0 0 0 0 0 1\n8e18 0 0 0 0 0 0 1\n1.1 0 0 0 0 0 0 1\n");
    assert!(told.contains("groundtruth.txt: line 2: found the time 8e18, which is after 2038"), "{told}");
}

#[test]
fn lists_of_other_systems_are_read_or_named() {
    let expected = tempfile::tempdir().unwrap();
    write_tum(expected.path());
    let expected = open(expected.path()).read_frame(1).unwrap();
    let convert: [fn(&str) -> Vec<u8>; 3] = [
        |text| format!("\u{FEFF}{text}").replace('\n', "\r\n").into_bytes(),
        |text| format!("\u{FEFF}{text}").encode_utf16().flat_map(u16::to_le_bytes).collect(),
        |text| format!("\u{FEFF}{text}").encode_utf16().flat_map(u16::to_be_bytes).collect(),
    ];
    for convert in convert {
        let folder = tempfile::tempdir().unwrap();
        write_tum(folder.path());
        fs::write(folder.path().join("camera-intrinsics.txt"), convert("52.5 0 31.5\n0 52.5 23.5\n0 0 1\n")).unwrap();
        for list in ["rgb.txt", "depth.txt", "groundtruth.txt"] {
            // Without comments the mark is at the first time.
            let text = fs::read_to_string(folder.path().join(list)).unwrap();
            let lines = text.lines().filter(|line| !line.starts_with('#')).map(|line| format!("{line}\n"));
            fs::write(folder.path().join(list), convert(&lines.collect::<String>())).unwrap();
        }
        let read = open(folder.path()).read_frame(1).unwrap();
        assert_eq!((read.world_from_camera(), read.timestamp()), (expected.world_from_camera(), expected.timestamp()));
        assert_eq!(read.intrinsics().cx, 31.5);
    }
    for (name, text) in [
        ("rgb.txt", "1305031102,175304 rgb/1.png\n"),
        ("groundtruth.txt", "1305031102,2 0,5 1,5 0,25 0,0 0,0 0,0 1,0\n"),
        ("camera-intrinsics.txt", "525,5 0 319,5\n0 525,5 239,5\n0 0 1\n"),
    ] {
        let told = opening_fails(name, text.as_bytes());
        assert!(told.contains("line 1: found decimal commas in "), "{told}");
    }
    assert!(
        opening_fails("rgb.txt", b"1\0.\x005\0 \0a\0")
            .contains("found UTF-16 without a byte order mark, expected UTF-8")
    );
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
    let text = format!("{START} 0 0 0 0 0 0 0\n{second} 1 2 3 0 0 0 nan\n{} 1 2 3 0 0 0 -1\n", second + SPACING);
    fs::write(folder.path().join("groundtruth.txt"), text).unwrap();
    let scene = open(folder.path());
    let error = scene.read_frame(0).unwrap_err().to_string();
    assert!(error.contains("groundtruth.txt: line 1: pose: found a quaternion of length 0.000"), "{error}");
    assert!(matches!(scene.read_frame(1), Err(DatasetError::NoPose { .. })));
    assert_eq!(scene.read_recorded(1).unwrap().world_from_camera, None);
    let what = "whose pose in groundtruth.txt is NaN or infinite: tracking was lost".to_owned();
    assert_eq!(scene.without_pose(), [LeftOut { count: 1, what }]);
    assert_eq!(scene.read_frame(2).unwrap().world_from_camera().translation().to_array(), [1.0, 2.0, 3.0]);
}

#[test]
fn a_quaternion_of_another_length_is_an_error_of_its_frame() {
    let folder = tempfile::tempdir().unwrap();
    write_tum(folder.path());
    // Four Euler angles or a swapped position are no rotation.
    for (numbers, is_good) in [("0.1 0.2 0.3 0.4", false), ("1 2 3 1", false), ("0 0 0 2", false), ("0 0 0 1.01", true)]
    {
        let lines = (0..3).map(|index| format!("{} 1 2 3 {numbers}\n", START + SPACING * f64::from(index)));
        fs::write(folder.path().join("groundtruth.txt"), lines.collect::<String>()).unwrap();
        let read = open(folder.path()).read_frame(1).map_err(|error| error.to_string());
        match read {
            Ok(_) => assert!(is_good, "{numbers}"),
            Err(error) => assert!(
                !is_good
                    && error.contains("groundtruth.txt: line 2: pose: found a quaternion of length ")
                    && error.ends_with("expected qx qy qz qw of length 1"),
                "{error}"
            ),
        }
    }
}

#[test]
fn images_of_another_shape_than_the_assumed_cameras_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    write_tum(folder.path());
    for (part, color) in [("rgb", true), ("depth", false)] {
        for file in fs::read_dir(folder.path().join(part)).unwrap() {
            let path = file.unwrap().path();
            if color {
                image::RgbImage::new(64, 36).save(path).unwrap();
            } else {
                support::write_png16(&path, (64, 36), |_, _| 5000);
            }
        }
    }
    let error = open(folder.path()).read_frame(0).unwrap_err().to_string();
    assert!(error.contains("colour image: found 64x36 pixels, expected the shape of 640x480, as"), "{error}");
    assert!(error.contains("--fx"), "{error}");
    let own = DatasetSettings::default().with(|settings| settings.fx = Some(50.0));
    assert!(open_scene(folder.path(), &own).unwrap().read_frame(0).is_ok());
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
