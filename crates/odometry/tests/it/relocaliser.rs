//! Single frames that are located in a saved map.

use splatseg_dataset::{DatasetSettings, FrameStream, GroundTruth, open_scene};
use splatseg_geometry::{CameraFrame, Image, Pose};
use splatseg_odometry::{PoseInput, PoseMode, PoseSource, Relocaliser, StateScope, TrackedPoses};
use splatseg_test_scenes::shared;

/// Frames of a scene with their true poses.
fn frames(scene: &str, settings: &DatasetSettings) -> Vec<(CameraFrame<'static>, Pose)> {
    let stream = FrameStream::open(open_scene(scene, settings).unwrap(), settings, GroundTruth::Skip).unwrap();
    stream.map(|frame| frame.map(|frame| (frame.frame, frame.world_from_camera.unwrap())).unwrap()).collect()
}

/// A map of frames through which the camera is tracked.
fn map_of(frames: &[(CameraFrame<'static>, Pose)]) -> Relocaliser {
    let mut poses = TrackedPoses::new(PoseMode::Track);
    for (frame, truth) in frames {
        poses.pose(frame, PoseInput::new(0, Some(truth))).unwrap();
    }
    Relocaliser::new(&poses.save(StateScope::Map).unwrap()).unwrap()
}

/// True if a frame is located within 5 cm and 5 degrees of its true pose; `None` if it is not located.
fn is_right(map: &Relocaliser, (frame, truth): &(CameraFrame<'static>, Pose)) -> Option<bool> {
    let found = map.locate(frame)?.world_from_camera;
    let turn = glam::DQuat::from_mat3(&(truth.inverse() * found).rotation());
    let degrees = (2.0 * turn.xyz().length().atan2(turn.w.abs())).to_degrees();
    Some(found.translation().distance(truth.translation()) <= 0.05 && degrees <= 5.0)
}

#[test]
fn frames_of_another_path_are_found_and_those_of_another_room_are_not() {
    let settings = DatasetSettings::default();
    let map = map_of(&frames("synthetic:frames=200,speed=0.08,width=160,height=120,seed=4,noise=kinect", &settings));
    // The same room, faster: other frames, over a longer path.
    let other_path = frames("synthetic:frames=60,speed=0.5,width=160,height=120,seed=4,noise=kinect", &settings);
    let (mut near, mut found) = (0, 0);
    for frame in &other_path {
        let is_right = is_right(&map, frame);
        assert_ne!(is_right, Some(false), "{}", frame.0.name());
        if map.has_keyframe_within(&frame.1, 0.3, 20.0) {
            near += 1;
            found += usize::from(is_right.is_some());
        }
    }
    // The synthetic room has large surfaces without texture, and few corners at this size.
    assert!(near >= 10 && 2 * found >= near, "{found} of {near}");
    let elsewhere = frames("synthetic:frames=60,speed=0.5,width=160,height=120,seed=9,noise=kinect", &settings);
    assert!(elsewhere.iter().all(|(frame, _)| map.locate(frame).is_none()));
    let (width, height) = (160, 120);
    let (color, depth) = (other_path[0].0.color().clone().into_owned(), Image::filled(width, height, 0.0));
    let without_depth = CameraFrame::new("flat", color, depth, *other_path[0].0.intrinsics()).unwrap();
    assert!(map.locate(&without_depth).is_none());
    assert!(Relocaliser::new(b"{}").is_err());
}

#[test]
fn later_frames_of_a_kitchen_are_found() {
    let kitchen = |name: &str| shared(&format!("data/{name}"), "later_frames_of_a_kitchen_are_found");
    let (Some(dense), Some(sparse)) = (kitchen("redkitchen_dense"), kitchen("redkitchen")) else { return };
    let mut settings = DatasetSettings::default();
    settings.resize = Some("320x240".parse().unwrap());
    // Every second frame saves time.
    settings.stride = 2;
    let map = map_of(&frames(dense.to_str().unwrap(), &settings));
    settings.stride = 1;
    let later = frames(sparse.to_str().unwrap(), &settings).split_off(30);
    let results: Vec<(usize, Option<bool>)> = later
        .iter()
        .map(|frame| {
            let within = [(0.3, 20.0), (0.5, 30.0)];
            let group =
                within.iter().position(|(metres, degrees)| map.has_keyframe_within(&frame.1, *metres, *degrees));
            (group.unwrap_or(2), is_right(&map, frame))
        })
        .collect();
    let count = |group: usize, result: &[Option<bool>]| {
        results.iter().filter(|(of, found)| *of == group && result.contains(found)).count()
    };
    let share = |group| count(group, &[Some(true)]) as f64 / count(group, &[None, Some(true), Some(false)]) as f64;
    assert!(share(0) >= 0.9 && share(1) >= 0.6, "{results:?}");
    assert!((0..3).all(|group| count(group, &[Some(false)]) == 0), "{results:?}");
}
