//! Trees of transforms that contradict themselves, or have the camera on top. The same from a file and as a stream.

use crate::support::mcap::{
    ALL, FRAME_NS, McapWriter, OPTICAL, Parts, START, depth_bytes, header, info, raw, transform, write_frames,
};
use crate::support::recording::recording;
use crate::support::two_ways::{Found, read};
use glam::{DQuat, DVec3};
use splatseg_dataset::DatasetSettings;
use splatseg_geometry::{Pose, RgbdFrame};
use splatseg_ros::{Odometry, Point, PoseMessage, PoseWithCovariance, Quaternion, TfMessage};
use std::sync::OnceLock;

const FRAMES: usize = 6;

fn frames() -> &'static [RgbdFrame<'static>] {
    static ROOM: OnceLock<Vec<RgbdFrame<'static>>> = OnceLock::new();
    ROOM.get_or_init(|| {
        recording("synthetic:frames=6,width=16,height=12,seed=3").into_iter().map(|(frame, _)| frame).collect()
    })
}

fn of_pose(stamp: i64, parent: &str, child: &str, pose: &Pose) -> TfMessage {
    transform(stamp, parent, child, pose.translation(), DQuat::from_mat3(&pose.rotation()))
}

/// Writes images without poses, and `moving` for each frame before its images.
fn written(fixed: &[TfMessage], moving: impl Fn(i64, &Pose) -> Vec<TfMessage>) -> Vec<u8> {
    let mut writer = McapWriter::new();
    for message in fixed {
        writer.write("/tf_static", message, START);
    }
    for (frame, index) in frames().iter().zip(0..) {
        let stamp = START + index * FRAME_NS;
        for message in moving(stamp, frame.world_from_camera()) {
            writer.write("/tf", &message, stamp);
        }
    }
    let all: Vec<&RgbdFrame> = frames().iter().collect();
    write_frames(&mut writer, &all, Parts { poses: false, ..ALL });
    writer.finish()
}

fn none() -> DatasetSettings {
    DatasetSettings::default()
}

fn named(change: impl FnOnce(&mut DatasetSettings)) -> DatasetSettings {
    DatasetSettings::default().with(change)
}

/// Checks that every frame has its pose.
fn has_poses(found: &Found) {
    assert_eq!(found.frames.len(), FRAMES);
    for ((_, pose), frame) in found.frames.iter().zip(frames()) {
        let difference = pose.unwrap().to_matrix() - frame.world_from_camera().to_matrix();
        assert!(difference.to_cols_array().into_iter().all(|part| part.abs() < 1e-6), "{difference}");
    }
}

fn fixed(parent: &str, child: &str) -> TfMessage {
    transform(START, parent, child, DVec3::ZERO, DQuat::IDENTITY)
}

#[test]
fn a_camera_on_top_of_its_world_is_found() {
    for (world, why) in
        [("map", "its name is that of a world"), ("robot1/odom", "its name"), ("start", "no other frame moves")]
    {
        let bytes = written(&[], |stamp, pose| vec![of_pose(stamp, OPTICAL, world, &pose.inverse())]);
        let found = read(&bytes, &none()).unwrap();
        has_poses(&found);
        assert_eq!(found.sources[2], format!("poses: /tf, from {OPTICAL} to {world}"));
        let [warning] = found.warnings.as_slice() else { panic!("{:?}", found.warnings) };
        let start =
            format!("a.mcap: {world} is below {OPTICAL} in /tf, which publishes the inverse of the camera's poses");
        assert!(warning.starts_with(&start) && warning.contains(why) && warning.contains("--world-frame"), "{warning}");
        let found = read(&bytes, &named(|s| s.world_frame = Some(world.to_owned()))).unwrap();
        has_poses(&found);
        assert_eq!(found.warnings, [""; 0]);
    }
    // The base of the robot is on top.
    let bytes = written(&[fixed("base_link", OPTICAL)], |stamp, pose| {
        vec![of_pose(stamp, "base_link", "odom", &pose.inverse()), of_pose(stamp, "odom", "map", &Pose::IDENTITY)]
    });
    let found = read(&bytes, &none()).unwrap();
    has_poses(&found);
    assert!(found.sources[2].ends_with("to map") && found.warnings[0].contains("map is below base_link"));
}

#[test]
fn a_world_that_is_not_certain_must_be_named() {
    let bytes = written(&[], |stamp, pose| {
        let tag = Pose::from_quaternion(DVec3::X, DQuat::IDENTITY).unwrap();
        vec![
            of_pose(stamp, OPTICAL, "tag_1", &pose.inverse()),
            of_pose(stamp, OPTICAL, "tag_2", &(pose.inverse() * tag)),
        ]
    });
    let found = read(&bytes, &none()).unwrap();
    assert!(found.frames.iter().all(|(_, pose)| pose.is_none()));
    let expected = format!(
        "poses: none: {OPTICAL} has no parent in /tf in which it moves; these move relative to it: tag_1, tag_2; if one of \
         them is the world, name it with --world-frame"
    );
    assert_eq!(found.sources[2], expected);
    let error = read(&bytes, &named(|s| s.pose = Some("/tf".to_owned()))).map(|_| ()).unwrap_err();
    assert!(error.contains("relative to which these move: tag_1, tag_2") && error.contains("--world-frame"), "{error}");
    has_poses(&read(&bytes, &named(|s| s.world_frame = Some("tag_1".to_owned()))).unwrap());
    // The wheels of a robot that does not know where it is are no world.
    let bytes = written(&[fixed("base_link", OPTICAL)], |stamp, _| {
        let turn = DQuat::from_rotation_y((stamp - START) as f64 * 1e-9);
        vec![transform(stamp, "base_link", "left_wheel", DVec3::ZERO, turn)]
    });
    let found = read(&bytes, &none()).unwrap();
    assert!(found.sources[2].contains("these move relative to it: left_wheel;"), "{:?}", found.sources);
    let stationary = read(&bytes, &named(|s| s.pose = Some("/tf_static".to_owned()))).unwrap();
    assert!(stationary.frames.iter().all(|(_, pose)| *pose == Some(Pose::IDENTITY)));
}

#[test]
fn a_transform_that_is_static_and_moving_moves() {
    let bytes = written(&[fixed("map", "odom"), fixed("base", OPTICAL)], |stamp, pose| {
        vec![of_pose(stamp, "map", "odom", pose), of_pose(stamp, "odom", "base", &Pose::IDENTITY)]
    });
    let found = read(&bytes, &none()).unwrap();
    has_poses(&found);
    let [warning] = found.warnings.as_slice() else { panic!("{:?}", found.warnings) };
    assert!(
        warning.starts_with(
            "a.mcap: the transform from map to odom is in /tf_static (1) and, another one, in /tf (6): the moving one in /tf \
             is used"
        ),
        "{warning}"
    );
    // Published by two programs, but the same.
    let bytes = written(&[fixed("base", OPTICAL), fixed("/base", OPTICAL)], |stamp, pose| {
        vec![of_pose(stamp, "/map", "/base", pose), of_pose(stamp, "base", OPTICAL, &Pose::IDENTITY)]
    });
    let found = read(&bytes, &none()).unwrap();
    has_poses(&found);
    assert_eq!(found.warnings, [""; 0]);
}

#[test]
fn a_frame_with_two_parents_is_told() {
    let elsewhere = Pose::from_quaternion(DVec3::new(3.0, 4.0, 5.0), DQuat::from_rotation_x(1.0)).unwrap();
    let both = |first: &'static str, second: &'static str| {
        move |stamp: i64, pose: &Pose| {
            let of = |world: &str| {
                let pose = if world == "odom" { elsewhere * *pose } else { *pose };
                of_pose(stamp, world, "base", &pose)
            };
            vec![of(first), of(second)]
        }
    };
    for (first, second) in [("map", "odom"), ("odom", "map")] {
        let bytes = written(&[fixed("base", OPTICAL)], both(first, second));
        let found = read(&bytes, &none()).unwrap();
        let expected = format!(
            "a.mcap: base has 2 parents, {first} (/tf, 6 transforms) and {second} (/tf, 6 transforms): {first} is used; \
             record only one of them, or choose with --world-frame"
        );
        assert_eq!(found.warnings, [expected]);
        has_poses(&read(&bytes, &named(|s| s.world_frame = Some("map".to_owned()))).unwrap());
    }
    // Two static parents, only one of which leads to the world, whichever is first.
    for mounts in [["base", "mount"], ["mount", "base"]] {
        let bytes = written(&mounts.map(|mount| fixed(mount, OPTICAL)), |stamp, pose| {
            vec![of_pose(stamp, "map", "base", pose)]
        });
        let found = read(&bytes, &none()).unwrap();
        has_poses(&found);
        assert!(found.warnings[0].contains(" has 2 parents, ") && found.warnings[0].contains(": base is used"));
    }
    // A static and a moving one.
    let bytes = written(&[fixed("camera_link", OPTICAL)], |stamp, pose| vec![of_pose(stamp, "map", OPTICAL, pose)]);
    let found = read(&bytes, &none()).unwrap();
    has_poses(&found);
    assert!(
        found.warnings[0]
            .contains("has 2 parents, camera_link (/tf_static, 1 transform) and map (/tf, 6 transforms): map"),
        "{:?}",
        found.warnings
    );
}

#[test]
fn what_is_said_about_missing_poses_is_true() {
    // Poses of the robot's base, to which nothing connects the camera.
    let bytes = written(&[], |stamp, pose| vec![of_pose(stamp, "odom", "base_link", pose)]);
    let found = read(&bytes, &none()).unwrap();
    let expected = format!(
        "poses: none: /tf has poses of base_link, but nothing connects \"{OPTICAL}\" to them: record /tf_static, or take the \
         poses of a frame for the camera's with --pose /tf --pose-frame base_link"
    );
    assert_eq!(found.sources[2], expected);
    let error = read(&bytes, &named(|s| s.pose = Some("/tf".to_owned()))).map(|_| ()).unwrap_err();
    assert!(error.contains("--pose-frame; frames: base_link, odom"), "{error}");
    let taken = named(|s| (s.pose, s.pose_frame) = (Some("/tf".to_owned()), Some("base_link".to_owned())));
    let found = read(&bytes, &taken).unwrap();
    has_poses(&found);
    assert!(found.sources[2].contains("/tf, from base_link, assumed to be the camera, to odom"), "{:?}", found.sources);
    let [warning] = found.warnings.as_slice() else { panic!("{:?}", found.warnings) };
    let start = format!("a.mcap: /tf has poses of base_link, and no transform connects {OPTICAL} to it");
    assert!(warning.starts_with(&start) && warning.contains("--pose-convention"), "{warning}");
}

fn with_odometry(child: &str, statics: &[TfMessage]) -> Vec<u8> {
    let mut writer = McapWriter::new();
    for message in statics {
        writer.write("/tf_static", message, START);
    }
    for (frame, index) in frames().iter().zip(0..) {
        let stamp = START + index * FRAME_NS;
        let pose = frame.world_from_camera();
        let [x, y, z, w] = DQuat::from_mat3(&pose.rotation()).to_array();
        let position = pose.translation();
        let position = Point { x: position.x, y: position.y, z: position.z };
        let pose = PoseMessage { position, orientation: Quaternion { x, y, z, w } };
        let message = Odometry {
            header: header(stamp, "odom"),
            child_frame_id: child.to_owned(),
            pose: PoseWithCovariance { pose, ..PoseWithCovariance::default() },
            ..Odometry::default()
        };
        writer.write("/odom", &message, stamp);
    }
    let all: Vec<&RgbdFrame> = frames().iter().collect();
    write_frames(&mut writer, &all, Parts { poses: false, ..ALL });
    writer.finish()
}

#[test]
fn odometry_of_another_body_is_told() {
    let found = read(&with_odometry("base_link", &[]), &none()).unwrap();
    has_poses(&found);
    let [warning] = found.warnings.as_slice() else { panic!("{:?}", found.warnings) };
    let start = format!("a.mcap: /odom has poses of base_link, and no transform connects {OPTICAL} to it");
    assert!(warning.starts_with(&start), "{warning}");
    for option in ["/tf_static", "--pose-frame", "--pose-convention"] {
        assert!(warning.contains(option), "{warning}");
    }
    let found = read(&with_odometry("base_link", &[fixed("base_link", OPTICAL)]), &none()).unwrap();
    has_poses(&found);
    assert_eq!(found.warnings, [""; 0]);
}

#[test]
fn images_in_the_frame_of_a_link_are_hinted_at_and_not_changed() {
    let of = |camera: &'static str, statics: &[TfMessage]| {
        let mut writer = McapWriter::new();
        for message in statics {
            writer.write("/tf_static", message, START);
        }
        let frame = &frames()[0];
        for (frame, index) in frames().iter().zip(0..) {
            let stamp = START + index * FRAME_NS;
            let body = if statics.is_empty() { camera } else { "base_link" };
            writer.write("/tf", &of_pose(stamp, "odom", body, frame.world_from_camera()), stamp);
            writer.write("/camera/camera_info", &info(stamp, camera, frame.intrinsics()), stamp);
            let pixels = frame.color().pixels().as_flattened();
            writer.write("/camera/image_raw", &raw(stamp, camera, "rgb8", (16, 12), pixels), stamp);
            let depth = depth_bytes(frame);
            writer.write("/camera/depth", &raw(stamp, camera, "16UC1", (16, 12), &depth), stamp);
        }
        let found = read(&writer.finish(), &none()).unwrap();
        assert_eq!(found.frames[0].0.depth().size(), frame.depth().size());
        found
    };
    let found = of("camera_link", &[]);
    has_poses(&found);
    assert!(
        found.warnings.len() == 1
            && found.warnings[0].starts_with("a.mcap: the images are in camera_link, whose name is that of a link")
            && found.warnings[0].contains("--pose-convention"),
        "{:?}",
        found.warnings
    );
    assert_eq!(of("camera_optical_frame", &[]).warnings, [""; 0]);
    // As with an Azure Kinect: a link that is turned like an optical frame.
    let turn = DQuat::from_euler(glam::EulerRot::ZYX, -1.57, 0.0, -1.57);
    let turned = transform(START, "base_link", "rgb_camera_link", DVec3::Z, turn);
    assert_eq!(of("rgb_camera_link", &[turned]).warnings, [""; 0]);
}

/// Returns a transform with the quaternion of `turn` at another length.
fn stretched(message: TfMessage, length: f64) -> TfMessage {
    let stretch = |mut transform: splatseg_ros::TransformStamped| {
        let Quaternion { x, y, z, w } = transform.transform.rotation;
        let [x, y, z, w] = [x, y, z, w].map(|number| number * length);
        transform.transform.rotation = Quaternion { x, y, z, w };
        transform
    };
    TfMessage { transforms: message.transforms.into_iter().map(stretch).collect() }
}

#[test]
fn transforms_without_a_rotation_are_counted() {
    let bytes = written(&[], |stamp, pose| vec![stretched(of_pose(stamp, "map", OPTICAL, pose), 0.0)]);
    let found = read(&bytes, &none()).unwrap();
    assert!(found.frames.iter().all(|(_, pose)| pose.is_none()) && found.sources[2].starts_with("poses: none"));
    let expected =
        format!("a.mcap: transforms from {OPTICAL} to map: {FRAMES} left out, as the quaternion has length 0");
    assert_eq!(found.warnings, [expected]);
    // The error that follows does not tell it.
    let text = read(&bytes, &named(|s| s.pose = Some("/tf".to_owned()))).map(|_| ()).unwrap_err();
    assert!(text.contains("expected a frame in /tf"), "{text}");
    let bytes = written(&[stretched(fixed("map", "nowhere"), f64::NAN)], |stamp, pose| {
        vec![of_pose(stamp, "map", OPTICAL, pose)]
    });
    assert_eq!(read(&bytes, &none()).unwrap().warnings, [""; 0], "tracking was lost");
}

#[test]
fn quaternions_of_another_length_are_counted_and_normalised() {
    let bytes = written(&[], |stamp, pose| vec![stretched(of_pose(stamp, "map", OPTICAL, pose), 1.5)]);
    let found = read(&bytes, &none()).unwrap();
    has_poses(&found);
    let [warning] = found.warnings.as_slice() else { panic!("{:?}", found.warnings) };
    let start = format!(
        "a.mcap: transforms from {OPTICAL} to map: {FRAMES} with a quaternion of another length than 1 (the first: 1.500)"
    );
    assert!(warning.starts_with(&start) && warning.contains("--pose"), "{warning}");
    let bytes = written(&[], |stamp, pose| vec![stretched(of_pose(stamp, "map", OPTICAL, pose), 1.01)]);
    assert_eq!(read(&bytes, &none()).unwrap().warnings, [""; 0]);
}

#[test]
fn only_the_poses_that_are_used_must_have_length_one() {
    let mut writer = McapWriter::new();
    let all: Vec<&RgbdFrame> = frames().iter().collect();
    write_frames(&mut writer, &all, Parts { poses: false, ..ALL });
    for (frame, index) in frames().iter().zip(0..) {
        let stamp = START + index * FRAME_NS;
        for (topic, length) in [("/odom", 1.1), ("/goal", 0.0)] {
            let pose = frame.world_from_camera();
            let DVec3 { x, y, z } = pose.translation();
            let turn = DQuat::from_mat3(&pose.rotation()).to_array().map(|number| number * length);
            let orientation = Quaternion { x: turn[0], y: turn[1], z: turn[2], w: turn[3] };
            let pose = PoseMessage { position: Point { x, y, z }, orientation };
            let pose = PoseWithCovariance { pose, ..PoseWithCovariance::default() };
            let child_frame_id = OPTICAL.to_owned();
            let odometry = Odometry { header: header(stamp, "map"), child_frame_id, pose, ..Default::default() };
            writer.write(topic, &odometry, stamp);
        }
    }
    let found = read(&writer.finish(), &named(|s| s.pose = Some("/odom".to_owned()))).unwrap();
    has_poses(&found);
    let [warning] = found.warnings.as_slice() else { panic!("{:?}", found.warnings) };
    assert!(warning.starts_with("a.mcap: poses of /odom: 6 with a quaternion of another length"), "{warning}");
}
