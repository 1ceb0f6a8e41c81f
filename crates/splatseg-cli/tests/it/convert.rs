//! `convert`: scenes written as recordings of ROS 2 messages.

use crate::phone_scenes::{write_arkitscenes, write_polycam, write_stray};
use crate::support::{CLIP_PARTS, Ended, ROOM, file_names, finish, numbered_scene, splatseg};
use splatseg_dataset::{DatasetSettings, FrameStream, GroundTruth, StreamedFrame, open_scene};
use splatseg_geometry::Pose;
use splatseg_output::{Compression, SceneRecording};
use splatseg_ros::{CameraInfo, Image, from_cdr};
use splatseg_test_scenes::{camera, copy_demo_clip, recording, shared, wall, without_chunks};
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

fn convert(scene: &Path, out: &Path, more: &[&str]) -> Ended {
    finish(splatseg().arg("convert").arg(scene).arg(out).args(more))
}

fn settings(change: impl FnOnce(&mut DatasetSettings)) -> DatasetSettings {
    let mut settings = DatasetSettings::default();
    change(&mut settings);
    settings
}

/// Returns the frames that a run would get.
fn frames(scene: &Path, settings: &DatasetSettings) -> Vec<StreamedFrame> {
    let scene = open_scene(scene, settings).unwrap();
    FrameStream::open(scene, settings, GroundTruth::Skip).unwrap().map(Result::unwrap).collect()
}

/// Asserts that two scenes have the same frames, apart from their names.
fn assert_same(found: &[StreamedFrame], expected: &[StreamedFrame]) {
    assert_eq!(found.len(), expected.len());
    for (found, expected) in found.iter().zip(expected) {
        let name = expected.frame.name();
        assert!(found.frame.color() == expected.frame.color(), "{name}: other colours");
        let bits = |frame: &StreamedFrame| -> Vec<u32> {
            frame.frame.depth().pixels().iter().map(|depth| depth.to_bits()).collect()
        };
        assert!(bits(found) == bits(expected), "{name}: other depth");
        assert_eq!(found.frame.intrinsics(), expected.frame.intrinsics(), "{name}");
        let poses = (found.world_from_camera.as_ref(), expected.world_from_camera.as_ref());
        assert_eq!(poses.0.is_some(), poses.1.is_some(), "{name}");
        if let (Some(found), Some(expected)) = poses {
            let shift = (found.translation() - expected.translation()).length();
            let turn = found.rotation() - expected.rotation();
            let turn = turn.to_cols_array().iter().fold(0.0, |most: f64, part| most.max(part.abs()));
            assert!(shift < 1e-9 && turn < 1e-9, "{name}: {shift} m, {turn}");
        }
    }
}

/// Converts a scene and asserts that nothing is lost. Returns the recording.
fn assert_lossless(scene: &Path, folder: &Path, more: &[&str], settings: &DatasetSettings) -> PathBuf {
    let file = folder.join("converted.mcap");
    let ended = convert(scene, &file, more);
    assert_eq!(ended.code, 0, "{}", ended.err);
    assert_same(&frames(&file, &DatasetSettings::default()), &frames(scene, settings));
    file
}

/// Returns the messages of a topic.
fn messages(file: &Path, topic: &str) -> Vec<mcap::Message<'static>> {
    let bytes = without_chunks(&fs::read(file).unwrap());
    let all = mcap::MessageStream::new(&bytes).unwrap().map(Result::unwrap);
    all.filter(|message| message.channel.topic == topic).collect()
}

fn depth_encodings(file: &Path) -> BTreeSet<String> {
    let depth = messages(file, "/camera/aligned_depth_to_color/image_raw");
    depth.iter().map(|message| from_cdr::<Image<'_>>(&message.data).unwrap().encoding.to_owned()).collect()
}

#[test]
fn the_frames_of_a_recording_are_those_of_the_scene() {
    let folder = tempfile::tempdir().unwrap();
    let file = assert_lossless(Path::new(ROOM), folder.path(), &[], &DatasetSettings::default());
    assert_eq!(depth_encodings(&file), BTreeSet::from(["32FC1".to_owned()]));
    let again = folder.path().join("again.mcap");
    let ended = convert(Path::new(ROOM), &again, &[]);
    assert_eq!(ended.out, format!("{}: 18 frames, all with poses, depth in metres (32FC1)\n", again.display()));
    assert!(fs::read(&file).unwrap() == fs::read(&again).unwrap(), "the same scene gives other bytes");
    // A recording is a scene, too.
    let of_recording = folder.path().join("of_recording.mcap");
    assert_eq!(convert(&file, &of_recording, &[]).code, 0);
    assert_same(
        &frames(&of_recording, &DatasetSettings::default()),
        &frames(Path::new(ROOM), &DatasetSettings::default()),
    );
}

#[test]
fn compression_changes_only_the_size() {
    let folder = tempfile::tempdir().unwrap();
    let files = ["none", "lz4"].map(|compression| {
        let file = folder.path().join(format!("{compression}.mcap"));
        assert_eq!(convert(Path::new(ROOM), &file, &["--compression", compression]).code, 0);
        let again = folder.path().join(format!("{compression}-again.mcap"));
        assert_eq!(convert(Path::new(ROOM), &again, &["--compression", compression]).code, 0);
        let bytes = fs::read(&file).unwrap();
        assert!(bytes == fs::read(&again).unwrap(), "{compression}: other bytes");
        assert_same(&frames(&file, &DatasetSettings::default()), &frames(Path::new(ROOM), &DatasetSettings::default()));
        bytes
    });
    assert!(without_chunks(&files[0]) == without_chunks(&files[1]));
    let [none, lz4] = files.map(|bytes| bytes.len());
    assert!(lz4 < none, "{none} and {lz4} bytes");
    let by_default = folder.path().join("default.mcap");
    assert_eq!(convert(Path::new(ROOM), &by_default, &[]).code, 0);
    assert_eq!(fs::read(by_default).unwrap().len(), lz4);
}

#[test]
fn recordings_of_all_containers_are_converted() {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../dataset/tests/data/recordings");
    let topic = "/camera/color/image_raw";
    let chosen = settings(|settings| settings.color = Some(topic.to_owned()));
    let mut files = Vec::new();
    for name in ["room.mcap", "room.db3", "db3_file", "db3_split", "room.bag", "room_lz4.bag", "room_bz2.bag"] {
        let folder = tempfile::tempdir().unwrap();
        let file = assert_lossless(&data.join(name), folder.path(), &["--color", topic], &chosen);
        files.push(fs::read(file).unwrap());
    }
    // The messages are the same in all.
    assert!(files.iter().all(|file| *file == files[0]));
    let realsense = ["realsense_2.56.bag", "realsense_2.58.db3", "realsense_2.59.db3"];
    for name in realsense.into_iter().chain(["kinect_nfov.mkv", "kinect_wfov.mkv", "orbbec.bag"]) {
        let folder = tempfile::tempdir().unwrap();
        let file = assert_lossless(&data.join(name), folder.path(), &[], &DatasetSettings::default());
        assert!(!frames(&file, &DatasetSettings::default()).is_empty(), "{name}");
    }
}

#[test]
fn recordings_of_phones_are_converted() {
    let folder = tempfile::tempdir().unwrap();
    for write in [write_polycam, write_stray, write_arkitscenes] {
        let scene = folder.path().join("scene");
        write(&scene, &recording("synthetic:frames=3,width=32,height=24,seed=3"));
        let file = assert_lossless(&scene, folder.path(), &[], &DatasetSettings::default());
        let found = frames(&file, &DatasetSettings::default());
        assert_eq!(found.iter().filter(|frame| frame.world_from_camera.is_some()).count(), 3);
        fs::remove_file(file).unwrap();
        fs::remove_dir_all(scene).unwrap();
    }
}

#[test]
fn the_settings_select_and_frame_what_is_converted() {
    let folder = tempfile::tempdir().unwrap();
    let resize = Some("32x24".parse().unwrap());
    let settings = settings(|settings| {
        (settings.start, settings.stride, settings.max_frames) = (1, 3, Some(4));
        (settings.resize, settings.crop_border) = (resize, 2);
    });
    let options = "--start 1 --stride 3 --max-frames 4 --resize 32x24 --crop-border 2";
    let options: Vec<&str> = options.split(' ').collect();
    let file = assert_lossless(Path::new(ROOM), folder.path(), &options, &settings);
    let infos = messages(&file, "/camera/color/camera_info");
    let info: CameraInfo = from_cdr(&infos[0].data).unwrap();
    assert_eq!((infos.len(), info.width, info.height), (4, 28, 20));
}

#[test]
fn depth_in_whole_millimetres_stays_so_and_one_frame_is_enough() {
    let folder = tempfile::tempdir().unwrap();
    let scene = numbered_scene(folder.path(), 3);
    let file = assert_lossless(&scene, folder.path(), &[], &DatasetSettings::default());
    assert_eq!(depth_encodings(&file), BTreeSet::from(["16UC1".to_owned()]));
    // A camera that does not move is not one without poses.
    fs::remove_file(&file).unwrap();
    let settings = settings(|settings| settings.max_frames = Some(1));
    assert_lossless(&scene, folder.path(), &["--max-frames", "1"], &settings);
}

#[test]
fn a_scene_without_poses_stays_without() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("scene");
    let parts: Vec<&str> = CLIP_PARTS.into_iter().filter(|part| *part != "pose").collect();
    copy_demo_clip(&parts, 3, &scene);
    let file = assert_lossless(&scene, folder.path(), &[], &DatasetSettings::default());
    assert!(!open_scene(&file, &DatasetSettings::default()).unwrap().has_poses());
    assert!(messages(&file, "/tf").is_empty());
}

#[test]
fn a_lost_pose_is_reported() {
    let folder = tempfile::tempdir().unwrap();
    let scene = numbered_scene(folder.path(), 4);
    let poses = file_names(&scene.join("pose"));
    fs::remove_file(scene.join("pose").join(&poses[1])).unwrap();
    let file = folder.path().join("lost.mcap");
    let ended = convert(&scene, &file, &[]);
    assert_eq!(ended.code, 0, "{}", ended.err);
    assert!(ended.err.contains("1 frame without a pose: readers interpolate"), "{}", ended.err);
    assert!(ended.out.contains("4 frames, 3 with poses"), "{}", ended.out);
    let exact = settings(|settings| (settings.max_pose_gap_ms, settings.max_time_difference_ms) = (0.0, 0.0));
    assert_same(&frames(&file, &exact), &frames(&scene, &DatasetSettings::default()));
}

#[test]
fn a_run_of_the_recording_gives_the_same_ids() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("room.mcap");
    assert_eq!(convert(Path::new(ROOM), &file, &["--max-frames", "6"]).code, 0);
    let run = |scene: &Path, out: &str| -> Vec<Vec<u8>> {
        let out = folder.path().join(out);
        let mut command = splatseg();
        command.arg("run").arg(scene).arg("--out").arg(&out).args(["--max-frames", "6", "--no-page", "--threads", "2"]);
        let ended = finish(&mut command);
        assert_eq!(ended.code, 0, "{}", ended.err);
        let segments = out.join("segments");
        file_names(&segments).iter().map(|name| fs::read(segments.join(name)).unwrap()).collect()
    };
    let (expected, found) = (run(Path::new(ROOM), "scene"), run(&file, "recording"));
    assert_eq!(expected.len(), 6);
    assert!(found == expected, "other segments");
}

#[test]
fn every_frame_has_its_own_camera_and_a_later_time() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("frames.mcap");
    let mut recording = SceneRecording::create(&file, Compression::None).unwrap();
    let times = [Some(5_000), None, Some(4_000), Some(9_000)].map(|time| time.map(Duration::from_millis));
    for (index, time) in times.into_iter().enumerate() {
        let mut camera = camera(8, 6, 10.0);
        camera.fx += index as f32 / 3.0;
        let frame = wall(index.to_string(), camera, 1.5, Pose::IDENTITY).into_camera_frame();
        recording.write(&frame.with_timestamp(time), Some(&Pose::IDENTITY)).unwrap();
    }
    assert_eq!(recording.counts().moved_in_time, 1);
    recording.finish().unwrap();
    let found = frames(&file, &DatasetSettings::default());
    let times: Vec<u128> = found.iter().map(|frame| frame.frame.timestamp().unwrap().as_nanos()).collect();
    assert_eq!(times, [5_000_000_000, 5_033_333_333, 5_066_666_666, 9_000_000_000]);
    for (index, frame) in found.iter().enumerate() {
        assert_eq!(frame.frame.intrinsics().fx, 10.0 + index as f32 / 3.0);
    }
}

#[test]
fn files_are_not_replaced_and_bad_input_is_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("new/room.mcap");
    let one = ["--max-frames", "1"];
    assert_eq!(convert(Path::new(ROOM), &file, &one).code, 0);
    let refused = |scene: &Path, out: &Path, more: &[&str], text: &str| {
        let ended = convert(scene, out, more);
        assert_eq!((ended.code, ended.err.lines().count()), (2, 1), "{}", ended.err);
        assert!(ended.err.starts_with("error: ") && ended.err.contains(text), "{}", ended.err);
    };
    refused(Path::new(ROOM), &file, &one, "room.mcap: exists: give --overwrite to replace it");
    assert_eq!(convert(Path::new(ROOM), &file, &["--max-frames", "2", "--overwrite"]).code, 0);
    assert_eq!(frames(&file, &DatasetSettings::default()).len(), 2);
    refused(&file, &file, &["--overwrite"], "is the scene: choose another file");
    let other = folder.path().join("other.mcap");
    fs::write(&other, "mine").unwrap();
    refused(
        Path::new(ROOM),
        &other,
        &["--overwrite"],
        "is not a recording by splatseg: choose another file for OUT.mcap",
    );
    refused(Path::new(ROOM), &folder.path().join("room.bag"), &[], "expected a name that ends in .mcap");
    let missing = folder.path().join("missing");
    refused(&missing, &folder.path().join("deep/missing.mcap"), &[], "missing");
    refused(Path::new(ROOM), &folder.path().join("a.mcap"), &["--start", "99"], "dataset.start is 99");
    assert_eq!(file_names(folder.path()), ["new", "other.mcap"]);
    assert_eq!(fs::read_to_string(&other).unwrap(), "mine");
}

#[test]
fn a_real_video_is_the_same_as_a_recording() {
    let test = "a_real_video_is_the_same_as_a_recording";
    let Some(scene) = shared("data/kitchen-dev", test) else { return };
    let folder = tempfile::tempdir().unwrap();
    let settings = settings(|settings| (settings.stride, settings.max_frames) = (50, Some(4)));
    assert_lossless(&scene, folder.path(), &["--stride", "50", "--max-frames", "4"], &settings);
}
