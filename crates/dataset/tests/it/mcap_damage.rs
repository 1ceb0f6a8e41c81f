//! Recordings that are damaged, truncated or incomplete.

use crate::support;
use crate::support::mcap::*;
use crate::support::{damaged, recording::recording};
use glam::{DQuat, DVec3};
use proptest::prelude::*;
use splatseg_dataset::{DatasetSettings, LeftOut, RecordingScene, RecordingSummary, Scene};
use splatseg_geometry::{Intrinsics, RgbdFrame, SegmentMap};
use splatseg_ros::Image;
use std::fs;
use std::path::Path;
use std::sync::OnceLock;

fn room() -> &'static [(RgbdFrame<'static>, SegmentMap)] {
    static ROOM: OnceLock<Vec<(RgbdFrame<'static>, SegmentMap)>> = OnceLock::new();
    ROOM.get_or_init(|| recording("synthetic:frames=4,width=32,height=24,seed=3"))
}

fn frames() -> Vec<&'static RgbdFrame<'static>> {
    room().iter().map(|(frame, _)| frame).collect()
}

/// Opens a recording of these bytes. Errors omit the file's path.
fn open(bytes: &[u8], settings: &DatasetSettings) -> Result<RecordingScene, String> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    fs::write(&path, bytes).unwrap();
    RecordingScene::open(&path, settings)
        .map_err(|error| error.to_string().replace(&path.display().to_string(), "a.mcap"))
}

/// Returns the damage to a recording of these bytes, and its number of frames.
fn damage(bytes: &[u8]) -> (Vec<String>, usize) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    fs::write(&path, bytes).unwrap();
    let summary = RecordingSummary::read(&path, &DatasetSettings::default()).unwrap();
    let damage = summary.damage.iter().map(|line| line.replace(&path.display().to_string(), "a.mcap")).collect();
    (damage, summary.scene.map_or(0, |frames| frames.count))
}

fn written(write: impl FnOnce(&mut McapWriter)) -> Vec<u8> {
    let mut writer = McapWriter::new();
    write(&mut writer);
    writer.finish()
}

#[test]
fn what_is_written_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    fs::write(&path, recording_of(&frames())).unwrap();
    let scene = RecordingScene::open(&path, &DatasetSettings::default()).unwrap();
    assert_eq!((scene.frame_count(), scene.left_out().len()), (4, 0));
    for (index, (frame, _)) in room().iter().enumerate() {
        let tolerance = support::recording::Tolerance { depth: 5.1e-4, color: 6.0 };
        support::recording::assert_same(&scene.read_frame(index).unwrap(), frame, &tolerance);
    }
}

#[test]
fn a_recording_that_was_cut_off_is_read_up_to_its_end() {
    let bytes = recording_of(&frames());
    let (told, whole) = damage(&bytes);
    assert!(told.is_empty() && whole == 4, "{told:?}");
    let mut counts = Vec::new();
    for part in 1..20 {
        let (told, frames) = damage(&bytes[..bytes.len() * part / 20]);
        // If only the summary is missing, all messages are read.
        if let Some(line) = told.first() {
            assert!(line.starts_with("a.mcap: the recording was not finished: the record at byte "), "{line}");
            assert_eq!(told.len(), 1, "{told:?}");
        }
        counts.push(frames);
    }
    assert!(
        counts.is_sorted() && counts.contains(&0) && counts.iter().any(|count| (1..4).contains(count)),
        "{counts:?}"
    );
}

#[test]
fn chunks_with_wrong_crcs_are_left_out() {
    let bytes = recording_of(&frames());
    let middle = bytes.len() / 2;
    let mut broken = bytes.clone();
    broken[middle] ^= 1;
    let (told, frames) = damage(&broken);
    assert_eq!(told.len(), 1, "{told:?}");
    assert!(told[0].starts_with("a.mcap: the chunk at byte ") && told[0].contains("its CRC is "), "{told:?}");
    assert!((1..4).contains(&frames), "{frames}");
}

#[test]
fn files_that_are_not_recordings_are_reported() {
    let settings = DatasetSettings::default();
    let begins = "expected \"\\\\x89MCAP0\\\\r\\\\n\", the start of every MCAP file";
    assert_eq!(open(b"", &settings).unwrap_err(), format!("a.mcap: first bytes: found an empty file, {begins}"));
    let error = open(b"hello world", &settings).unwrap_err();
    assert_eq!(error, format!("a.mcap: first bytes: found \"hello wo\", {begins}"));
    let empty = written(|_| {});
    let error = open(&empty, &settings).unwrap_err();
    assert!(error.starts_with("a.mcap: colour images: found no topic, expected a topic of sensor_msgs"), "{error}");
}

#[test]
fn missing_parts_are_reported() {
    let without = |parts: Parts| {
        let bytes = written(|writer| write_frames(writer, &frames(), parts));
        open(&bytes, &DatasetSettings::default()).unwrap_err()
    };
    let error = without(Parts { info: false, ..ALL });
    assert_eq!(
        error,
        "a.mcap: camera info of colour (/camera/image_raw/compressed): found none, expected a topic of \
         sensor_msgs/msg/CameraInfo beside it, or with its frame; --camera-info chooses one, or --fx describes the camera"
    );
    let error = without(Parts { depth: false, ..ALL });
    assert!(
        error.starts_with("a.mcap: depth images: found none, but /camera/image_raw/compressed (jpeg), expected"),
        "{error}"
    );
}

#[test]
fn a_recording_without_poses_is_read_without_them() {
    let bytes = written(|writer| write_frames(writer, &frames(), Parts { poses: false, ..ALL }));
    let scene = open(&bytes, &DatasetSettings::default()).unwrap();
    assert_eq!((scene.frame_count(), scene.has_poses(), scene.without_pose()), (4, false, &[][..]));
    assert_eq!(scene.sources()[2], "poses: none: no topic has poses, and \"camera_color_optical_frame\" is not in /tf");
    // And if the settings say so.
    let bytes = recording_of(&frames());
    let poses = |pose: Option<&str>| {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("a.mcap"), &bytes).unwrap();
        let settings = DatasetSettings::default().with(|s| s.pose = pose.map(str::to_owned));
        let scene = RecordingScene::open(folder.path(), &settings).unwrap();
        let poses: Vec<_> =
            (0..4).map(|index| scene.read_recorded(index).unwrap().world_from_camera.is_some()).collect();
        (scene.sources()[2].clone(), scene.has_poses(), poses)
    };
    assert_eq!(poses(Some("none")), ("poses: none (dataset.pose)".to_owned(), false, vec![false; 4]));
    assert_eq!((poses(None).1, poses(None).2), (true, vec![true; 4]));
    let settings = DatasetSettings::default().with(|s| s.pose = Some("/odom".to_owned()));
    let error = open(&bytes, &settings).unwrap_err();
    assert!(error.contains("dataset.pose: found \"/odom\", expected none, or a topic with poses: /tf"), "{error}");
}

#[test]
fn frames_without_depth_are_left_out_and_those_without_a_pose_counted() {
    let frames = frames();
    let bytes = written(|writer| {
        write_frames(writer, &frames, ALL);
        let late = START + 30 * FRAME_NS;
        let jpeg = support::recording::jpeg_bytes(frames[0].color());
        // One with depth but no pose, one with neither, and one whose time goes back by two seconds.
        for stamp in [late, late + FRAME_NS, START - 20 * FRAME_NS] {
            let color = splatseg_ros::CompressedImage { header: header(stamp, OPTICAL), format: "jpeg", data: &jpeg };
            writer.write("/camera/image_raw/compressed", &color, stamp);
        }
        let depth = depth_bytes(frames[0]);
        writer.write("/camera/depth", &raw(late, OPTICAL, "16UC1", (32, 24), &depth), late);
    });
    let scene = open(&bytes, &DatasetSettings::default()).unwrap();
    let left_out: Vec<String> = scene.left_out().iter().map(|kind| format!("{} {}", kind.count, kind.what)).collect();
    assert_eq!(
        left_out,
        [
            "1 without a depth image within 20 ms of their colour image",
            "1 of /camera/image_raw/compressed whose stamp does not fit its neighbours' or is a duplicate"
        ]
    );
    let what = "without a pose at their time (or within 500 ms)".to_owned();
    assert_eq!(scene.without_pose(), [LeftOut { count: 1, what }]);
    assert_eq!(scene.frame_count(), 5);
}

#[test]
fn a_recording_without_matching_parts_is_an_error() {
    let frames = frames();
    let bytes = written(|writer| {
        write_frames(writer, &frames[..2], ALL);
        // Raw images, which are preferred to compressed ones: without depth, and without a pose.
        let data = vec![9; 3 * 32 * 24];
        let late = START + 30 * FRAME_NS;
        for stamp in [late, late + FRAME_NS] {
            writer.write("/camera/image_raw", &raw(stamp, OPTICAL, "rgb8", (32, 24), &data), stamp);
        }
        writer.write("/camera/depth", &raw(late, OPTICAL, "16UC1", (32, 24), &depth_bytes(frames[0])), late);
    });
    let error = open(&bytes, &DatasetSettings::default()).unwrap_err();
    let expected = "a.mcap: frames: found 2 images of /camera/image_raw and 3 of /camera/depth: 1 pairs within 20 ms, none \
                    with a pose; colour 1700000003.000 to 1700000003.100 s, \
                    depth 1700000000.000 to 1700000003.000 s, expected colour and depth at the same times, with poses: see \
                    dataset.max_time_difference_ms and dataset.max_pose_gap_ms; --pose none uses no poses";
    assert!(error.starts_with(expected), "{error}");
    let settings = DatasetSettings::default().with(|s| s.color = Some("/camera/image_raw/compressed".to_owned()));
    assert_eq!(open(&bytes, &settings).unwrap().frame_count(), 2);
}

/// Returns a recording of two frames of a robot driving along x, with a colour camera and a depth camera of half the
/// resolution, which sees a wall 2 m ahead. `depth_at` is the depth camera's position relative to the colour camera;
/// `None` leaves out /tf_static.
fn with_two_cameras(color_camera: &Intrinsics, depth_at: Option<DVec3>) -> Vec<u8> {
    let depth_camera = color_camera.resized(16, 12);
    written(|writer| {
        for (child, at) in [("color", depth_at.map(|_| DVec3::ZERO)), ("depth", depth_at)] {
            if let Some(at) = at {
                writer.write("/tf_static", &transform(START, "base", child, at, DQuat::IDENTITY), START);
            }
        }
        for (x, stamp) in [(0.0, START), (1.0, START + FRAME_NS)] {
            writer.write("/tf", &transform(stamp, "world", "base", DVec3::X * x, DQuat::IDENTITY), stamp);
            let data = vec![9; 3 * 32 * 24];
            writer.write("/color/image_raw", &raw(stamp, "color", "rgb8", (32, 24), &data), stamp);
            writer.write("/color/camera_info", &info(stamp, "color", color_camera), stamp);
            let data = 2000u16.to_le_bytes().repeat(16 * 12);
            writer.write("/depth/image_raw", &raw(stamp, "depth", "16UC1", (16, 12), &data), stamp);
            writer.write("/depth/camera_info", &info(stamp, "depth", &depth_camera), stamp);
        }
    })
}

#[test]
fn depth_of_another_camera_is_registered() {
    let color_camera = *frames()[0].intrinsics();
    let error = open(&with_two_cameras(&color_camera, None), &DatasetSettings::default()).unwrap_err();
    let expected = "a.mcap: frames of the cameras: found depth in frame \"depth\", colour in frame \"color\", expected a fixed \
                    transform between them";
    assert!(error.starts_with(expected), "{error}");
    let read = |depth_at: DVec3| {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("a.mcap"), with_two_cameras(&color_camera, Some(depth_at))).unwrap();
        let scene = RecordingScene::open(folder.path(), &DatasetSettings::default()).unwrap();
        assert!(scene.sources()[1].ends_with(", registered to colour here"), "{:?}", scene.sources());
        assert_eq!(scene.stored_color_size(0), Some((32, 24)));
        scene.read_frame(1).unwrap()
    };
    let frame = read(DVec3::ZERO);
    assert_eq!((frame.width(), frame.height()), (16, 12), "as many pixels as depth has");
    assert!(frame.depth().pixels().iter().all(|z| *z == 2.0));
    // Half a metre nearer to the wall, and far enough to the right for four pixels there.
    let shift = 4.0 * 1.5 / f64::from(color_camera.resized(16, 12).fx);
    let frame = read(DVec3::new(shift, 0.0, -0.5));
    assert!(frame.depth().pixels().iter().all(|z| *z == 0.0 || *z == 1.5));
    let row: Vec<bool> = frame.depth().row(6).iter().map(|z| *z > 0.0).collect();
    assert!(!row[0] && row[15], "{row:?}");
}

#[test]
fn a_lens_is_taken_out_of_colour_and_depth() {
    let frame = frames()[0];
    let mut camera = info(START, OPTICAL, frame.intrinsics());
    camera.d = vec![-0.2, 0.05, 0.001, 0.0, 0.0];
    let pixels: Vec<u8> = frame.color().pixels().as_flattened().to_vec();
    let write = |info: &splatseg_ros::CameraInfo| {
        written(|writer| {
            for stamp in [START, START + FRAME_NS] {
                let shift = DVec3::X * ((stamp - START) as f64 * 1e-9);
                writer.write("/tf", &transform(stamp, "world", OPTICAL, shift, DQuat::IDENTITY), stamp);
                writer.write("/camera/camera_info", info, stamp);
                writer.write("/camera/image_raw", &raw(stamp, OPTICAL, "rgb8", (32, 24), &pixels), stamp);
                let depth = depth_bytes(frame);
                writer.write("/camera/depth", &raw(stamp, OPTICAL, "16UC1", (32, 24), &depth), stamp);
            }
        })
    };
    let read = |bytes: &[u8]| {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("a.mcap"), bytes).unwrap();
        let scene = RecordingScene::open(folder.path(), &DatasetSettings::default()).unwrap();
        scene.read_frame(0).unwrap()
    };
    let (straight, bent) = (read(&write(&info(START, OPTICAL, frame.intrinsics()))), read(&write(&camera)));
    assert_eq!(bent.intrinsics(), straight.intrinsics());
    let lens = splatseg_geometry::Distortion::from_coefficients("plumb_bob", &camera.d).unwrap();
    let map = splatseg_dataset::Undistortion::new(frame.intrinsics(), &lens, Path::new("a")).unwrap().unwrap();
    assert_eq!(*bent.depth(), map.depth(straight.depth(), Path::new("a")).unwrap());
    assert_eq!(*bent.color(), map.color(straight.color(), Path::new("a")).unwrap());
    assert_ne!(bent.depth(), straight.depth());
    camera.distortion_model = "spherical".to_owned();
    let error = open(&write(&camera), &DatasetSettings::default()).unwrap_err();
    assert!(error.contains("a.mcap: /camera/camera_info: distortion model: found \"spherical\""), "{error}");
}

#[test]
fn messages_that_cannot_be_read_do_no_harm() {
    let bytes = written(|writer| {
        write_frames(writer, &frames(), ALL);
        writer.write_bytes::<Image<'_>>("/camera/image_raw", b"\0\x01\0\0too short", START);
        writer.write_bytes::<Image<'_>>("/camera/depth", b"\0\x09\0\0", START);
    });
    assert_eq!(open(&bytes, &DatasetSettings::default()).unwrap().frame_count(), 4);
}

#[test]
fn tens_of_thousands_of_topics_are_listed_within_the_memory_limit() {
    let bytes = written(|writer| {
        for index in 0..20_000 {
            let topic = format!("/topic/{index}");
            writer.write_bytes::<Image<'_>>(&topic, b"\0\x01\0\0", START);
        }
    });
    let error = open(&bytes, &DatasetSettings::default()).unwrap_err();
    assert!(error.len() < 3000 && error.contains(" and 19990 more"), "{error}");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, ..ProptestConfig::default() })]

    #[test]
    fn damaged_recordings_never_panic(
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..8),
        keep in any::<prop::sample::Index>(),
        without_crcs in any::<bool>(),
    ) {
        static WHOLE: OnceLock<[Vec<u8>; 2]> = OnceLock::new();
        let whole = WHOLE.get_or_init(|| {
            let bytes = recording_of(&frames()[..2]);
            [without_checksums(bytes.clone()), bytes]
        });
        let bytes = damaged(whole[usize::from(!without_crcs)].clone(), &changes, &keep);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mcap");
        fs::write(&path, bytes).unwrap();
        match RecordingScene::open(&path, &DatasetSettings::default()) {
            Ok(scene) => (0..scene.frame_count()).for_each(|index| _ = scene.read_frame(index)),
            Err(error) => prop_assert!(error.to_string().contains("a.mcap") && !error.to_string().contains('\n'), "{}", error),
        }
    }
}
