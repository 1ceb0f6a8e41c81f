//! `run --save-mcap`: runs saved as recordings for robotics viewers.

use crate::support;
use crate::support::{Ended, ROOM, file_names, finish, splatseg};
use glam::{DQuat, DVec3, Quat, Vec3};
use serde_json::Value;
use splatseg_dataset::{DatasetSettings, RecordingScene, RecordingSummary, Scene, open_scene, read_segments_png};
use splatseg_geometry::SegmentId;
use splatseg_objects::{ObjectList, OrientedBox};
use splatseg_output::segment_color;
use splatseg_ros::{CameraInfo, CompressedImage, Image, MarkerArray, PointCloud2, TfMessage, from_cdr, marker_type};
use splatseg_test_scenes::without_chunks;
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

const FRAMES: usize = 18;
/// Time between frames of a scene without times, nanoseconds.
const INTERVAL: u64 = 33_333_333;
const IMAGES: [&str; 4] = ["/splatseg/camera_info", "/splatseg/overlay", "/splatseg/segments", "/tf"];

fn run(scene: &Path, out: &Path, recording: &Path, more: &[&str]) -> Ended {
    let mut command = splatseg();
    command.arg("run").arg(scene).arg("--out").arg(out).arg("--save-mcap").arg(recording);
    finish(command.args(["--threads", "2", "--no-page"]).args(more))
}

/// Returns the messages of each topic, in file order.
fn messages(file: &Path) -> BTreeMap<String, Vec<mcap::Message<'static>>> {
    let bytes = fs::read(file).unwrap();
    let mut topics: BTreeMap<String, Vec<mcap::Message<'static>>> = BTreeMap::new();
    for message in mcap::MessageStream::new(&without_chunks(&bytes)).unwrap() {
        let message = message.unwrap();
        topics.entry(message.channel.topic.clone()).or_default().push(message);
    }
    let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
    let count = topics.values().map(Vec::len).sum::<usize>() as u64;
    assert_eq!(summary.stats.unwrap().message_count, count, "the index knows all messages");
    topics
}

fn objects(out: &Path) -> ObjectList {
    serde_json::from_str(&fs::read_to_string(out.join("objects.json")).unwrap()).unwrap()
}

fn position(value: &Value) -> DVec3 {
    ["x", "y", "z"].map(|axis| value[axis].as_f64().unwrap()).into()
}

fn vector(value: &Value) -> Vec3 {
    ["x", "y", "z"].map(|axis| value[axis].as_f64().unwrap() as f32).into()
}

#[test]
fn a_recording_has_the_images_the_map_and_the_boxes_of_the_run() {
    let folder = tempfile::tempdir().unwrap();
    let (out, file) = (folder.path().join("out"), folder.path().join("new/run.mcap"));
    let ended = run(Path::new(ROOM), &out, &file, &["--segmenter", "oracle"]);
    assert_eq!(ended.code, 0, "{}", ended.err);
    assert!(ended.out.contains("run.mcap: open it in Foxglove or Rerun"), "{}", ended.out);
    let topics = messages(&file);
    let expected: BTreeSet<&str> =
        IMAGES.into_iter().chain(["/splatseg/boxes", "/splatseg/markers", "/splatseg/points"]).collect();
    assert_eq!(topics.keys().map(String::as_str).collect::<BTreeSet<_>>(), expected);
    for topic in IMAGES {
        let times: Vec<u64> = topics[topic].iter().map(|message| message.log_time).collect();
        assert_eq!(times, (1..=FRAMES as u64).map(|number| number * INTERVAL).collect::<Vec<_>>(), "{topic}");
    }
    let summary = RecordingSummary::read(&file, &DatasetSettings::default()).unwrap();
    assert_eq!((summary.topics.len(), summary.damage.len()), (7, 0));
    assert!(summary.topics.iter().all(|topic| topic.unreadable.is_none()), "{:?}", summary.topics);

    check_images(&topics, &out);
    check_points(&topics["/splatseg/points"], &out);
    check_boxes(&topics, &objects(&out));
    let again = folder.path().join("again.mcap");
    assert_eq!(run(Path::new(ROOM), &folder.path().join("other"), &again, &["--segmenter", "oracle"]).code, 0);
    assert!(fs::read(&file).unwrap() == fs::read(&again).unwrap(), "the same run gives other bytes");
}

/// Asserts that the images equal those of the folder, and the camera that of the scene.
fn check_images(topics: &BTreeMap<String, Vec<mcap::Message<'static>>>, out: &Path) {
    let scene = open_scene(ROOM, &DatasetSettings::default()).unwrap();
    for (index, name) in file_names(&out.join("segments")).iter().enumerate() {
        let ids: Image<'_> = from_cdr(&topics["/splatseg/segments"][index].data).unwrap();
        let map = read_segments_png(&out.join("segments").join(name)).unwrap();
        assert_eq!((ids.width as usize, ids.height as usize, ids.encoding), (map.width(), map.height(), "16UC1"));
        let decoded: Vec<SegmentId> =
            ids.data.as_chunks().0.iter().map(|pixel| u16::from_le_bytes(*pixel).into()).collect();
        assert!(decoded == map.pixels(), "{name}");
        let overlay: CompressedImage<'_> = from_cdr(&topics["/splatseg/overlay"][index].data).unwrap();
        let jpeg = fs::read(out.join("overlay").join(name).with_extension("jpg")).unwrap();
        assert!(overlay.data == jpeg && overlay.format == "jpeg", "{name}");

        let frame = scene.read_frame(index).unwrap();
        let info: CameraInfo = from_cdr(&topics["/splatseg/camera_info"][index].data).unwrap();
        let [fx, fy, cx, cy] = [0, 4, 2, 5].map(|entry| info.k[entry] as f32);
        let camera = frame.intrinsics();
        assert_eq!([fx, fy, cx, cy], [camera.fx, camera.fy, camera.cx, camera.cy]);
        assert_eq!((info.width, info.height, info.p[5]), (ids.width, ids.height, info.k[4]));
        let tf: TfMessage = from_cdr(&topics["/tf"][index].data).unwrap();
        let [transform] = tf.transforms.as_slice() else { panic!("{} transforms", tf.transforms.len()) };
        assert_eq!((transform.header.frame_id.as_str(), transform.child_frame_id.as_str()), ("world", "camera"));
        for header in [&ids.header, &overlay.header, &info.header] {
            assert_eq!((header.stamp, header.frame_id.as_str()), (transform.header.stamp, "camera"));
        }
        let (at, turn) = (&transform.transform.translation, &transform.transform.rotation);
        let point = DQuat::from_xyzw(turn.x, turn.y, turn.z, turn.w) * DVec3::new(0.3, -0.2, 1.0);
        let point = point + DVec3::new(at.x, at.y, at.z);
        assert!((frame.world_from_camera().to_world(Vec3::new(0.3, -0.2, 1.0)) - point).length() < 1e-5);
    }
}

/// Asserts that there is a point for each Gaussian, in the colour of its object.
fn check_points(messages: &[mcap::Message<'static>], out: &Path) {
    let [message] = messages else { panic!("{} messages", messages.len()) };
    assert_eq!(message.log_time, INTERVAL);
    let cloud: PointCloud2<'_> = from_cdr(&message.data).unwrap();
    let names: Vec<&str> = cloud.fields.iter().map(|field| field.name.as_str()).collect();
    assert_eq!(names, ["x", "y", "z", "rgb", "segment_id", "colors"]);
    assert_eq!(cloud.data.len(), cloud.width as usize * cloud.point_step as usize);
    let gaussians = &support::read_json(&out.join("summary.json"))["gaussians"];
    assert_eq!(*gaussians, cloud.width);
    let mut counts: BTreeMap<SegmentId, usize> = BTreeMap::new();
    for [_, _, _, color, id, rgba] in cloud.data.as_chunks::<4>().0.as_chunks().0 {
        let id = SegmentId::from_le_bytes(*id);
        *counts.entry(id).or_default() += 1;
        let [red, green, blue] = if id == 0 { [128; 3] } else { segment_color(id) };
        assert_eq!(u32::from_le_bytes(*color), u32::from_be_bytes([0, red, green, blue]));
        assert_eq!(u32::from_le_bytes(*rgba), u32::from_be_bytes([red, green, blue, 255]));
    }
    counts.remove(&0);
    let list = objects(out);
    let shapes = list.all().filter_map(|object| Some((object.id, object.shape.as_ref()?.points)));
    assert_eq!(counts, shapes.collect());
}

/// Asserts that the boxes equal those of `objects.json`, from the object's first sighting on, in both forms.
fn check_boxes(topics: &BTreeMap<String, Vec<mcap::Message<'static>>>, list: &ObjectList) {
    let (updates, markers) = (&topics["/splatseg/boxes"], &topics["/splatseg/markers"]);
    assert_eq!(updates.len(), markers.len());
    assert_eq!(updates[0].channel.schema.as_ref().unwrap().name, "foxglove.SceneUpdate");
    for (update, markers) in updates.iter().zip(markers) {
        let until = update.log_time;
        let expected: BTreeMap<SegmentId, (OrientedBox, u64)> = list
            .objects
            .iter()
            .filter_map(|object| {
                let first = (object.first_frame.as_ref()?.number as u64 + 1) * INTERVAL;
                Some((object.id, (object.shape.as_ref()?.oriented_box, first)))
            })
            .filter(|(_, (_, first))| *first <= until)
            .collect();
        let markers: MarkerArray<'_> = from_cdr(&markers.data).unwrap();
        assert_eq!(markers.markers.len(), 2 * expected.len());
        for marker in &markers.markers {
            let (shape, first) = &expected[&(marker.id as SegmentId)];
            assert_eq!(marker.header.stamp.nanoseconds() as u64, *first);
            let at = &marker.pose.position;
            assert_eq!(DVec3::new(at.x, at.y, at.z), shape.center);
            if marker.kind == marker_type::CUBE {
                let (turn, size) = (&marker.pose.orientation, &marker.scale);
                assert_eq!(DVec3::new(size.x, size.y, size.z).as_vec3(), shape.size);
                assert_eq!(DQuat::from_xyzw(turn.x, turn.y, turn.z, turn.w).as_quat(), shape.rotation);
            } else {
                assert_eq!((marker.kind, &marker.text), (marker_type::TEXT_VIEW_FACING, &marker.id.to_string()));
            }
        }
        let update: Value = serde_json::from_slice(&update.data).unwrap();
        let entities = update["entities"].as_array().unwrap();
        assert_eq!(entities.len(), expected.len());
        for entity in entities {
            let (shape, first) = &expected[&entity["id"].as_str().unwrap().parse().unwrap()];
            let seconds = |part: &str| entity["timestamp"][part].as_u64().unwrap();
            assert_eq!(seconds("sec") * 1_000_000_000 + seconds("nsec"), *first);
            let cube = &entity["cubes"][0];
            let (turn, w) = (vector(&cube["pose"]["orientation"]), &cube["pose"]["orientation"]["w"]);
            assert_eq!((position(&cube["pose"]["position"]), vector(&cube["size"])), (shape.center, shape.size));
            assert_eq!(Quat::from_vec4(turn.extend(w.as_f64().unwrap() as f32)), shape.rotation);
            assert_eq!(entity["texts"][0]["text"], entity["id"]);
        }
    }
    let last: MarkerArray<'_> = from_cdr(&markers.last().unwrap().data).unwrap();
    assert_eq!(last.markers.len(), 2 * list.objects.iter().filter(|object| object.shape.is_some()).count());
}

#[test]
fn the_timestamps_equal_the_input() {
    let folder = tempfile::tempdir().unwrap();
    let input = Path::new(env!("CARGO_MANIFEST_DIR")).join("../dataset/tests/data/mcap/room.mcap");
    let (out, file) = (folder.path().join("out"), folder.path().join("run.mcap"));
    let ended = run(&input, &out, &file, &["--method", "fastsam"]);
    assert_eq!(ended.code, 0, "{}", ended.err);
    let topics = messages(&file);
    // Without a memory there is no map and no box.
    assert_eq!(topics.keys().collect::<Vec<_>>(), IMAGES);
    let scene = RecordingScene::open(&input, &DatasetSettings::default()).unwrap();
    for index in 0..4 {
        let stamp = scene.read_frame(index).unwrap().timestamp().unwrap();
        for (topic, messages) in &topics {
            assert_eq!(u128::from(messages[index].log_time), stamp.as_nanos(), "{topic}");
        }
        let ids: Image<'_> = from_cdr(&topics["/splatseg/segments"][index].data).unwrap();
        assert_eq!(ids.header.stamp.nanoseconds() as u128, stamp.as_nanos());
    }
    // Results are read as a scene only if they are named, with the ids in place of depth.
    let refused = RecordingScene::open(&file, &DatasetSettings::default()).unwrap_err().to_string();
    assert!(refused.ends_with("overlay and ids are results of splatseg, not images of a camera"), "{refused}");
    let named = DatasetSettings::default().with(|settings| {
        settings.color = Some("/splatseg/overlay".to_owned());
        settings.depth = Some("/splatseg/segments".to_owned());
    });
    let written = RecordingScene::open(&file, &named).unwrap();
    assert_eq!(written.frame_count(), 4);
    let (read, expected) = (written.read_frame(2).unwrap(), scene.read_frame(2).unwrap());
    assert_eq!((read.timestamp(), read.intrinsics()), (expected.timestamp(), expected.intrinsics()));
    let moved = read.world_from_camera().inverse() * *expected.world_from_camera();
    assert!(moved.to_world(Vec3::ONE).distance(DVec3::ONE) < 1e-5);
}

#[test]
fn a_recording_replaces_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let [out, file, input] = ["out", "run.mcap", "input.mcap"].map(|name| folder.path().join(name));
    let recorded = Path::new(env!("CARGO_MANIFEST_DIR")).join("../dataset/tests/data/mcap/room.mcap");
    fs::copy(&recorded, &input).unwrap();
    let short = PathBuf::from("synthetic:frames=1,width=64,height=48,objects=2");
    let refused = |scene: &Path, file: &Path, more: &[&str], message: &str| {
        let before = fs::read(file).ok();
        let ended = run(scene, &out, file, more);
        assert_eq!(ended.code, 2, "{}", ended.err);
        assert!(ended.err.contains(message), "{}", ended.err);
        assert!(fs::read(file).ok() == before && !out.exists());
    };
    refused(&input, &input, &["--overwrite"], "input.mcap: is the scene");
    refused(&short, &input, &[], "input.mcap: exists: give --overwrite to replace it");
    refused(&short, &input, &["--overwrite"], "exists and is not a recording by splatseg");
    refused(&short, &out.join("objects.json"), &[], "is reserved for other results");
    refused(&short, &file, &["--save-coco", file.to_str().unwrap()], "is the file of --save-coco");
    for name in ["a.bag", "c.db3", "b"] {
        refused(&short, &folder.path().join(name), &[], &format!("{name}: expected a name that ends in .mcap"));
    }
    let options = ["--segmenter", "oracle"];
    assert_eq!(run(&short, &out, &file, &options).code, 0);
    let first = fs::read(&file).unwrap();
    assert!(splatseg_output::McapFile::STARTS.iter().any(|start| first.starts_with(start)));
    assert_eq!(run(&short, &out, &file, &[&options[..], &["--overwrite"]].concat()).code, 0);
    assert!(fs::read(&file).unwrap() == first);
}
