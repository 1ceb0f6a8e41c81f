//! Corrected paths in recordings: the corrections reach the stream with the frames after which they were published.

use crate::support::mcap::{
    ALL, FRAME_NS, McapWriter, OPTICAL, Parts, START, header, transform, without_checksums, write_frames,
};
use crate::support::recording::recording;
use glam::{DQuat, DVec3};
use proptest::prelude::*;
use splatseg_dataset::{
    CorrectedPose, DatasetSettings, FrameStream, GroundTruth, RecordingScene, Scene, StreamedFrame,
};
use splatseg_geometry::{Pose, RgbdFrame};
use splatseg_ros::{NavPath, Point, PoseMessage, PoseStamped, Quaternion};
use std::fs;
use std::sync::{Arc, OnceLock};

const FRAMES: usize = 8;
const PATH: &str = "/mapPath";

fn frames() -> &'static [RgbdFrame<'static>] {
    static ROOM: OnceLock<Vec<RgbdFrame<'static>>> = OnceLock::new();
    ROOM.get_or_init(|| {
        recording("synthetic:frames=8,width=16,height=12,seed=3").into_iter().map(|(frame, _)| frame).collect()
    })
}

fn stamp(index: usize) -> i64 {
    START + index as i64 * FRAME_NS
}

fn pose_at(stamp: i64, pose: &Pose) -> PoseStamped {
    let [x, y, z, w] = DQuat::from_mat3(&pose.rotation()).to_array();
    let position = pose.translation();
    let position = Point { x: position.x, y: position.y, z: position.z };
    PoseStamped {
        header: header(stamp, "world"),
        pose: PoseMessage { position, orientation: Quaternion { x, y, z, w } },
    }
}

fn shifted(shift: DVec3) -> Pose {
    Pose::from_quaternion(shift, DQuat::IDENTITY).unwrap()
}

/// Returns a path through the cameras of some frames, displaced.
fn path(world: &str, cameras: impl IntoIterator<Item = usize>, shift: DVec3) -> NavPath {
    let pose = |index: usize| pose_at(stamp(index), &(shifted(shift) * *frames()[index].world_from_camera()));
    NavPath { header: header(START, world), poses: cameras.into_iter().map(pose).collect() }
}

/// Writes a recording and paths, recorded half a frame after the frame of the index.
fn written(paths: &[(&str, usize, NavPath)], parts: Parts, more: impl FnOnce(&mut McapWriter)) -> Vec<u8> {
    let mut writer = McapWriter::new();
    more(&mut writer);
    let all: Vec<&RgbdFrame> = frames().iter().collect();
    write_frames(&mut writer, &all, parts);
    for (topic, index, path) in paths {
        writer.write(topic, path, stamp(*index) + FRAME_NS / 2);
    }
    writer.finish()
}

fn opened(bytes: &[u8], settings: &DatasetSettings) -> Result<RecordingScene, String> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    fs::write(&path, bytes).unwrap();
    RecordingScene::open(&path, settings).map_err(|error| error.to_string())
}

/// Returns the corrections of each frame, as frame and displacement along x.
fn found(scene: &RecordingScene) -> Vec<Vec<(usize, f64)>> {
    let displacement = |corrected: &CorrectedPose| {
        let was = frames()[corrected.frame].world_from_camera();
        let moved = corrected.world_from_camera.translation() - was.translation();
        assert!(moved.y.abs() < 1e-6 && moved.z.abs() < 1e-6, "{moved}");
        (corrected.frame, (moved.x * 1e3).round() / 1e3)
    };
    (0..FRAMES).map(|index| scene.corrections(index..index + 1).iter().map(displacement).collect()).collect()
}

fn source(scene: &RecordingScene) -> String {
    scene.sources().iter().find(|line| line.starts_with("corrected")).cloned().unwrap_or_default()
}

const X: DVec3 = DVec3::X;

#[test]
fn corrections_come_with_the_next_frame_and_once() {
    let paths = [
        (PATH, 1, path("world", [0, 1], DVec3::ZERO)),
        (PATH, 3, path("world", [0, 2, 3], 0.2 * X)),
        (PATH, 4, path("world", [0, 2, 3], 0.2009 * X)),
        (PATH, 5, path("world", [0, 4], 0.3 * X)),
        // After the last frame.
        (PATH, 7, path("world", [1], 0.9 * X)),
    ];
    let scene = opened(&written(&paths, ALL, |_| {}), &DatasetSettings::default()).unwrap();
    let mut expected = vec![Vec::new(); FRAMES];
    expected[4] = vec![(0, 0.2), (2, 0.2), (3, 0.2)];
    expected[6] = vec![(0, 0.3), (4, 0.3)];
    assert_eq!(found(&scene), expected);
    assert_eq!(source(&scene), format!("corrected poses: /mapPath (nav_msgs/msg/Path) of {OPTICAL}: 4 frames"));
    let all: Vec<usize> = scene.corrections(0..FRAMES).iter().map(|corrected| corrected.frame).collect();
    assert_eq!(all, [0, 2, 3, 4]);
}

#[test]
fn paths_of_the_robots_base_are_converted_to_the_camera() {
    let mount = Pose::from_quaternion(DVec3::new(0.1, -0.2, 0.4), DQuat::from_rotation_x(-1.5)).unwrap();
    let turn = DQuat::from_mat3(&mount.rotation());
    let base = |index: usize| shifted(0.2 * X) * *frames()[index].world_from_camera() * mount.inverse();
    let poses = [0, 2].map(|index| pose_at(stamp(index), &base(index))).to_vec();
    let corrected = NavPath { header: header(START, "/world"), poses };
    let bytes = written(&[(PATH, 3, corrected)], Parts { poses: false, ..ALL }, |writer| {
        writer.write("/tf_static", &transform(START, "base", OPTICAL, mount.translation(), turn), START);
        for (frame, index) in frames().iter().zip(0..) {
            let pose = *frame.world_from_camera() * mount.inverse();
            let turn = DQuat::from_mat3(&pose.rotation());
            writer.write("/tf", &transform(stamp(index), "world", "base", pose.translation(), turn), stamp(index));
        }
    });
    let scene = opened(&bytes, &DatasetSettings::default()).unwrap();
    assert_eq!(source(&scene), "corrected poses: /mapPath (nav_msgs/msg/Path) of base: 2 frames");
    assert_eq!(found(&scene)[4], [(0, 0.2), (2, 0.2)]);
    let of_camera = DatasetSettings::default().with(|settings| settings.pose_frame = Some(OPTICAL.to_owned()));
    assert!(source(&opened(&bytes, &of_camera).unwrap()).contains(&format!("of {OPTICAL}: 2 frames")));
}

#[test]
fn other_paths_correct_nothing() {
    let none = |paths: &[(&str, usize, NavPath)], expected: &str| {
        let scene = opened(&written(paths, ALL, |_| {}), &DatasetSettings::default()).unwrap();
        assert!(found(&scene).iter().all(Vec::is_empty) && source(&scene).contains(expected), "{}", source(&scene));
    };
    none(&[], "");
    let mut plan = path("world", [0, 1, 2], 2.0 * X);
    plan.poses.iter_mut().for_each(|pose| pose.header.stamp = header(stamp(2), "").stamp);
    none(&[("/plan", 3, plan.clone())], "");
    plan.poses.iter_mut().for_each(|pose| pose.header.stamp = header(0, "").stamp);
    none(&[("/plan", 3, plan)], "");
    let mut apart = path("world", [0, 1, 2], X);
    apart.poses.iter_mut().for_each(|pose| pose.header.stamp.nanosec += 30_000_000);
    none(&[(PATH, 3, apart)], "none of the frames");
    none(&[(PATH, 3, path("odom", [0, 1], X))], "none: /mapPath is in odom, the poses are in world");
    none(&[(PATH, 2, path("world", [4, 5], X))], "none of the frames");
    let mut lost = path("world", [0, 1], X);
    lost.poses.iter_mut().for_each(|pose| pose.pose.position.x = f64::NAN);
    none(&[(PATH, 3, lost)], "");
}

#[test]
fn one_of_several_topics_is_chosen() {
    let paths = [(PATH, 3, path("world", [0, 1], X)), ("/other", 3, path("world", [0], 0.5 * X))];
    let bytes = written(&paths, ALL, |_| {});
    let open = |name: Option<&str>| {
        let corrections = name.map(str::to_owned);
        opened(&bytes, &DatasetSettings::default().with(|settings| settings.corrections = corrections))
    };
    let expected = "corrected poses: none: choose one of /mapPath, /other with --set dataset.corrections=TOPIC";
    assert_eq!(source(&open(None).unwrap()), expected);
    assert_eq!(found(&open(Some("other")).unwrap())[4], [(0, 0.5)]);
    assert_eq!(source(&open(Some("none")).unwrap()), "");
    let error = open(Some("/tf")).unwrap_err();
    assert!(error.contains("dataset.corrections: found \"/tf\", expected none, or a topic of paths"), "{error}");
}

#[test]
fn a_stream_delivers_the_corrections_of_its_frames() {
    let paths = [
        (PATH, 3, path("world", [0, 1, 2], 0.2 * X)),
        (PATH, 4, path("world", [2], 0.4 * X)),
        (PATH, 6, path("world", [4, 6], 0.1 * X)),
    ];
    let bytes = written(&paths, ALL, |_| {});
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("a.mcap");
    fs::write(&file, bytes).unwrap();
    let streamed = |settings: DatasetSettings, done: usize| -> Vec<(usize, Vec<usize>)> {
        let scene = Arc::new(RecordingScene::open(&file, &settings).unwrap());
        let of = |frame: StreamedFrame| (frame.index, frame.corrections.iter().map(|found| found.frame).collect());
        let stream = FrameStream::open_at(scene, &settings, GroundTruth::Skip, done).unwrap();
        stream
            .map(|frame| of(frame.unwrap()))
            .filter(|(_, corrections): &(usize, Vec<usize>)| !corrections.is_empty())
            .collect()
    };
    let every = |stride: usize| DatasetSettings::default().with(|settings| settings.stride = stride);
    assert_eq!(streamed(every(1), 0), [(4, vec![0, 1, 2]), (5, vec![2]), (7, vec![4, 6])]);
    // Also those that became known with a frame that is not selected.
    assert_eq!(streamed(every(2), 0), [(4, vec![0, 2]), (6, vec![2])]);
    assert_eq!(streamed(every(1), 5), [(5, vec![2]), (7, vec![4, 6])]);
    assert_eq!(streamed(every(1), 6), [(7, vec![4, 6])]);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn damaged_paths_never_panic(
        changes in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..20),
        in_the_end in any::<bool>(),
    ) {
        static BYTES: OnceLock<(Vec<u8>, usize)> = OnceLock::new();
        let paths = || [(PATH, 3, path("world", [0, 1, 2], X)), (PATH, 5, path("world", [0, 4], 2.0 * X))];
        let (bytes, end) = BYTES.get_or_init(|| {
            let [short, whole] = [written(&[], ALL, |_| {}), written(&paths(), ALL, |_| {})].map(without_checksums);
            (whole, short.len() / 2)
        });
        // The paths are in the last part.
        let mut damaged = bytes.clone();
        let from = if in_the_end { *end } else { 0 };
        for (at, value) in &changes {
            damaged[from + at.index(bytes.len() - from)] = *value;
        }
        if let Ok(scene) = opened(&damaged, &DatasetSettings::default()) {
            for index in 0..scene.frame_count() {
                prop_assert!(scene.corrections(index..index + 1).iter().all(|corrected| corrected.frame < index));
            }
        }
    }
}
