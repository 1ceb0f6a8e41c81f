//! Runs in world coordinates of seven digits, as in map projections.

use crate::support::{CLIP_PARTS, file_names, finish, read_json, splatseg};
use glam::DVec3;
use serde_json::Value;
use splatseg_dataset::{DatasetSettings, open_scene};
use splatseg_objects::ObjectList;
use splatseg_ros::{MarkerArray, PointCloud2, TfMessage, from_cdr};
use splatseg_test_scenes::{copy_demo_clip, without_chunks};
use std::fs;
use std::path::{Path, PathBuf};

/// UTM coordinates.
const OFFSET: DVec3 = DVec3::new(5e5, 5.4e6, 160.0);

/// Number of frames of the demo's scene.
const FRAMES: usize = 24;

/// Copies the beginning of the demo's scene with all cameras moved by `offset`.
fn scene(folder: &Path, offset: DVec3) -> PathBuf {
    copy_demo_clip(&CLIP_PARTS, FRAMES, folder);
    for name in file_names(&folder.join("pose")) {
        let path = folder.join("pose").join(name);
        let mut numbers: Vec<f64> =
            fs::read_to_string(&path).unwrap().split_whitespace().map(|number| number.parse().unwrap()).collect();
        (0..3).for_each(|axis| numbers[4 * axis + 3] += offset[axis]);
        fs::write(&path, numbers.iter().map(|number| format!("{number} ")).collect::<String>()).unwrap();
    }
    folder.to_owned()
}

struct Results {
    _folder: tempfile::TempDir,
    scene: PathBuf,
    out: PathBuf,
    memory: PathBuf,
    recording: PathBuf,
}

fn results(offset: DVec3) -> Results {
    let folder = tempfile::tempdir().unwrap();
    let scene = scene(&folder.path().join("scene"), offset);
    let place = |name: &str| folder.path().join(name);
    let (out, memory, recording) = (place("out"), place("memory.ply"), place("run.mcap"));
    let mut command = splatseg();
    command.arg("run").arg(&scene).arg("--out").arg(&out).arg("--save-memory").arg(&memory);
    let ended = finish(command.arg("--save-mcap").arg(&recording));
    assert_eq!(ended.code, 0, "{}", ended.err);
    Results { scene, out, memory, recording, _folder: folder }
}

fn objects(out: &Path) -> ObjectList {
    serde_json::from_str(&fs::read_to_string(out.join("objects.json")).unwrap()).unwrap()
}

/// Returns the text header of a PLY file.
fn header(path: &Path) -> String {
    let text = String::from_utf8_lossy(&fs::read(path).unwrap()).into_owned();
    text.split("end_header").next().unwrap().to_owned()
}

fn run_data(out: &Path) -> Value {
    let text = fs::read_to_string(out.join("viewer/run.js")).unwrap();
    serde_json::from_str(text.trim_start_matches("var splatsegRun=").trim_end().trim_end_matches(';')).unwrap()
}

#[test]
fn results_far_from_the_origin_are_the_same_in_world_coordinates() {
    let (near, far) = (results(DVec3::ZERO), results(OFFSET));
    for name in file_names(&near.out.join("segments")) {
        let ids = |out: &Path| fs::read(out.join("segments").join(&name)).unwrap();
        assert!(ids(&near.out) == ids(&far.out), "{name}");
    }
    let (expected, found) = (objects(&near.out).objects, objects(&far.out).objects);
    assert_eq!(found.len(), expected.len());
    for (found, expected) in found.iter().zip(&expected) {
        let (Some(found), Some(expected)) = (&found.shape, &expected.shape) else { continue };
        assert!((found.centroid - expected.centroid - OFFSET).length() < 3e-4, "{found:?}");
        assert!((found.oriented_box.center - expected.oriented_box.center - OFFSET).length() < 3e-4, "{found:?}");
        assert!((found.axis_aligned_box.min - expected.axis_aligned_box.min - OFFSET).length() < 3e-4, "{found:?}");
    }
    assert!(!header(&near.memory).contains("origin"), "world coordinates");
    assert!(header(&far.memory).contains("\ncomment origin 500000 5400000 160\n"), "{}", header(&far.memory));
    let (expected, found) = (run_data(&near.out), run_data(&far.out));
    assert_eq!(found["origin"], serde_json::json!([5e5, 5.4e6, 160.0]));
    assert_eq!((&found["poses"], &found["map"]), (&expected["poses"], &expected["map"]));
    assert_eq!(
        read_json(&near.out.join("summary.json"))["gaussians"],
        read_json(&far.out.join("summary.json"))["gaussians"]
    );
}

#[test]
fn recordings_have_the_worlds_coordinates_with_double_precision() {
    let far = results(OFFSET);
    let bytes = without_chunks(&fs::read(&far.recording).unwrap());
    let messages: Vec<mcap::Message<'_>> = mcap::MessageStream::new(&bytes).unwrap().map(Result::unwrap).collect();
    let of = |topic: &str| messages.iter().filter(|message| message.channel.topic == topic).collect::<Vec<_>>();
    let scene = open_scene(&far.scene, &DatasetSettings::default()).unwrap();
    for (index, message) in of("/tf").into_iter().enumerate() {
        let tf: TfMessage = from_cdr(&message.data).unwrap();
        let at = &tf.transforms[0].transform.translation;
        let expected = scene.read_frame(index).unwrap().world_from_camera().translation();
        assert_eq!(DVec3::new(at.x, at.y, at.z), expected);
    }
    let [origin] = of("/tf_static")[..] else { panic!("one static transform") };
    let origin: TfMessage = from_cdr(&origin.data).unwrap();
    let cloud: PointCloud2<'_> = from_cdr(&of("/splatseg/points")[0].data).unwrap();
    assert_eq!(origin.transforms[0].child_frame_id, cloud.header.frame_id);
    assert_eq!(origin.transforms[0].header.frame_id, "world");
    let at = &origin.transforms[0].transform.translation;
    assert_eq!(DVec3::new(at.x, at.y, at.z), OFFSET);
    let markers: MarkerArray<'_> = from_cdr(&of("/splatseg/markers").last().unwrap().data).unwrap();
    for object in objects(&far.out).objects {
        let Some(shape) = object.shape else { continue };
        let marker = markers.markers.iter().find(|marker| marker.id == object.id as i32).unwrap();
        let at = &marker.pose.position;
        assert_eq!(DVec3::new(at.x, at.y, at.z), shape.oriented_box.center);
    }
}

#[test]
fn a_far_memory_is_exported_and_continued() {
    let far = results(OFFSET);
    let folder = tempfile::tempdir().unwrap();
    let export = |form: &str| {
        let path = folder.path().join(format!("{form}.ply"));
        let mut command = splatseg();
        command.arg("export").arg(&far.memory).arg("--out").arg(&path).args(["--as", form]);
        let ended = finish(&mut command);
        assert_eq!(ended.code, 0, "{}", ended.err);
        header(&path)
    };
    assert!(export("points").contains("\nproperty double x\n"));
    assert!(export("gaussians").contains("\ncomment origin 500000 5400000 160\n"));
    let again = folder.path().join("again");
    let mut command = splatseg();
    command.arg("run").arg(&far.scene).arg("--out").arg(&again).arg("--load-memory").arg(&far.memory);
    let ended = finish(&mut command);
    assert_eq!(ended.code, 0, "{}", ended.err);
    let ids = |out: &Path| objects(out).objects.len();
    assert!(ids(&again) <= ids(&far.out) + 2, "{} objects, {} before", ids(&again), ids(&far.out));
}
