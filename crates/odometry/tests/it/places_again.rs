//! Places that the camera comes back to: in the same run after a loss, and in another one with the saved keyframes.

use splatseg_dataset::{DatasetSettings, FrameStream, GroundTruth, open_scene};
use splatseg_geometry::{CameraFrame, Image, Pose};
use splatseg_odometry::{CameraPose, PoseInput, PoseMode, PoseSource, PoseState, StateScope, TrackedPoses};

/// Frames of a scene with their true poses.
fn frames(scene: &str) -> Vec<(CameraFrame<'static>, Pose)> {
    let settings = DatasetSettings::default();
    let stream = FrameStream::open(open_scene(scene, &settings).unwrap(), &settings, GroundTruth::Skip).unwrap();
    stream.map(|frame| frame.map(|frame| (frame.frame, frame.world_from_camera.unwrap())).unwrap()).collect()
}

fn error(found: &CameraPose, truth: &Pose) -> f64 {
    found.world_from_camera.translation().distance(truth.translation())
}

fn covered(frame: &CameraFrame<'_>) -> CameraFrame<'static> {
    let (width, height) = (frame.width(), frame.height());
    let (color, depth) = (Image::filled(width, height, [0; 3]), Image::filled(width, height, 0.0));
    CameraFrame::new(frame.name(), color, depth, *frame.intrinsics()).unwrap()
}

#[test]
fn with_saved_keyframes_the_camera_finds_its_place_and_another_room_is_a_new_part() {
    let room = "synthetic:frames=300,speed=0.08,width=160,height=120,seed=4";
    let room = frames(room);
    let mut first = TrackedPoses::new(PoseMode::Track);
    for (frame, truth) in &room[..200] {
        first.pose(frame, PoseInput::new(0, Some(truth))).unwrap();
    }
    let keyframes = first.save(StateScope::Map).unwrap();

    let mut second = TrackedPoses::new(PoseMode::Track);
    second.restore(StateScope::Map, &keyframes).unwrap();
    let mut tracked = |frame: &CameraFrame<'_>| second.pose(frame, PoseInput::default()).unwrap().pose;
    let found: Vec<(CameraPose, &Pose)> = room[60..80].iter().map(|(frame, truth)| (tracked(frame), truth)).collect();
    let first_found = found.iter().position(|(pose, _)| pose.state == PoseState::Tracked).unwrap();
    assert!((1..=5).contains(&first_found), "{first_found}: never at once, as a place must be confirmed");
    for (pose, truth) in &found[first_found..] {
        assert!(pose.state == PoseState::Tracked && error(pose, truth) < 0.03, "{}", error(pose, truth));
    }

    let other = frames("synthetic:frames=100,speed=0.08,width=160,height=120,seed=9");
    let mut third = TrackedPoses::new(PoseMode::Track);
    third.restore(StateScope::Map, &keyframes).unwrap();
    let mut tracked = |frame: &CameraFrame<'_>| third.pose(frame, PoseInput::default()).unwrap().pose;
    let states: Vec<CameraPose> = other.iter().map(|(frame, _)| tracked(frame)).collect();
    assert!(states[..90].iter().all(|pose| pose.state == PoseState::Lost), "nothing is taken for the known room");
    let last = states.last().unwrap();
    assert!(last.state == PoseState::Tracked && last.world_from_camera.translation().x > 40.0, "{last:?}");
}

#[test]
fn after_a_covered_lens_the_camera_is_found_and_a_resumed_run_goes_on_to_the_same_poses() {
    let room = frames("synthetic:frames=260,speed=0.08,width=160,height=120,seed=4,noise=kinect");
    // There and back, so that what is seen after the loss is in the map.
    let there_and_back: Vec<usize> = (0..130).chain((0..130).rev()).collect();
    let is_covered = |step: usize| (140..200).contains(&step);
    let mut poses = TrackedPoses::new(PoseMode::Track);
    let mut found = Vec::new();
    let mut saved = None;
    for (step, number) in there_and_back.iter().enumerate() {
        let (frame, truth) = &room[*number];
        let shown = if is_covered(step) { covered(frame) } else { frame.clone() };
        let input = PoseInput::new(step, (step == 0).then_some(truth));
        found.push((poses.pose(&shown, input).unwrap().pose, truth));
        // In the middle of the search for the lost camera.
        if step == 200 {
            saved = poses.save(StateScope::Run);
        }
    }
    assert!((141..200).all(|step| found[step].0.state == PoseState::Lost));
    let again = (200..260).find(|step| found[*step].0.state == PoseState::Tracked).unwrap();
    assert!(again < 210, "{again}");
    for (pose, truth) in &found[again..] {
        assert!(pose.state == PoseState::Tracked && error(pose, truth) < 0.04, "{}", error(pose, truth));
    }

    let mut resumed = TrackedPoses::new(PoseMode::Track);
    resumed.restore(StateScope::Run, &saved.unwrap()).unwrap();
    for step in 201..260 {
        let update = resumed.pose(&room[there_and_back[step]].0, PoseInput::new(step, None)).unwrap();
        assert_eq!(update.pose, found[step].0, "step {step}");
    }
    assert_eq!(resumed.save(StateScope::Map), poses.save(StateScope::Map));
}

#[test]
fn damaged_keyframes_are_refused() {
    let room = frames("synthetic:frames=2,width=160,height=120");
    let mut poses = TrackedPoses::new(PoseMode::Track);
    poses.pose(&room[0].0, PoseInput::new(0, Some(&room[0].1))).unwrap();
    let text = String::from_utf8(poses.save(StateScope::Map).unwrap()).unwrap();
    let refused = |text: &str| TrackedPoses::new(PoseMode::Track).restore(StateScope::Map, text.as_bytes()).is_err();
    assert!(!refused(&text));
    assert!(refused(&text[..text.len() / 2]) && refused("") && refused("{}"));
    assert!(refused(&text.replacen("\"width\":160", "\"width\":100", 1)), "an image of another size");
    assert!(refused(&text.replacen("\"id\":0", "\"id\":7", 1)), "a keyframe that was never made");
    assert!(refused(&text.replacen("\"features\":\"", "\"features\":\"AA", 1)));
}
