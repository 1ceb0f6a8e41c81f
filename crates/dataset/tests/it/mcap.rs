//! ROS 2 recordings written by other programs, and the choice of their topics.

use splatseg_dataset::{
    DatasetSettings, Format, FrameSource, FrameStream, GroundTruth, RecordingScene, RecordingSummary, Scene, open_scene,
};
use splatseg_geometry::RgbdFrame;
use std::path::{Path, PathBuf};

fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/mcap").join(name)
}

fn open(name: &str, change: impl FnOnce(&mut DatasetSettings)) -> Result<RecordingScene, String> {
    let settings = DatasetSettings::default().with(change);
    RecordingScene::open(&data(name), &settings)
        .map_err(|error| error.to_string().replace(&data("").display().to_string(), ""))
}

fn pose_error(left: &RgbdFrame, right: &RgbdFrame) -> f64 {
    let difference = left.world_from_camera().to_matrix() - right.world_from_camera().to_matrix();
    difference.to_cols_array().into_iter().map(f64::abs).fold(0.0, f64::max)
}

#[test]
fn a_robots_recording_has_the_frames_of_the_folder_that_it_was_made_of() {
    let folder = open_scene(splatseg_test_scenes::demo_clip(), &DatasetSettings::default()).unwrap();
    let recording = open_scene(data("room.mcap"), &DatasetSettings::default()).unwrap();
    assert_eq!((recording.format(), recording.name(), recording.frame_count()), (Some(Format::Mcap), "room", 4));
    for index in 0..4 {
        let (read, expected) = (recording.read_frame(index).unwrap(), folder.read_frame(index).unwrap());
        assert_eq!(read.color(), expected.color());
        assert_eq!(read.depth(), expected.depth());
        assert_eq!(read.intrinsics(), expected.intrinsics());
        assert_eq!(read.name(), expected.name());
        assert!(pose_error(&read, &expected) < 1e-6, "frame {index}: {}", pose_error(&read, &expected));
        let milliseconds = 1_700_000_000_000 + 200 * index as u128;
        assert_eq!(read.timestamp().unwrap().as_millis(), milliseconds);
    }
    let stream = FrameStream::open(recording, &DatasetSettings::default(), GroundTruth::Skip).unwrap();
    let description = stream.description().to_string();
    for line in [
        "room: format mcap, 4 frames; colour 320x240; depth of the first frame ",
        "\n  colour: /camera/color/image_raw/compressed (sensor_msgs/msg/CompressedImage, rgb8; jpeg compressed bgr8), camera \
         /camera/color/camera_info",
        "\n  depth: /camera/aligned_depth_to_color/image_raw/compressedDepth (",
        "\n  poses: /tf, from camera_color_optical_frame to map",
    ] {
        assert!(description.contains(line), "{line}\nis not in\n{description}");
    }
}

#[test]
fn frames_are_read_in_any_order_from_any_thread() {
    let scene = open("room.mcap", |_| {}).unwrap();
    let expected: Vec<_> = (0..4).map(|index| scene.read_frame(index).unwrap()).collect();
    std::thread::scope(|scope| {
        for start in 0..4 {
            let (scene, expected) = (&scene, &expected);
            scope.spawn(move || {
                for index in (0..4).rev().map(|index| (index + start) % 4) {
                    assert_eq!(scene.read_frame(index).unwrap(), expected[index]);
                }
            });
        }
    });
    assert!(scene.read_frame(4).unwrap_err().to_string().contains("there is no frame 4, the scene has 4"));
}

#[test]
fn frames_are_the_same_in_another_world() {
    let [map, odom] =
        ["map", "odom"].map(|world| open("room.mcap", |s| s.world_frame = Some(world.to_owned())).unwrap());
    let step = |scene: &RecordingScene| {
        let pose = |index| *scene.read_frame(index).unwrap().world_from_camera();
        (pose(0).inverse() * pose(3)).to_matrix()
    };
    assert!(step(&map).abs_diff_eq(step(&odom), 1e-5), "{} {}", step(&map), step(&odom));
    assert!(pose_error(&map.read_frame(0).unwrap(), &odom.read_frame(0).unwrap()) > 0.1);
    let error = open("room.mcap", |s| s.world_frame = Some("moon".to_owned())).unwrap_err();
    assert_eq!(
        error,
        "room.mcap: dataset.world_frame: found \"moon\", expected a frame connected to \
         \"camera_color_optical_frame\" by /tf; frames: base_link, camera_color_optical_frame, camera_link, map, odom"
    );
}

#[test]
fn every_encoding_gives_the_picture() {
    let read = |color: &str, depth: &str| {
        let scene = open("encodings.mcap", |s| {
            (s.color, s.depth) = (Some(color.to_owned()), Some(depth.to_owned()));
            s.pose = Some("tf_static".to_owned());
        });
        scene.unwrap().read_frame(0).unwrap()
    };
    for color in ["/rgb8", "/bgr8", "/rgba8", "/bgra8", "/png", "png_plain", "/mono8"] {
        let frame = read(color, "/depth/16UC1");
        for (index, pixel) in frame.color().pixels().iter().enumerate() {
            let (column, row) = (index as u8 % 16, index as u8 / 16);
            let grey = color == "/mono8";
            assert_eq!(*pixel, if grey { [16 * column; 3] } else { [16 * column, 20 * row, 9] }, "{color}");
        }
    }
    for color in ["/yuv422", "/yuv422_yuy2"] {
        let frame = read(color, "/depth/16UC1");
        for (index, pixel) in frame.color().pixels().iter().enumerate() {
            let grey = (1.164 * 10.0 * (index % 16) as f32).round() as u8;
            assert!(pixel.iter().all(|part| part.abs_diff(grey) <= 1), "{color}: {pixel:?} {grey}");
        }
    }
    for depth in [
        "16UC1",
        "16UC1_big",
        "mono16",
        "32FC1",
        "32FC1_big",
        "png",
        "compressed_png",
        "compressed_old",
        "compressed_rvl",
        "inverse_png",
        "inverse_rvl",
    ] {
        let frame = read("/rgb8", &format!("/depth/{depth}"));
        // 16-bit inverse depth: millimetre accuracy at close range.
        let tolerance = if depth.starts_with("inverse") { 1e-3 } else { 0.0 };
        for (index, metres) in frame.depth().pixels().iter().enumerate() {
            let expected = if index == 0 { 0.0 } else { (1000 + index % 16 + 100 * (index / 16)) as f32 / 1000.0 };
            assert!((metres - expected).abs() <= tolerance, "{depth}: {metres}, not {expected}");
        }
    }
}

#[test]
fn ambiguous_and_missing_topics_are_reported() {
    let pose = |s: &mut DatasetSettings| s.pose = Some("/tf_static".to_owned());
    let error = open("encodings.mcap", pose).unwrap_err();
    assert_eq!(
        error,
        "encodings.mcap: topics of colour images: found /rgb8, /bgr8, /rgba8, /bgra8, /yuv422, /yuv422_yuy2, /png, \
         /png_plain, expected one: choose it with --color"
    );
    let color = |s: &mut DatasetSettings| s.color = Some("/rgb8".to_owned());
    let error = open("encodings.mcap", color).unwrap_err();
    assert!(
        error.starts_with("encodings.mcap: topics of depth images: found /depth/16UC1, /depth/16UC1_big"),
        "{error}"
    );
    assert!(error.ends_with(" and 1 more, expected one: choose it with --depth"), "{error}");
    let error = open("encodings.mcap", |s| s.color = Some("/rgb9".to_owned())).unwrap_err();
    assert!(
        error.starts_with("encodings.mcap: dataset.color: found \"/rgb9\", expected a topic with images: /rgb8,"),
        "{error}"
    );
    let both = |s: &mut DatasetSettings| {
        color(s);
        s.depth = Some("/depth/png".to_owned());
    };
    let scene = open("encodings.mcap", both).unwrap();
    assert_eq!(
        scene.sources()[2],
        "poses: none: no topic has poses, and camera does not move in map; for a stationary camera use --pose /tf_static"
    );
    assert!(!scene.has_poses() && scene.read_recorded(0).unwrap().world_from_camera.is_none());
    let error = open("encodings.mcap", |s| {
        both(s);
        pose(s);
        s.color = Some("/bayer".to_owned());
    });
    let error = error.unwrap().read_frame(0).unwrap_err().to_string();
    assert!(
        error.contains("/bayer at 1700000000.000 s: colour image, encoding: found \"bayer_rggb8\", expected rgb8,"),
        "{error}"
    );
}

#[test]
fn a_rosbag2_folder_with_odometry_is_read() {
    let scene = open_scene(data("bag"), &DatasetSettings::default()).unwrap();
    assert_eq!((scene.name(), scene.frame_count()), ("bag", 3));
    assert_eq!(
        scene.sources()[2],
        "poses: /odom (nav_msgs/msg/Odometry) in odom, of base_link, with /tf_static from rgb_camera_link"
    );
    let frame = scene.read_frame(2).unwrap();
    // The robot faces along its x axis. The camera is 0.5 m in front of its centre and 1 m above.
    let ahead = frame.world_from_camera().to_world(glam::Vec3::new(0.1, 0.2, 3.0));
    assert!(ahead.abs_diff_eq(glam::DVec3::new(2.0 + 0.5 + 3.0, -0.1, 1.0 - 0.2), 1e-5), "{ahead}");
    assert_eq!(frame.color()[(3, 2)], [48, 40, 9]);
    assert_eq!(frame.depth()[(3, 2)], 1.203);
}

#[test]
fn settings_for_topics_are_for_recordings_only() {
    let settings = DatasetSettings::default().with(|s| s.pose = Some("/odom".to_owned()));
    let error = open_scene("synthetic", &settings).unwrap_err().to_string();
    assert_eq!(
        error,
        "dataset.pose is \"/odom\", expected no value for synthetic, whose format is synthetic: only mcap, db3, bag and mkv have topics"
    );
}

#[test]
fn a_summary_lists_all_topics() {
    let summary = RecordingSummary::read(&data("encodings.mcap"), &DatasetSettings::default()).unwrap();
    assert_eq!(summary.topics.len(), 24);
    assert!(summary.scene.is_err() && summary.damage.is_empty());
    let chatter = summary.topics.iter().find(|topic| topic.name == "/chatter").unwrap();
    assert_eq!(
        (chatter.type_name.as_str(), chatter.messages, chatter.images.as_ref()),
        ("std_msgs/msg/String", 1, None)
    );
    let summary = RecordingSummary::read(&data("room.mcap"), &DatasetSettings::default()).unwrap();
    assert_eq!(summary.scene.unwrap().count, 4);
    let tf = summary.topics.iter().find(|topic| topic.name == "/tf").unwrap();
    assert_eq!((tf.messages, tf.unreadable.is_none()), (10, true));
}

/// Files from ROS 2's own tests. The expected numbers are those from Foxglove's Python reader.
#[test]
fn recordings_of_rosbag2_are_read() {
    let topics = |name: &str| -> Vec<(String, String, u64)> {
        let summary = RecordingSummary::read(&data("rosbag2").join(name), &DatasetSettings::default()).unwrap();
        assert!(summary.damage.is_empty() && summary.scene.is_err(), "{:?}", summary.damage);
        let mut topics: Vec<_> =
            summary.topics.into_iter().map(|topic| (topic.name, topic.type_name, topic.messages)).collect();
        topics.sort();
        topics
    };
    let of = |name: &str, type_name: &str, messages| (name.to_owned(), type_name.to_owned(), messages);
    assert_eq!(
        topics("talker.mcap"),
        [
            of("/parameter_events", "rcl_interfaces/msg/ParameterEvent", 0),
            of("/rosout", "rcl_interfaces/msg/Log", 10),
            of("/topic", "std_msgs/msg/String", 10),
        ]
    );
    assert_eq!(
        topics("cdr_test_0.mcap"),
        [of("/array_topic", "test_msgs/msg/Arrays", 4), of("/test_topic", "test_msgs/msg/BasicTypes", 3)]
    );
    assert_eq!(
        topics("topics_and_services.mcap"),
        [
            of("/add_two_ints/_service_event", "example_interfaces/srv/AddTwoInts_Event", 6),
            of("/add_two_ints2/_service_event", "example_interfaces/srv/AddTwoInts_Event", 0),
            of("/events/write_split", "rosbag2_interfaces/msg/WriteSplitEvent", 0),
            of("/parameter_events", "rcl_interfaces/msg/ParameterEvent", 7),
            of("/rosout", "rcl_interfaces/msg/Log", 0),
        ]
    );
}
