//! Work that must not hold up a frame of a video, at 320×240 in a tour of four rooms: making and storing a keyframe, a
//! search for a lost camera among 300 keyframes, and closing a loop over 300 keyframes with 1,500 relative poses. Each time
//! is that of a whole frame; `tracking` is that of a frame with nothing else to do.
//!
//! `cargo bench -p splatseg-odometry --bench keyframes`

use criterion::{BatchSize, Criterion, criterion_group, criterion_main};
use glam::DVec3;
use serde_json::{Value, json};
use splatseg_dataset::{DatasetSettings, Scene, open_scene};
use splatseg_files::StateBlock;
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
    let saved = poses.save(StateScope::Run).expect("there is a state");
    let mut state = StateBlock::from_bytes(&saved).expect("it has just been written");
    let mut map = state.take_block("keyframes");
    let mut numbers: Vec<f64> = map.get("world_from_camera", &[4, 4]).expect("poses");
    let mut moved: Vec<Pose> = Vec::new();
    for pose in numbers.as_chunks_mut::<16>().0.iter_mut().take(KEYFRAMES) {
        let shift = Pose::from_translation(DVec3::X * (DRIFT * moved.len() as f64));
        moved.push(shift * Pose::from_saved_row_major(*pose).expect("a pose"));
        *pose = moved[moved.len() - 1].to_row_major();
    }
    map.put("world_from_camera", &[4, 4], numbers);
    let pairs: Vec<(usize, usize)> =
        (1..KEYFRAMES).flat_map(|to| (to.saturating_sub(LINKS)..to).map(move |from| (from, to))).collect();
    map.put("edges", &[2], pairs.iter().flat_map(|(from, to)| [*from as u32, *to as u32]));
    let measured = |(from, to): &(usize, usize)| (moved[*from].inverse() * moved[*to]).to_row_major();
    map.put("edge_pose", &[4, 4], pairs.iter().flat_map(measured));
    let weight = |place: usize| match (place / 6, place % 6) {
        (row, column) if row != column => 0.0,
        (0..3, _) => 4e4,
        _ => 1e5,
    };
    map.put("edge_information", &[6, 6], pairs.iter().flat_map(|_| (0..36).map(weight)));
    map.put("edge_kind", &[], pairs.iter().map(|(from, to)| u8::from(to - from > 1)));
    let mut searches: Value = map.get_json("state.json").expect("JSON").expect("searches");
    searches["checks"] = if is_due { json!([{"neighbours": KEYFRAMES - 5}]) } else { json!([]) };
    map.put_json("state.json", &searches);
    state.put_block("keyframes", map);
    let mut poses = TrackedPoses::new(PoseMode::Track);
    let state = state.to_bytes().expect("the state fits");
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
