//! Recordings with wrong stamps and clock changes.

use crate::support::mcap::{FRAME_NS, McapWriter, OPTICAL, START, camera_transform, depth_bytes, header, info, raw};
use crate::support::recording::{jpeg_bytes, recording};
use crate::support::warnings::with_warnings;
use splatseg_dataset::{DatasetSettings, FrameStream, GroundTruth, RecordedFrame, RecordingScene, Scene, open_scene};
use splatseg_geometry::RgbdFrame;
use std::fs;

const FRAMES: usize = 24;
const HOUR: i64 = 3_600_000_000_000;

/// Stamps of a frame's messages and their recording time.
#[derive(Clone, Copy)]
struct Stamps {
    color: i64,
    depth: i64,
    pose: i64,
    info: i64,
    log: i64,
}

/// Returns the stamps of a valid recording.
fn good() -> Vec<Stamps> {
    let at = |index: i64| START + index * FRAME_NS;
    let stamps = |index: i64| Stamps {
        color: at(index),
        depth: at(index),
        pose: at(index),
        info: at(index),
        log: at(index) + 30_000_000,
    };
    (0..FRAMES as i64).map(stamps).collect()
}

fn frames() -> Vec<RgbdFrame<'static>> {
    recording("synthetic:frames=24,width=16,height=12,seed=3").into_iter().map(|(frame, _)| frame).collect()
}

/// Opens a recording with these stamps. Returns the original index of each of its frames with a pose, by depth, and the
/// frames that are skipped or have no pose.
fn opened(stamps: &[Stamps]) -> (Vec<usize>, Vec<String>) {
    let frames = frames();
    let mut writer = McapWriter::new();
    for (frame, stamps) in frames.iter().zip(stamps) {
        writer.write("/tf", &camera_transform(stamps.pose, "world", OPTICAL, frame), stamps.log);
        writer.write("/camera/camera_info", &info(stamps.info, OPTICAL, frame.intrinsics()), stamps.log);
        let jpeg = jpeg_bytes(frame.color());
        let color =
            splatseg_ros::CompressedImage { header: header(stamps.color, OPTICAL), format: "jpeg", data: &jpeg };
        writer.write("/camera/image_raw/compressed", &color, stamps.log);
        let data = depth_bytes(frame);
        writer.write("/camera/depth", &raw(stamps.depth, OPTICAL, "16UC1", frame.depth().size(), &data), stamps.log);
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("clock.mcap");
    fs::write(&path, writer.finish()).unwrap();
    let scene = RecordingScene::open(&path, &DatasetSettings::default()).unwrap();
    let which = |index: usize| {
        let RecordedFrame { frame, world_from_camera } = scene.read_recorded(index).unwrap();
        let read = frame.at(world_from_camera?);
        let error = |frame: &RgbdFrame| {
            let depths = frame.depth().pixels().iter().zip(read.depth().pixels());
            depths.map(|(one, other)| (one - other).abs()).sum::<f32>()
        };
        let found = (0..frames.len()).min_by(|one, other| error(&frames[*one]).total_cmp(&error(&frames[*other])));
        let found = found.unwrap();
        let pose =
            (read.world_from_camera().to_matrix() - frames[found].world_from_camera().to_matrix()).to_cols_array();
        assert!(pose.iter().all(|entry| entry.abs() < 1e-6), "frame {index} has the pose of another than {found}");
        Some(found)
    };
    let missing = scene.left_out().iter().chain(scene.without_pose());
    let missing = missing.map(|kind| format!("{} {}", kind.count, kind.what)).collect();
    ((0..scene.frame_count()).filter_map(which).collect(), missing)
}

fn all_but(missing: &[usize]) -> Vec<usize> {
    (0..FRAMES).filter(|index| !missing.contains(index)).collect()
}

/// Wrong stamps as sent by drivers: near the epoch, hours in the past or future, the largest, and a few seconds off.
const WRONG: [i64; 6] =
    [1, START - 1_000 * HOUR, START + HOUR, i32::MAX as i64 * 1_000_000_000, START + 15_000_000_000, 7_000_000_000];

#[test]
fn a_wrong_stamp_costs_the_frame_that_has_it() {
    for wrong in WRONG {
        for place in [0, 1, 11, FRAMES - 2, FRAMES - 1] {
            let changes: [fn(&mut Stamps, i64); 3] = [
                |stamps, wrong| stamps.color = wrong,
                |stamps, wrong| stamps.depth = wrong,
                |stamps, wrong| (stamps.color, stamps.depth) = (wrong, wrong),
            ];
            for (kind, change) in changes.into_iter().enumerate() {
                let mut stamps = good();
                change(&mut stamps[place], wrong);
                let (found, left_out) = opened(&stamps);
                assert_eq!(found, all_but(&[place]), "{wrong} at {place}, {kind}: {left_out:?}");
                assert!(!left_out.is_empty());
            }
        }
    }
}

#[test]
fn a_wrong_stamp_of_a_pose_or_a_camera_costs_no_frame() {
    for wrong in WRONG {
        for place in [1, 11, FRAMES - 2] {
            let mut stamps = good();
            (stamps[place].pose, stamps[place].info) = (wrong, wrong);
            let (found, _) = opened_roughly(&stamps);
            assert_eq!(found, FRAMES, "{wrong} at {place}: interpolated");
        }
        let mut stamps = good();
        (stamps[0].info, stamps[5].info) = (wrong, wrong);
        assert_eq!(opened(&stamps).0, all_but(&[]));
    }
}

/// Returns the focal lengths of the frames of a recording whose camera changes at frame 12, with this stamp.
fn focal_lengths(changed_at: i64) -> Vec<f32> {
    let (frames, stamps) = (frames(), good());
    let mut writer = McapWriter::new();
    for (index, (frame, stamps)) in frames.iter().zip(&stamps).enumerate() {
        writer.write("/tf", &camera_transform(stamps.pose, "world", OPTICAL, frame), stamps.log);
        let mut camera = *frame.intrinsics();
        camera.fx += if index < 12 { 0.0 } else { 5.0 };
        let stamp = if index == 12 { changed_at } else { stamps.info };
        writer.write("/camera/camera_info", &info(stamp, OPTICAL, &camera), stamps.log);
        let data = vec![7; 16 * 12 * 3];
        writer.write("/camera/image", &raw(stamps.color, OPTICAL, "rgb8", (16, 12), &data), stamps.log);
        let data = depth_bytes(frame);
        writer.write("/camera/depth", &raw(stamps.depth, OPTICAL, "16UC1", frame.depth().size(), &data), stamps.log);
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("camera.mcap");
    fs::write(&path, writer.finish()).unwrap();
    let scene = open_scene(&path, &DatasetSettings::default()).unwrap();
    (0..scene.frame_count()).map(|index| scene.read_frame(index).unwrap().intrinsics().fx).collect()
}

#[test]
fn a_new_camera_with_a_wrong_stamp_is_used_from_where_it_was_recorded() {
    let expected = focal_lengths(good()[12].info);
    assert_eq!((expected.len(), expected[12] - expected[11]), (FRAMES, 5.0));
    for wrong in WRONG {
        assert_eq!(focal_lengths(wrong), expected, "{wrong}");
    }
}

/// Opens a recording with these stamps. Returns its number of frames, whose poses may be interpolated, and the skipped
/// frames.
fn opened_roughly(stamps: &[Stamps]) -> (usize, Vec<String>) {
    let frames = frames();
    let mut writer = McapWriter::new();
    for (frame, stamps) in frames.iter().zip(stamps) {
        writer.write("/tf", &camera_transform(stamps.pose, "world", OPTICAL, frame), stamps.log);
        writer.write("/camera/camera_info", &info(stamps.info, OPTICAL, frame.intrinsics()), stamps.log);
        let data = vec![7; 16 * 12 * 3];
        writer.write("/camera/image", &raw(stamps.color, OPTICAL, "rgb8", (16, 12), &data), stamps.log);
        let data = depth_bytes(frame);
        writer.write("/camera/depth", &raw(stamps.depth, OPTICAL, "16UC1", frame.depth().size(), &data), stamps.log);
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("clock.mcap");
    fs::write(&path, writer.finish()).unwrap();
    let scene = open_scene(&path, &DatasetSettings::default()).unwrap();
    let left_out = scene.left_out().iter().map(|kind| format!("{} {}", kind.count, kind.what)).collect();
    (scene.frame_count(), left_out)
}

/// Moves the clock from a frame on. `log` is true if the recorder has the same clock.
fn set_clock(stamps: &mut [Stamps], from: usize, by: i64, log: bool) {
    for stamps in &mut stamps[from..] {
        for stamp in [&mut stamps.color, &mut stamps.depth, &mut stamps.pose, &mut stamps.info] {
            *stamp += by;
        }
        stamps.log += if log { by } else { 0 };
    }
}

#[test]
fn a_clock_that_is_set_costs_no_frame() {
    for by in [HOUR, -HOUR, 5_000_000_000, -5_000_000_000, -600_000_000, -(START - 1_000_000_000)] {
        for log in [true, false] {
            let mut stamps = good();
            set_clock(&mut stamps, 12, by, log);
            let (found, left_out) = opened(&stamps);
            assert_eq!((found, left_out), (all_but(&[]), vec![]), "by {by}, log {log}");
        }
    }
}

#[test]
fn a_simulation_that_starts_again_and_again_costs_no_frame() {
    for log in [true, false] {
        // The same eight stamps three times, half a second apart.
        let mut stamps = good();
        for (index, stamps) in stamps.iter_mut().enumerate() {
            let at = 2_000_000_000 + (index % 8) as i64 * 5 * FRAME_NS;
            (stamps.color, stamps.depth, stamps.pose, stamps.info) = (at, at, at, at);
            if log {
                stamps.log = at;
            }
        }
        let (found, left_out) = opened(&stamps);
        assert_eq!((found, left_out), (all_but(&[]), vec![]), "log {log}");
        // And a wrong stamp in the second run.
        stamps[11].color = 9 * HOUR;
        assert_eq!(opened(&stamps).0, all_but(&[11]), "log {log}");
    }
}

#[test]
fn a_recording_without_log_times_uses_the_order_of_its_messages() {
    let mut stamps = good();
    set_clock(&mut stamps, 12, -HOUR, false);
    stamps.iter_mut().for_each(|stamps| stamps.log = 0);
    assert_eq!(opened(&stamps).0, all_but(&[]));
}

#[test]
fn a_clock_that_stands_still_is_replaced_by_the_recording_times() {
    let stuck = |change: fn(&mut Stamps)| {
        let mut stamps = good();
        stamps.iter_mut().for_each(change);
        with_warnings(|| opened(&stamps))
    };
    let ((found, missing), warnings) =
        stuck(|stamps| (stamps.color, stamps.depth, stamps.pose, stamps.info) = (START, START, START, START));
    assert_eq!((found, missing), (all_but(&[]), vec![]));
    let told = |topic: &str| {
        let text = format!("all images of {topic} have one stamp, 1700000000.000 s: their recording times are used");
        warnings.iter().any(|warning| warning.contains(&text))
    };
    assert!(warnings.len() == 2 && told("/camera/image_raw/compressed") && told("/camera/depth"), "{warnings:?}");
}

#[test]
fn most_frames_left_out_is_a_warning() {
    let frames = frames();
    let mut writer = McapWriter::new();
    for (index, frame) in (0..).zip(&frames) {
        let stamp = START + index * FRAME_NS;
        writer.write("/camera/camera_info", &info(stamp, OPTICAL, frame.intrinsics()), stamp);
        let jpeg = jpeg_bytes(frame.color());
        let color = splatseg_ros::CompressedImage { header: header(stamp, OPTICAL), format: "jpeg", data: &jpeg };
        writer.write("/camera/image_raw/compressed", &color, stamp);
        if index % 6 == 0 {
            let data = depth_bytes(frame);
            writer.write("/camera/depth", &raw(stamp, OPTICAL, "16UC1", frame.depth().size(), &data), stamp);
        }
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("rarely.mcap");
    fs::write(&path, writer.finish()).unwrap();
    let settings = DatasetSettings::default();
    let scene = open_scene(&path, &settings).unwrap();
    let ((), warnings) = with_warnings(|| FrameStream::open(scene, &settings, GroundTruth::Skip).map(drop).unwrap());
    let expected = "rarely: most frames are left out: 20 frames without a depth image within 20 ms of their colour image; 4 of \
                    the scene remain";
    assert_eq!(warnings, [expected]);
}
