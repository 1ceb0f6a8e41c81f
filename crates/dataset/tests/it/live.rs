//! Messages matched into frames while they arrive: the same frames as from a recording, and what is late or wrong.

use crate::messages::{Received, messages};
use crate::support;
use crate::support::mcap::{
    FRAME_NS, McapWriter, OPTICAL, START, camera_transform, depth_bytes, header, info, raw, transform,
};
use crate::support::recording::{jpeg_bytes, recording};
use glam::{DQuat, DVec3};
use splatseg_dataset::{
    DatasetSettings, FrameMatcher, MatchLimits, RecordedFrame, RecordingScene, Scene, StreamedFrame, has_depth,
    lacks_depth_topic, open_scene,
};
use splatseg_geometry::RgbdFrame;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

const MS: i64 = 1_000_000;

fn settings(color: &str, depth: &str, pose: &str) -> DatasetSettings {
    let named = |name: &str| Some(name.to_owned());
    DatasetSettings::default().with(|s| (s.color, s.depth, s.pose) = (named(color), named(depth), named(pose)))
}

/// Settings for the recordings written here.
fn camera_settings() -> DatasetSettings {
    settings("/camera/image_raw/compressed", "/camera/depth", "/tf").with(|s| s.world_frame = Some("world".to_owned()))
}

fn no_frame_is_dropped() -> MatchLimits {
    MatchLimits { complete: 100, waiting: 100, ..MatchLimits::default() }
}

fn feed(matcher: &mut FrameMatcher, message: &Received) {
    matcher.feed(&message.topic, &message.type_name, &message.data, message.at);
}

fn take_all(matcher: &mut FrameMatcher, at: Duration) -> Vec<StreamedFrame> {
    std::iter::from_fn(|| matcher.take(at).map(|frame| frame.read().unwrap())).collect()
}

/// Feeds messages to a consumer that is always ready.
fn matched(
    messages: &[Received],
    settings: &DatasetSettings,
    limits: MatchLimits,
) -> (Vec<StreamedFrame>, FrameMatcher) {
    let mut matcher = FrameMatcher::new(settings, limits).unwrap();
    let mut frames = Vec::new();
    for message in messages {
        feed(&mut matcher, message);
        frames.extend(take_all(&mut matcher, message.at));
        assert_balance(&matcher);
    }
    matcher.flush();
    frames.extend(take_all(&mut matcher, Duration::ZERO));
    assert_balance(&matcher);
    (frames, matcher)
}

fn assert_balance(matcher: &FrameMatcher) {
    let counts = matcher.counts();
    assert_eq!(counts.messages, counts.images + counts.taken_in + counts.ignored + counts.damaged, "{counts}");
    let frames = counts.frames + counts.unreadable;
    assert_eq!(counts.images, 2 * frames + counts.dropped.total() + counts.waiting, "{counts:?}");
}

fn assert_same(frames: &[StreamedFrame], scene: &RecordingScene) {
    assert_eq!(frames.len(), scene.frame_count());
    for (index, streamed) in frames.iter().enumerate() {
        let RecordedFrame { frame, world_from_camera } = scene.read_recorded(index).unwrap();
        assert_eq!((streamed.index, &streamed.frame), (index, &frame));
        assert_eq!(streamed.world_from_camera, world_from_camera, "frame {index}");
    }
}

fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/mcap").join(name)
}

#[test]
fn recordings_of_other_programs_give_the_same_frames_as_a_stream() {
    let none = DatasetSettings::default();
    for (name, settings) in [
        ("room.mcap", none.clone()),
        ("room.mcap", none.clone().with(|settings| settings.depth_scale = Some(2000.0))),
        ("bag/bag.mcap", none),
        ("encodings.mcap", settings("/png", "/depth/compressed_rvl", "tf_static")),
    ] {
        let scene = RecordingScene::open(&data(name), &settings).unwrap();
        let (frames, matcher) = matched(&messages(&fs::read(data(name)).unwrap()), &settings, no_frame_is_dropped());
        assert_same(&frames, &scene);
        assert_eq!(matcher.sources(), &scene.sources()[..3]);
        assert!(matcher.undecided().is_none());
        assert_eq!((matcher.counts().dropped.total(), matcher.counts().waiting), (0, 0), "{}", matcher.counts());
    }
}

/// Messages of a camera without a depth sensor.
fn color_only() -> Vec<Received> {
    let all = messages(&fs::read(data("room.mcap")).unwrap());
    all.into_iter().filter(|message| !message.topic.contains("depth")).collect()
}

#[test]
fn a_camera_without_depth_gives_its_colour_images_if_the_settings_say_so() {
    let none = DatasetSettings::default().with(|settings| settings.depth = Some("none".to_owned()));
    let scene = RecordingScene::open(&data("room.mcap"), &none).unwrap();
    assert!(!scene.has_depth() && !has_depth(&data("room.mcap"), &none));
    let whole = RecordingScene::open(&data("room.mcap"), &DatasetSettings::default()).unwrap();
    assert_eq!(scene.frame_count(), whole.frame_count());
    for messages in [color_only(), messages(&fs::read(data("room.mcap")).unwrap())] {
        let mut matcher = FrameMatcher::new(&none, no_frame_is_dropped()).unwrap();
        messages.iter().for_each(|message| feed(&mut matcher, message));
        matcher.flush();
        let frames = std::iter::from_fn(|| matcher.take(Duration::ZERO));
        let frames: Vec<StreamedFrame> = frames
            .map(|frame| {
                assert_eq!(frame.images().count(), 1);
                frame.read().unwrap()
            })
            .collect();
        assert_same(&frames, &scene);
        assert_eq!(matcher.sources(), &scene.sources()[..3]);
        assert!(matcher.sources()[1].starts_with("depth: none"), "{:?}", matcher.sources());
        let counts = matcher.counts();
        assert_eq!((counts.images, counts.dropped.total(), counts.waiting), (counts.frames, 0, 0), "{counts:?}");
    }
    for (index, frame) in (0..scene.frame_count()).map(|index| (index, scene.read_recorded(index).unwrap().frame)) {
        assert_eq!(frame.color(), whole.read_recorded(index).unwrap().frame.color());
        assert!(frame.depth().pixels().iter().all(|depth| *depth == 0.0));
    }
}

#[test]
fn without_depth_a_slow_consumer_gets_the_newest_image() {
    let none = DatasetSettings::default().with(|settings| settings.depth = Some("none".to_owned()));
    let mut matcher = FrameMatcher::new(&none, MatchLimits::default()).unwrap();
    color_only().iter().for_each(|message| feed(&mut matcher, message));
    matcher.flush();
    let frames = take_all(&mut matcher, Duration::ZERO);
    let counts = matcher.counts();
    assert_eq!((frames.len(), counts.dropped.busy, counts.images), (1, 3, 4), "{counts:?}");
}

#[test]
fn a_missing_depth_sensor_is_told_with_the_option_that_helps() {
    let mut matcher = FrameMatcher::new(&DatasetSettings::default(), no_frame_is_dropped()).unwrap();
    color_only().iter().for_each(|message| feed(&mut matcher, message));
    matcher.flush();
    let told = matcher.undecided().unwrap().to_string();
    assert!(told.contains("depth images: found none") && told.contains("--depth none"), "{told}");
    assert!(told.contains("--depth-weights") && !told.contains('\n'), "{told}");
    assert!(!lacks_depth_topic(&data("room.mcap"), &DatasetSettings::default()));
}

#[test]
fn a_consumer_that_waited_before_the_first_message_gets_the_same_poses() {
    let messages = messages(&fs::read(data("room.mcap")).unwrap());
    let poses = |is_waiting: bool| {
        let mut matcher = FrameMatcher::new(&DatasetSettings::default(), no_frame_is_dropped()).unwrap();
        if is_waiting {
            let first = messages[0].at;
            assert!(matcher.take(first - Duration::from_secs(10)).is_none() && matcher.take(first).is_none());
        }
        messages.iter().for_each(|message| feed(&mut matcher, message));
        matcher.flush();
        let frames = take_all(&mut matcher, Duration::ZERO);
        (frames.iter().map(|frame| frame.world_from_camera).collect::<Vec<_>>(), matcher.sources().to_vec())
    };
    let (expected, sources) = poses(false);
    assert!(expected.iter().any(Option::is_some));
    assert_eq!(poses(true), (expected, sources));
}

#[test]
fn a_consumer_that_is_always_ready_misses_nothing() {
    let settings = settings("camera/color/image_raw/compressed", "aligned_depth_to_color", "/tf").with(|s| {
        s.depth = Some("/camera/aligned_depth_to_color/image_raw/compressedDepth".to_owned());
        s.world_frame = Some("map".to_owned());
    });
    let scene = RecordingScene::open(&data("room.mcap"), &settings).unwrap();
    let messages = messages(&fs::read(data("room.mcap")).unwrap());
    let (frames, matcher) = matched(&messages, &settings, MatchLimits::default());
    assert_same(&frames, &scene);
    assert_eq!(matcher.counts().to_string(), "4 frames of 27 messages; 4 messages of other topics");
}

/// A frame's images, and when they and a pose of their time are received, nanoseconds.
#[derive(Clone, Copy)]
struct Times {
    color: i64,
    depth: i64,
    pose: i64,
    received: i64,
    pose_received: i64,
}

fn times(count: i64) -> Vec<Times> {
    let at = |index: i64| START + index * FRAME_NS;
    let times = |index| Times {
        color: at(index),
        depth: at(index),
        pose: at(index),
        received: at(index) + 30 * MS,
        pose_received: at(index) + 10 * MS,
    };
    (0..count).map(times).collect()
}

fn frames_of_a_room(count: usize) -> Vec<RgbdFrame<'static>> {
    let text = format!("synthetic:frames={count},width=16,height=12,seed=3");
    recording(&text).into_iter().map(|(frame, _)| frame).collect()
}

/// Returns a recording with these times, in the order of receipt.
fn written(times: &[Times]) -> Vec<u8> {
    let frames = frames_of_a_room(times.len());
    let mut order: Vec<(i64, usize, bool)> = Vec::new();
    for (index, times) in times.iter().enumerate() {
        order.extend([(times.received, index, false), (times.pose_received, index, true)]);
    }
    order.sort_by_key(|(received, ..)| *received);
    let mut writer = McapWriter::new();
    for (received, index, is_pose) in order {
        let (frame, times) = (&frames[index], times[index]);
        if is_pose {
            writer.write("/tf", &camera_transform(times.pose, "world", OPTICAL, frame), received);
            continue;
        }
        writer.write("/camera/camera_info", &info(times.color, OPTICAL, frame.intrinsics()), received);
        let depth = depth_bytes(frame);
        writer.write("/camera/depth", &raw(times.depth, OPTICAL, "16UC1", frame.depth().size(), &depth), received);
        let jpeg = jpeg_bytes(frame.color());
        let color = splatseg_ros::CompressedImage { header: header(times.color, OPTICAL), format: "jpeg", data: &jpeg };
        writer.write("/camera/image_raw/compressed", &color, received);
    }
    writer.finish()
}

/// Compares a stream with the recording of the same messages.
fn same_as_recorded(times: &[Times]) -> FrameMatcher {
    let bytes = written(times);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    fs::write(&path, &bytes).unwrap();
    let scene = RecordingScene::open(&path, &camera_settings()).unwrap();
    let (frames, matcher) = matched(&messages(&bytes), &camera_settings(), no_frame_is_dropped());
    assert_same(&frames, &scene);
    matcher
}

#[test]
fn poses_that_come_later_are_waited_for_and_interpolated() {
    let mut times = times(20);
    for (times, late) in times.iter_mut().zip([0, 90, 150, 100, 50].into_iter().cycle()) {
        times.pose += 20 * MS; // After the image, so that it is interpolated.
        times.pose_received += late * MS;
    }
    let matcher = same_as_recorded(&times);
    assert_eq!((matcher.counts().frames, matcher.counts().without_pose), (20, 0));
    // A pose before the image is near enough, but the next one makes a better one.
    times.iter_mut().for_each(|times| times.pose -= 30 * MS);
    same_as_recorded(&times);
}

/// At 90 Hz, more frames than usually may wait come before topics are chosen, and before the pose of one arrives.
#[test]
fn a_consumer_that_must_not_miss_frames_gets_those_of_the_start() {
    let mut times = times(240);
    for (times, index) in times.iter_mut().zip(0..) {
        let at = START + index * FRAME_NS / 9;
        (times.color, times.depth, times.pose) = (at, at, at);
        (times.received, times.pose_received) = (at + 10 * MS, at + 450 * MS);
    }
    let bytes = written(&times);
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("a.mcap"), &bytes).unwrap();
    let none = DatasetSettings::default();
    let scene = RecordingScene::open(folder.path(), &none).unwrap();
    let messages = messages(&bytes);
    // The second has no memory for two seconds of images, so topics are chosen earlier.
    for bytes in [MatchLimits::default().bytes, 64 << 10] {
        let limits = MatchLimits { bytes, ..MatchLimits::default() };
        let mut matcher = FrameMatcher::new(&none, MatchLimits { complete: 1000, ..limits }).unwrap().keeping_frames();
        let mut frames = Vec::new();
        for message in &messages {
            feed(&mut matcher, message);
            frames.extend(take_all(&mut matcher, message.at));
        }
        matcher.flush();
        frames.extend(take_all(&mut matcher, Duration::ZERO));
        assert_eq!(matcher.counts().dropped.total(), 0, "{}", matcher.counts());
        assert_same(&frames, &scene);
    }
    // A matcher that may miss frames counts them as early.
    let (_, matcher) = matched(&messages, &none, MatchLimits::default());
    let dropped = matcher.counts().dropped;
    assert!(dropped.early > 100 && dropped.unpaired == 0, "{}", matcher.counts());
}

#[test]
fn images_with_different_stamps_are_paired_as_in_a_recording() {
    let mut times = times(20);
    for (times, apart) in times.iter_mut().zip([0, 7, -13, 20, 25, 3].into_iter().cycle()) {
        times.depth += apart * MS;
    }
    let matcher = same_as_recorded(&times);
    assert_eq!((matcher.counts().frames, matcher.counts().dropped.unpaired), (17, 6), "{}", matcher.counts());
    // Depth before colour is near enough, but the next depth is nearer.
    for (times, index) in times.iter_mut().zip(0..) {
        times.color = START + 20 * index * MS;
        (times.depth, times.pose) = (times.color - 12 * MS, times.color);
        (times.received, times.pose_received) = (times.color + 5 * MS, times.color);
    }
    same_as_recorded(&times);
}

#[test]
fn depth_of_another_camera_is_registered_and_lenses_are_taken_out() {
    let camera = *frames_of_a_room(1)[0].intrinsics();
    let mut writer = McapWriter::new();
    for (child, x) in [("color", 0.0), ("depth", 0.02)] {
        let mount = transform(START, "base", child, DVec3::new(x, 0.0, 0.1), DQuat::from_rotation_z(0.1));
        writer.write("/tf_static", &mount, START);
    }
    for (frame, index) in frames_of_a_room(5).iter().zip(0..) {
        let (stamp, received) = (START + index * FRAME_NS, START + index * FRAME_NS + 20 * MS);
        for (topic, frame_id, camera) in [("/color", "color", camera), ("/depth", "depth", camera.resized(8, 6))] {
            let mut info = info(stamp, frame_id, &camera);
            info.d = vec![-0.2, 0.05, 0.001, 0.0, 0.0];
            writer.write(&format!("{topic}/camera_info"), &info, received);
        }
        let pixels = frame.color().pixels().as_flattened();
        writer.write("/color/image_raw", &raw(stamp, "color", "rgb8", (16, 12), pixels), received);
        let units: Vec<u8> = (0..48u16).flat_map(|place| (1500 + 10 * place).to_le_bytes()).collect();
        writer.write("/depth/image_raw", &raw(stamp, "depth", "16UC1", (8, 6), &units), received);
        writer.write("/tf", &camera_transform(stamp + 5 * MS, "map", "base", frame), received + 60 * MS);
    }
    let bytes = writer.finish();
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("a.mcap"), &bytes).unwrap();
    let scene = RecordingScene::open(folder.path(), &DatasetSettings::default()).unwrap();
    assert!(scene.sources()[1].ends_with(", registered to colour here"));
    assert_eq!((scene.frame_count(), scene.read_frame(0).unwrap().width()), (5, 8));
    let (frames, _) = matched(&messages(&bytes), &DatasetSettings::default(), no_frame_is_dropped());
    assert_same(&frames, &scene);
}

/// Real images of 640x480 pixels.
#[test]
fn a_real_recording_gives_the_same_frames_as_a_stream() {
    let test = "a_real_recording_gives_the_same_frames_as_a_stream";
    let Some(path) = support::shared_data(test, "redkitchen_dense") else { return };
    let kitchen = open_scene(path, &DatasetSettings::default()).unwrap();
    let mut writer = McapWriter::new();
    for index in 0..12i64 {
        let frame = kitchen.read_frame(index as usize).unwrap();
        let (stamp, size) = (START + index * FRAME_NS / 3, frame.color().size());
        writer.write("/camera/camera_info", &info(stamp, OPTICAL, frame.intrinsics()), stamp + 30 * MS);
        let depth = depth_bytes(&frame);
        writer.write("/camera/depth", &raw(stamp + 6 * MS, OPTICAL, "16UC1", size, &depth), stamp + 31 * MS);
        let pixels = frame.color().pixels().as_flattened();
        writer.write("/camera/image", &raw(stamp, OPTICAL, "rgb8", size, pixels), stamp + 32 * MS);
        writer.write("/tf", &camera_transform(stamp + 3 * MS, "world", OPTICAL, &frame), stamp + 33 * MS);
    }
    let bytes = writer.finish();
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("a.mcap"), &bytes).unwrap();
    let settings = settings("/camera/image", "/camera/depth", "/tf").with(|s| s.world_frame = Some("world".to_owned()));
    let scene = RecordingScene::open(folder.path(), &settings).unwrap();
    let (frames, matcher) = matched(&messages(&bytes), &settings, no_frame_is_dropped());
    assert_same(&frames, &scene);
    assert_eq!((frames.len(), matcher.counts().dropped.total()), (12, 0));
}

#[test]
fn the_newest_frame_wins_if_the_consumer_is_slow() {
    let messages = messages(&written(&times(20)));
    let mut matcher = FrameMatcher::new(&camera_settings(), MatchLimits::default()).unwrap();
    let mut stamps = Vec::new();
    for (number, message) in messages.iter().enumerate() {
        feed(&mut matcher, message);
        if number % 20 == 19 {
            stamps.extend(matcher.take(message.at).map(|frame| (frame.stamp() - START) / FRAME_NS));
        }
    }
    assert_eq!(stamps, [4, 9, 14, 19]);
    assert_eq!((matcher.counts().frames, matcher.counts().dropped.busy), (4, 32));
    assert_balance(&matcher);
}

#[test]
fn a_frame_whose_pose_does_not_come_is_given_without_one() {
    let mut times = times(20);
    times[8..].iter_mut().for_each(|times| times.pose_received += 3_000 * MS);
    let (frames, matcher) = matched(&messages(&written(&times)), &camera_settings(), no_frame_is_dropped());
    let posed = |frame: &StreamedFrame| frame.world_from_camera.is_some();
    assert_eq!(frames.len(), 20);
    assert!(frames[..8].iter().all(posed) && !frames[8..].iter().any(posed));
    assert_eq!(matcher.counts().without_pose, 12);
}

#[test]
fn a_simulation_that_starts_again_goes_on() {
    let mut times = times(48);
    for times in &mut times[24..] {
        for stamp in [&mut times.color, &mut times.depth, &mut times.pose] {
            *stamp -= 24 * FRAME_NS;
        }
    }
    let mut messages = messages(&written(&times));
    let all = frames_of_a_room(48);
    // With all poses, and with so few in the second run that their clock follows after that of the images.
    for every in [1, 3] {
        let mut poses = 0;
        messages.retain(|message| {
            poses += usize::from(message.topic == "/tf");
            message.topic != "/tf" || poses <= 24 || poses % every == 1 % every
        });
        let (frames, matcher) = matched(&messages, &camera_settings(), no_frame_is_dropped());
        assert_eq!((frames.len(), matcher.counts().clock_set_back), (48, 1), "{}", matcher.counts());
        // The frames of the second run have its poses, which are other ones at the same times.
        for (index, (streamed, frame)) in frames.iter().zip(&all).enumerate().filter(|(index, _)| index % every == 0) {
            let pose = streamed.world_from_camera.unwrap();
            let apart = pose.translation().distance(frame.world_from_camera().translation());
            assert!(apart < 1e-6, "frame {index}: {apart} m");
        }
    }
}

#[test]
fn a_wrong_stamp_costs_the_frame_that_has_it() {
    for wrong in [1, START + 3_600_000 * MS, START - 3_600_000 * MS] {
        for place in [1, 9, 18] {
            let mut times = times(20);
            (times[place].color, times[place].pose) = (wrong, wrong);
            let (frames, matcher) = matched(&messages(&written(&times)), &camera_settings(), MatchLimits::default());
            assert_eq!((frames.len(), matcher.counts().clock_set_back), (19, 0), "{}", matcher.counts());
            assert_eq!(matcher.counts().without_pose, 0, "{wrong} at {place}");
        }
    }
}

#[test]
fn topics_are_chosen_after_a_while_and_others_ignored() {
    let mut messages = messages(&written(&times(40)));
    let other = messages.iter().find(|message| message.type_name.ends_with("CompressedImage")).unwrap().clone();
    let mut settings = DatasetSettings::default();
    let (frames, matcher) = matched(&messages, &settings, no_frame_is_dropped());
    assert_eq!((frames.len(), matcher.counts().dropped.total()), (40, 0));
    messages.insert(0, Received { topic: "/left/image".to_owned(), ..other });
    let (frames, matcher) = matched(&messages, &settings, MatchLimits::default());
    assert!(frames.is_empty() && matcher.sources().is_empty());
    assert_eq!(
        matcher.undecided().unwrap().to_string(),
        "live: topics of colour images: found /left/image, /camera/image_raw/compressed, expected one: choose it with --color"
    );
    settings.color = Some("/camera/image_raw/compressed".to_owned());
    let (frames, matcher) = matched(&messages, &settings, no_frame_is_dropped());
    assert_eq!((frames.len(), matcher.counts().ignored), (40, 1), "{}", matcher.counts());
}

#[test]
fn colour_and_depth_of_one_topic_are_refused() {
    let wrong = camera_settings().with(|s| s.depth.clone_from(&s.color));
    let (frames, matcher) = matched(&messages(&written(&times(4))), &wrong, MatchLimits::default());
    let expected = "live: dataset.depth: found \"/camera/image_raw/compressed\", expected another topic than that of the \
                    colour images";
    assert_eq!((frames.len(), matcher.undecided().unwrap().to_string().as_str()), (0, expected));
}

#[test]
fn a_camera_info_of_zeros_is_damaged_and_the_next_one_used() {
    let mut messages = messages(&written(&times(4)));
    let camera = splatseg_geometry::Intrinsics { fx: 0.0, fy: 0.0, cx: 0.0, cy: 0.0, width: 16, height: 12 };
    let first = messages.iter().position(|message| message.topic == "/camera/camera_info").unwrap();
    let data = splatseg_ros::to_cdr(&info(START, OPTICAL, &camera)).unwrap();
    let zeros = Received { data, ..messages[first].clone() };
    messages.insert(0, zeros.clone());
    messages.insert(9, zeros);
    let (frames, matcher) = matched(&messages, &camera_settings(), MatchLimits::default());
    assert_eq!((frames.len(), matcher.counts().damaged), (4, 2), "{}", matcher.counts());
}

#[test]
fn a_damaged_image_is_counted() {
    let mut messages = messages(&written(&times(4)));
    let jpeg = messages.iter_mut().find(|message| message.type_name.ends_with("CompressedImage")).unwrap();
    let end = jpeg.data.len();
    jpeg.data[end - 200..].fill(0);
    let mut matcher = FrameMatcher::new(&camera_settings(), no_frame_is_dropped()).unwrap();
    messages.iter().for_each(|message| feed(&mut matcher, message));
    matcher.flush();
    let read = std::iter::from_fn(|| matcher.take(Duration::ZERO).map(|frame| frame.read().is_ok()));
    assert_eq!(read.collect::<Vec<_>>(), [false, true, true, true]);
    assert_eq!((matcher.counts().frames, matcher.counts().unreadable), (3, 1));
    assert_balance(&matcher);
}

#[test]
fn the_settings_frame_a_stream_as_a_recording() {
    let settings = camera_settings().with(|s| (s.resize, s.crop_border) = (Some("12x9".parse().unwrap()), 1));
    let (frames, _) = matched(&messages(&written(&times(2))), &settings, MatchLimits::default());
    assert_eq!((frames[0].frame.width(), frames[0].frame.height()), (10, 7));
    let wrong = DatasetSettings::default().with(|s| s.max_pose_gap_ms = -1.0);
    assert!(FrameMatcher::new(&wrong, MatchLimits::default()).is_err());
    assert!(open_scene(data("room.mcap"), &settings).is_err(), "topics of another recording");
}
