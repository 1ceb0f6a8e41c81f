//! Work that must not hold up a frame of a video, at 320×240 in a tour of four rooms: making and storing a keyframe, a
//! search for a lost camera among 300 keyframes, and closing a loop over 300 keyframes with 1,500 relative poses. Each time
//! is that of a whole frame; `tracking` is that of a frame with nothing else to do.
//!
//! `cargo bench -p splatseg-odometry --bench keyframes`

use criterion::{BatchSize, Criterion, criterion_group, criterion_main};
use glam::DVec3;
use serde_json::{Value, json};
use splatseg_dataset::{DatasetSettings, Scene, open_scene};
use splatseg_geometry::{CameraFrame, Pose};
use splatseg_odometry::{PoseInput, PoseMode, PoseSource, PoseState, StateScope, TrackedPoses};
use std::sync::Arc;

const KEYFRAMES: usize = 300;

/// Frames of the tour from one to the next that may become a keyframe.
const STEP: usize = 6;

/// Each keyframe has relative poses to this many earlier ones.
const LINKS: usize = 5;

/// Drift from one keyframe to the next, metres.
const DRIFT: f64 = 0.0005;

type Posed = (CameraFrame<'static>, Pose);

fn scene(seed: u64) -> Arc<dyn Scene> {
    let name = format!("synthetic:tour=4,frames=4000,seed={seed},noise=kinect");
    open_scene(name, &DatasetSettings::default()).expect("the settings are in range")
}

fn frame(scene: &Arc<dyn Scene>, index: usize) -> Posed {
    let frame = scene.read_frame(index).expect("the scene has this frame");
    let pose = *frame.world_from_camera();
    (frame.into_camera_frame(), pose)
}

/// A map of keyframes with given poses, and the index of the next frame.
fn mapped(scene: &Arc<dyn Scene>) -> (TrackedPoses, usize) {
    let (mut poses, mut index) = (TrackedPoses::new(PoseMode::Given), 0);
    while poses.keyframes().len() < KEYFRAMES {
        let (frame, pose) = frame(scene, index);
        poses.pose(&frame, PoseInput::new(0, Some(&pose))).expect("the frame has a pose");
        index += STEP;
    }
    (poses, index)
}

/// A camera that has been found in a map. `frames` are those from `index` on.
fn found(keyframes: &[u8], frames: &[Posed]) -> TrackedPoses {
    let mut poses = lost(keyframes);
    let mut tracked = |frame| poses.pose(frame, PoseInput::default()).expect("a pose is tracked").pose.state;
    let states: Vec<PoseState> = frames.iter().map(|(frame, _)| tracked(frame)).collect();
    assert_eq!(states.last(), Some(&PoseState::Tracked), "{states:?}");
    poses
}

fn lost(keyframes: &[u8]) -> TrackedPoses {
    let mut poses = TrackedPoses::new(PoseMode::Track);
    poses.restore(StateScope::Map, keyframes).expect("the keyframes have just been made");
    poses
}

/// The same camera in a map that has drifted. A search among the neighbours of a keyframe of the second round is due if
/// `is_due`: it closes the loop.
fn drifted(poses: &TrackedPoses, is_due: bool) -> TrackedPoses {
    let mut state: Value =
        serde_json::from_slice(&poses.save(StateScope::Run).expect("there is a state")).expect("it is JSON");
    let map = &mut state["map"];
    let mut moved: Vec<Pose> = Vec::new();
    for keyframe in map["keyframes"].as_array_mut().expect("a list").iter_mut().take(KEYFRAMES) {
        let pose: Pose = serde_json::from_value(keyframe["world_from_key"].take()).expect("a pose");
        moved.push(Pose::from_translation(DVec3::X * (DRIFT * moved.len() as f64)) * pose);
        keyframe["world_from_key"] = json!(moved.last());
    }
    let weight = |k: usize| if k < 3 { 4e4 } else { 1e5 };
    let information: [[f64; 6]; 6] =
        std::array::from_fn(|row| std::array::from_fn(|column| if row == column { weight(row) } else { 0.0 }));
    let edge = |from: usize, to: usize| {
        let kind = if to - from == 1 { "tracked" } else { "loop" };
        let measured = moved[from].inverse() * moved[to];
        json!({"from": from, "to": to, "measured": measured, "information": information, "kind": kind})
    };
    let edges = (1..KEYFRAMES).flat_map(|to| (to.saturating_sub(LINKS)..to).map(move |from| (from, to)));
    map["edges"] = edges.map(|(from, to)| edge(from, to)).collect();
    map["checks"] = if is_due { json!([{"neighbours": KEYFRAMES - 5}]) } else { json!([]) };
    let mut poses = TrackedPoses::new(PoseMode::Track);
    let state = serde_json::to_vec(&state).expect("it was JSON");
    poses.restore(StateScope::Run, &state).expect("it was a state");
    poses
}

fn bench_frame(criterion: &mut Criterion, name: &str, poses: &TrackedPoses, frame: &CameraFrame<'_>) {
    let step = |mut poses: TrackedPoses| rayon::scope(|_| (poses.pose(frame, PoseInput::default()), poses));
    let update = step(poses.clone()).0.expect("a pose is tracked");
    let moved = update.correction.map_or(0, |correction| correction.new_from_old.len());
    println!("{name}: {:?}, {moved} keyframes corrected", update.pose.state);
    criterion.bench_function(name, |bencher| bencher.iter_batched(|| poses.clone(), step, BatchSize::PerIteration));
}

fn keyframes(criterion: &mut Criterion) {
    let (scene, other) = (scene(1), scene(2));
    let (mapped, index) = mapped(&scene);
    let far = |number: usize| Pose::from_translation(DVec3::new(1000.0, 0.0, number as f64));
    let (new, _) = frame(&scene, index);
    criterion.bench_function("making_and_storing_a_keyframe", |bencher| {
        let add = |mut poses: TrackedPoses| {
            let made = rayon::scope(|_| poses.pose(&new, PoseInput::new(0, Some(&far(0)))));
            (made.is_ok(), poses)
        };
        bencher.iter_batched(|| mapped.clone(), add, BatchSize::PerIteration);
    });
    let (mut full, mut number) = (mapped.clone(), 0);
    let mut add = |poses: &mut TrackedPoses| {
        number += 1;
        rayon::scope(|_| poses.pose(&new, PoseInput::new(0, Some(&far(number)))).is_ok())
    };
    (0..100).for_each(|_| assert!(add(&mut full)));
    criterion.bench_function("the_same_in_a_full_map", |bencher| bencher.iter(|| add(&mut full)));

    let saved = mapped.save(StateScope::Map).expect("there are keyframes");
    let next: Vec<Posed> = (index..index + 3).map(|index| frame(&scene, index)).collect();
    bench_frame(criterion, "searching_a_known_place", &lost(&saved), &next[0].0);
    bench_frame(criterion, "searching_an_unknown_place", &lost(&saved), &frame(&other, index).0);

    let found = found(&saved, &next[..2]);
    bench_frame(criterion, "tracking", &drifted(&found, false), &next[2].0);
    bench_frame(criterion, "tracking_and_closing_a_loop", &drifted(&found, true), &next[2].0);
}

criterion_group!(benches, keyframes);
criterion_main!(benches);
