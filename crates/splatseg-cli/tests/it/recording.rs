//! Recordings of ROS 2 messages from the command line.

use crate::support::{Ended, file_names, finish, numbered_scene, splatseg};
use std::fs;
use std::path::{Path, PathBuf};

fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../dataset/tests/data/mcap").join(name)
}

fn run(scene: &Path, out: &Path, more: &[&str]) -> Ended {
    finish(splatseg().arg("run").arg(scene).arg("--out").arg(out).args(["--threads", "2"]).args(more))
}

fn inspect(file: &Path, more: &[&str]) -> Ended {
    finish(splatseg().arg("inspect").arg(file).args(more))
}

#[test]
fn a_recording_gives_the_same_ids_as_its_source_folder() {
    let folder = tempfile::tempdir().unwrap();
    let scene = numbered_scene(folder.path(), 4);
    let [of_folder, of_recording] = ["folder", "recording"].map(|name| folder.path().join(name));
    let ended = run(&scene, &of_folder, &[]);
    assert_eq!(ended.code, 0, "{}", ended.err);
    let ended = run(&data("room.mcap"), &of_recording, &[]);
    assert_eq!(ended.code, 0, "{}", ended.err);
    assert!(ended.err.contains("room: format mcap, 4 frames; colour 320x240"), "{}", ended.err);
    assert!(ended.err.contains("poses: /tf, from camera_color_optical_frame to map"), "{}", ended.err);
    let names = file_names(&of_folder.join("segments"));
    assert_eq!((names.len(), &names), (4, &file_names(&of_recording.join("segments"))));
    for name in names {
        let read = |out: &Path| fs::read(out.join("segments").join(&name)).unwrap();
        assert_eq!(read(&of_folder), read(&of_recording), "{name}");
    }
}

#[test]
fn options_choose_topics() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let file = data("encodings.mcap");
    let ended = run(&file, &out, &[]);
    assert_eq!((ended.code, ended.err.lines().count()), (2, 1), "{}", ended.err);
    assert!(ended.err.contains("topics of colour images: found /rgb8, /bgr8"), "{}", ended.err);
    let chosen = ["--color", "/rgb8", "--depth", "/depth/png", "--camera-info", "/camera_info", "--pose", "/tf_static"];
    let ended = run(&file, &out, &[&chosen[..], &["--world-frame", "map", "--max-time-difference-ms", "0"]].concat());
    assert_eq!(ended.code, 0, "{}", ended.err);
    assert!(ended.err.contains("colour: /rgb8 (sensor_msgs/msg/Image, rgb8), camera /camera_info"), "{}", ended.err);
    let ended = run(&file, &out, &["--max-time-difference-ms", "70000"]);
    assert!(ended.err.contains("dataset.max_time_difference_ms"), "{}", ended.err);
}

#[test]
fn inspect_lists_the_topics_and_the_used_ones() {
    let ended = inspect(&data("bag"), &[]);
    assert_eq!((ended.code, ended.err.as_str()), (0, ""));
    for line in [
        "kind           MCAP",
        "recorded       1700000000.000 s to 1700000000.400 s, 0.4 s",
        "topics         5",
        "  /rgb/image_raw sensor_msgs/msg/Image, 3 messages in 0.4 s (5.0 Hz), rgb8, frame rgb_camera_link",
        "  /odom nav_msgs/msg/Odometry, 3 messages in 0.4 s (5.0 Hz)",
        "frames         3",
        "  colour: /rgb/image_raw (sensor_msgs/msg/Image, rgb8), camera /rgb/camera_info",
        "  poses: /odom (nav_msgs/msg/Odometry) in odom, of base_link, with /tf_static from rgb_camera_link",
    ] {
        assert!(ended.out.lines().any(|found| found == line), "{line}\n{}", ended.out);
    }
    let ended = inspect(&data("rosbag2/talker.mcap"), &[]);
    assert_eq!((ended.code, ended.err.lines().count()), (2, 1));
    assert!(
        ended.out.contains("frames         none") && ended.err.contains("colour images: found none, but /"),
        "{}",
        ended.err
    );
    let ended = inspect(&data("room.mcap"), &["--world-frame", "moon"]);
    assert!(ended.err.contains("dataset.world_frame: found \"moon\""), "{}", ended.err);
    let ended = inspect(&data("room.mcap"), &["--tensors"]);
    assert!(ended.code == 2 && ended.err.contains("--convert and --tensors are for checkpoints"), "{}", ended.err);
}

#[test]
fn a_cut_off_recording_is_used_with_a_warning() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("power_lost.mcap");
    let bytes = fs::read(data("room.mcap")).unwrap();
    fs::write(&file, &bytes[..bytes.len() * 2 / 3]).unwrap();
    let ended = run(&file, &folder.path().join("out"), &[]);
    assert_eq!(ended.code, 0, "{}", ended.err);
    let warning = "power_lost.mcap: the recording was not finished: the record at byte ";
    assert_eq!(ended.err.matches(warning).count(), 1, "{}", ended.err);
    assert!(ended.err.contains("format mcap, 1 frame;"), "{}", ended.err);
}

/// Writes the messages of `room.mcap` compressed as a whole.
fn packed_room(folder: &Path) -> PathBuf {
    let bytes = fs::read(data("room.mcap")).unwrap();
    // A zstd frame with blocks that are stored as they are.
    let mut packed = [&[0x28, 0xB5, 0x2F, 0xFD, 0xA0][..], &u32::try_from(bytes.len()).unwrap().to_le_bytes()].concat();
    let blocks: Vec<&[u8]> = bytes.chunks(100_000).collect();
    for (index, block) in blocks.iter().enumerate() {
        let header = u32::try_from(block.len()).unwrap() << 3 | u32::from(index + 1 == blocks.len());
        packed.extend(&header.to_le_bytes()[..3]);
        packed.extend(*block);
    }
    let path = folder.join("room_0.mcap.zstd");
    fs::write(&path, packed).unwrap();
    fs::write(folder.join("metadata.yaml"), "").unwrap();
    path
}

#[test]
fn a_compressed_recording_is_inspected_and_run() {
    let folder = tempfile::tempdir().unwrap();
    let bag = folder.path().join("bag");
    fs::create_dir(&bag).unwrap();
    packed_room(&bag);
    let ended = inspect(&bag, &[]);
    assert_eq!((ended.code, ended.err.as_str()), (0, ""));
    assert!(ended.out.contains("kind           MCAP, compressed (zstd, each file)"), "{}", ended.out);
    assert!(ended.out.contains("frames         4"), "{}", ended.out);
    let ended = run(&bag, &folder.path().join("out"), &["--max-frames", "1"]);
    assert_eq!(ended.code, 0, "{}", ended.err);
    assert!(ended.err.contains("room_0: format mcap, 4 frames, 1 used"), "{}", ended.err);
}

#[test]
fn options_say_whether_depth_is_registered() {
    let sources = |more: &[&str]| {
        let ended = inspect(&data("room.mcap"), more);
        assert_eq!(ended.code, 0, "{}", ended.err);
        ended.out.lines().find(|line| line.contains("  depth: ")).unwrap().to_owned()
    };
    assert!(sources(&[]).ends_with("camera_info"));
    assert!(sources(&["--register-depth", "auto"]).ends_with("camera_info"));
    assert!(sources(&["--register-depth"]).ends_with("camera_info, registered to colour here"));
    assert!(sources(&["--register-depth=true"]).ends_with(", registered to colour here"));
    assert!(sources(&["--register-depth", "false"]).ends_with(", taken as registered to colour"));
    let ended = inspect(&data("room.mcap"), &["--register-depth=perhaps"]);
    assert!(ended.code == 2 && ended.err.contains("auto, true, false"), "{}", ended.err);
}
