//! Places that the camera comes back to: in the same run after a loss, and in another one with the saved keyframes.

use proptest::prelude::*;
use splatseg_dataset::{DatasetSettings, FrameStream, GroundTruth, open_scene};
use splatseg_files::StateBlock;
use splatseg_geometry::{CameraFrame, Image, Pose};
use splatseg_odometry::{
    CameraPose, KeyframeView, PoseInput, PoseMode, PoseSource, PoseState, StateScope, TrackedPoses, keyframe_views,
};
use std::sync::LazyLock;

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

/// The saved keyframes of a camera that stands in a room.
fn saved_keyframes() -> StateBlock {
    let room = frames("synthetic:frames=2,width=160,height=120");
    let mut poses = TrackedPoses::new(PoseMode::Track);
    poses.pose(&room[0].0, PoseInput::new(0, Some(&room[0].1))).unwrap();
    StateBlock::from_bytes(&poses.save(StateScope::Map).unwrap()).unwrap()
}

fn load(bytes: &[u8]) -> Result<TrackedPoses, String> {
    let mut poses = TrackedPoses::new(PoseMode::Track);
    poses.restore(StateScope::Map, bytes).map(|()| poses).map_err(|error| error.to_string())
}

#[test]
fn damaged_keyframes_are_refused() {
    type Change = fn(&mut StateBlock);
    let block = saved_keyframes();
    let refused = |change: Change| {
        let mut changed = block.clone();
        change(&mut changed);
        load(&changed.to_bytes().unwrap()).err().unwrap_or_default()
    };
    assert_eq!(refused(|_| ()), "");
    assert_eq!(refused(|block| block.put("of_a_later_version", &[2], [1.5f32, 2.0])), "");
    let changes: [(Change, &str); 10] = [
        (|block| block.put("size", &[2], [100u32, 120]), "keyframe 0: image cannot be read"),
        (|block| block.put("size", &[2], [u32::MAX, 7]), "pixels, expected at most 200 columns"),
        (|block| block.put("id", &[], [7u32]), "keyframe 7 occurs twice or was never made"),
        (|block| block.put("id", &[], [0u32, 1]), "part: found [1], expected 2 rows"),
        (|block| block.put("feature_points", &[3], [0i16; 3]), "feature_descriptors: found"),
        (|block| block.put("grey_offsets", &[], [0u32, 5]), "grey_offsets"),
        (|block| block.put("grey_offsets", &[], [9u32, 5]), "grey_offsets"),
        (|block| block.put("world_from_camera", &[4, 4], [f64::NAN; 16]), "world_from_camera: found"),
        (|block| block.put("edges", &[2], [0u32, 0]), "edge_pose: found"),
        (|block| drop(block.take_block("state")), "state.json is missing"),
    ];
    for (index, (change, expected)) in changes.into_iter().enumerate() {
        let error = refused(change);
        assert!(error.contains(expected), "change {index}: {error}");
    }
    let color: fn(&mut StateBlock) = |block| {
        block.put("color", &[], *b"text");
        block.put("color_offsets", &[], [0u32, 4]);
    };
    assert!(refused(color).contains("the colour image cannot be read"));
    let bytes = block.to_bytes().unwrap();
    assert!(load(&bytes[..bytes.len() / 2]).is_err() && load(b"").is_err() && load(b"{}").is_err());
}

#[test]
fn keyframes_have_a_small_colour_image_and_may_lack_it() {
    let room = frames("synthetic:frames=2,width=640,height=480");
    let mut poses = TrackedPoses::new(PoseMode::Track);
    poses.pose(&room[0].0, PoseInput::new(0, Some(&room[0].1))).unwrap();
    let saved = poses.save(StateScope::Map).unwrap();
    let views = keyframe_views(&saved, None).unwrap();
    let (small, color) = (views[0].color().unwrap(), room[0].0.color());
    assert_eq!((small.size(), views[0].depth.size()), ((320, 240), (160, 120)));
    let difference: u64 = (0..240)
        .flat_map(|row| (0..320).map(move |column| (column, row)))
        .map(|(column, row)| u64::from(small[(column, row)][0].abs_diff(color[(2 * column, 2 * row)][0])))
        .sum();
    assert!(difference < 8 * 320 * 240, "{difference}");
    let again = load(&saved).unwrap().save(StateScope::Map).unwrap();
    let colors = |bytes: &[u8]| StateBlock::from_bytes(bytes).unwrap().get::<u8>("color", &[]).unwrap();
    assert!(colors(&again) == colors(&saved) && !colors(&saved).is_empty(), "colours stay");

    let mut old = StateBlock::from_bytes(&saved).unwrap();
    old.put("color", &[], [0u8; 0]);
    old.put("color_offsets", &[], [0u32; 2]);
    let old = load(&old.to_bytes().unwrap()).unwrap().save(StateScope::Map).unwrap();
    assert!(keyframe_views(&old, None).unwrap()[0].color().is_none());
    assert!(keyframe_views(&saved, Some(&old)).unwrap().is_empty(), "the same keyframe with and without colour");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 150, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn no_damage_panics(
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..4),
        in_header in any::<bool>(),
    ) {
        static SAVED: LazyLock<Vec<u8>> = LazyLock::new(|| saved_keyframes().to_bytes().unwrap());
        let mut bytes = SAVED.clone();
        let end = if in_header { 3000.min(bytes.len()) } else { bytes.len() };
        for (place, value) in changes {
            bytes[place.index(end)] = value;
        }
        if let Ok(poses) = load(&bytes) {
            let _ = poses.save(StateScope::Map);
            let _ = keyframe_views(&bytes, Some(&SAVED)).map(|views| views.iter().filter_map(KeyframeView::color).count());
        }
    }
}
