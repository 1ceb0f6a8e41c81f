//! Loops that are closed, with the same result for any number of threads and after an interruption; parts of the map that
//! are joined.

use splatseg_dataset::{DatasetSettings, FrameStream, GroundTruth, open_scene};
use splatseg_geometry::{CameraFrame, FrameAnchor, KeyframeId, MapCorrection, Pose};
use splatseg_odometry::{CameraPose, PoseInput, PoseMode, PoseSource, PoseState, PoseUpdate, StateScope, TrackedPoses};
use std::collections::BTreeMap;
use std::f64::consts::PI;

/// Where the camera turns round, and the largest error of its depth on the way there.
const TURN: usize = 80;
const DEPTH_ERROR: f64 = 0.05;

type Posed = (CameraFrame<'static>, Pose);

/// Result of a step of a run.
#[derive(Debug, PartialEq)]
struct Step {
    pose: CameraPose,
    correction: Option<MapCorrection>,
    anchor: FrameAnchor,
}

/// Frames of a room with their true poses.
fn frames(count: usize, seed: u64, noise: &str) -> Vec<Posed> {
    let scene = format!("synthetic:frames={count},speed=0.12,width=160,height=120,seed={seed},noise={noise}");
    let settings = DatasetSettings::default();
    let stream = FrameStream::open(open_scene(scene, &settings).unwrap(), &settings, GroundTruth::Skip).unwrap();
    stream.map(|frame| frame.map(|frame| (frame.frame, frame.world_from_camera.unwrap())).unwrap()).collect()
}

/// A walk there and back. On the way there the sensor's depth is off for a while, so that the camera drifts.
fn there_and_back() -> Vec<Posed> {
    let room = frames(TURN, 4, "kinect");
    let frame = |step: usize| {
        let (frame, truth) = &room[step.min(2 * TURN - 1 - step)];
        let on_the_way = (step as f64 - 10.0) / (TURN as f64 - 20.0);
        let is_off = (0.0..1.0).contains(&on_the_way);
        let scale = if is_off { 1.0 + DEPTH_ERROR * (PI * on_the_way).sin().powi(2) } else { 1.0 };
        let (color, depth) = (frame.color().clone().into_owned(), frame.depth().map(|depth| depth * scale as f32));
        (CameraFrame::new(frame.name(), color, depth, *frame.intrinsics()).unwrap(), *truth)
    };
    (0..2 * TURN).map(frame).collect()
}

fn error(pose: &Pose, truth: &Pose) -> f64 {
    pose.translation().distance(truth.translation())
}

fn step(poses: &mut TrackedPoses, (frame, truth): &Posed) -> Step {
    let update = poses.pose(frame, PoseInput::new(0, Some(truth))).unwrap();
    Step { pose: update.pose, correction: update.correction, anchor: update.anchor }
}

fn with_threads<R: Send>(count: usize, work: impl FnOnce() -> R + Send) -> R {
    rayon::ThreadPoolBuilder::new().num_threads(count).build().unwrap().install(work)
}

#[test]
fn a_closed_loop_is_the_same_with_any_number_of_threads_and_after_an_interruption() {
    let walk = there_and_back();
    let mut poses = TrackedPoses::new(PoseMode::Track);
    let mut states = Vec::new();
    let steps: Vec<Step> = with_threads(1, || {
        let mut step = |frame| {
            let found = step(&mut poses, frame);
            states.push(poses.save(StateScope::Run).unwrap());
            found
        };
        walk.iter().map(&mut step).collect()
    });
    let closed = steps.iter().position(|step| step.correction.is_some()).unwrap();
    let errors: Vec<f64> =
        steps.iter().zip(&walk).map(|(step, (_, truth))| error(&step.pose.world_from_camera, truth)).collect();
    assert!(steps.iter().all(|step| step.pose.state == PoseState::Tracked));
    assert!(errors[closed - 1] > 0.08, "the camera has drifted: {}", errors[closed - 1]);
    assert!(errors[closed..].iter().all(|error| *error < 0.03), "{:?}", &errors[closed..]);

    let mut again = TrackedPoses::new(PoseMode::Track);
    let found: Vec<Step> = with_threads(4, || walk.iter().map(|frame| step(&mut again, frame)).collect());
    assert_eq!(found, steps);
    assert_eq!(again.save(StateScope::Run), poses.save(StateScope::Run));

    // Before; when the loop is found but the map is not corrected yet; and after.
    for interrupted in [closed - 10, closed - 1, closed] {
        let mut resumed = TrackedPoses::new(PoseMode::Track);
        resumed.restore(StateScope::Run, &states[interrupted]).unwrap();
        let found: Vec<Step> = walk[interrupted + 1..].iter().map(|frame| step(&mut resumed, frame)).collect();
        assert_eq!(found, steps[interrupted + 1..], "resumed after step {interrupted}");
        assert_eq!(resumed.save(StateScope::Run), poses.save(StateScope::Run));
    }
}

#[test]
fn a_new_part_of_the_map_is_joined_when_the_camera_comes_to_a_known_place() {
    const FAR: usize = 160;
    let room = frames(FAR + 1, 5, "none");
    // The known part; then the camera is carried away, and lost for longer than three seconds; then it walks back.
    let walk: Vec<usize> = (0..80).chain(std::iter::repeat_n(FAR, 95)).chain((20..FAR).rev()).collect();
    let mut poses = TrackedPoses::new(PoseMode::Track);
    let mut of_part: BTreeMap<KeyframeId, Pose> = BTreeMap::new();
    let mut joined = None;
    for (number, index) in walk.iter().enumerate() {
        let (frame, truth) = &room[*index];
        let PoseUpdate { pose, correction, anchor, .. } = poses.pose(frame, PoseInput::new(0, Some(truth))).unwrap();
        match number {
            0..80 => assert!(pose.state == PoseState::Tracked && error(&pose.world_from_camera, truth) < 0.02),
            80..170 => assert_eq!(pose.state, PoseState::Lost, "step {number}"),
            _ => assert_eq!(pose.state, PoseState::Tracked, "step {number}"),
        }
        if number >= 170 && joined.is_none() {
            let is_apart = pose.world_from_camera.translation().x > 30.0;
            assert!(is_apart || correction.is_some(), "step {number}");
            of_part.entry(anchor.keyframe).or_insert(*truth);
        }
        if let Some(correction) = correction {
            // All keyframes of the part move, by tens of metres; those of the known part hardly.
            if joined.is_none() {
                let keyframes = poses.keyframes();
                for (id, motion) in &correction.new_from_old {
                    let now = keyframes[id].world_from_keyframe;
                    let moved = error(&now, &(motion.inverse() * now));
                    assert_eq!(moved > 10.0, of_part.contains_key(id), "keyframe {id}: {moved} m");
                }
                assert!(of_part.keys().all(|id| correction.new_from_old.contains_key(id)));
            }
            joined.get_or_insert(number);
        }
        if joined.is_some() {
            let error = error(&pose.world_from_camera, truth);
            assert!(error < 0.05, "step {number}: {error}");
        }
    }
    assert!(joined.is_some_and(|step| step < 290), "{joined:?}");
}
