//! Tracks the camera through a scene with poses, and compares the result with them.
//!
//! `cargo run --release -p splatseg-odometry --example track -- SCENE [WIDTHxHEIGHT] [FIRST] [MAX_FRAMES] [FROM+COUNT]
//! [IDS] [FX]`
//!
//! `-` stands for a default. With `FROM+COUNT`, the lens is covered for that many frames: they are black and without
//! depth. `IDS` are the segments passed to tracking after each frame: `none`, `truth` (the true ids), `walls` (the
//! true ids, but one for walls, floor and ceiling of the synthetic room) or `grid` (12 cells of the image). `FX` replaces
//! the focal length, pixels of the stored images.
//!
//! Prints losses, corrections, the error of the trajectory (after the best rigid alignment of the first frame only),
//! loops that were found and missed, and times per frame. Every 2,000 frames it prints times, keyframes and memory since
//! then. Times are the wall clock's and the CPU's, which a busy machine disturbs less.

mod cost;
mod cover;
mod loops;
mod segments;

use cost::{Cost, Costs};
use loops::TruePath;
use splatseg_dataset::{DatasetSettings, FrameStream, GroundTruth, StreamedFrame, open_scene};
use splatseg_geometry::{FrameAnchor, KeyframeId, MapCorrection, Pose};
use splatseg_odometry::{
    CameraPose, MethodFindings, PoseInput, PoseMode, PoseSource, PoseState, PoseUpdate, StateScope, TrackedPoses,
};
use std::error::Error;
use std::ops::Range;

/// Number of frames after which times and sizes are printed.
const INTERVAL: usize = 2000;

/// A tracked frame: its number, its keyframe, its pose relative to that, the true pose.
struct Tracked {
    number: usize,
    keyframe: KeyframeId,
    key_from_camera: Pose,
    truth: Pose,
}

/// A run and what is known about it.
struct Run {
    poses: TrackedPoses,
    tracked: Vec<Tracked>,
    was: PoseState,
    costs: Costs,
    path: TruePath,
    /// Frames with a covered lens.
    covered: Range<usize>,
    ids: String,
    /// Frames since the camera was lost that show a part of the map.
    mapped_views: usize,
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let argument = |index: usize| arguments.get(index).filter(|text| *text != "-");
    let scene = argument(0).ok_or("expected SCENE")?;
    let mut settings = DatasetSettings::default();
    settings.resize = argument(1).map(|size| size.parse()).transpose()?;
    let first: usize = argument(2).map_or(Ok(0), |first| first.parse())?;
    let count: usize = argument(3).map_or(Ok(usize::MAX), |count| count.parse())?;
    settings.fx = argument(6).map(|focal| focal.parse()).transpose()?;
    let frames = FrameStream::open(open_scene(scene, &settings)?, &settings, GroundTruth::Read)?;
    let mut run = Run {
        poses: TrackedPoses::new(PoseMode::Track),
        tracked: Vec::new(),
        was: PoseState::Tracked,
        costs: Costs::default(),
        path: TruePath::default(),
        covered: argument(4).map_or(Ok(0..0), |text| cover::covered_frames(text))?,
        ids: argument(5).cloned().unwrap_or_default(),
        mapped_views: 0,
    };
    for (number, streamed) in frames.skip(first).take(count).enumerate() {
        run.step(number, streamed?)?;
        if (number + 1) % INTERVAL == 0 {
            run.print_interval(number + 1);
        }
    }
    run.print_errors();
    run.costs.print();
    run.path.print(&run.poses.save(StateScope::Map).unwrap_or_default())?;
    Ok(())
}

impl Run {
    fn step(&mut self, number: usize, streamed: StreamedFrame) -> Result<(), Box<dyn Error>> {
        let truth = streamed.world_from_camera.ok_or("the scene has no poses")?;
        let is_covered = self.covered.contains(&number);
        let frame = if is_covered { cover::covered(&streamed.frame)? } else { streamed.frame };
        let keyframes = self.poses.keyframes().into_values().map(|keyframe| keyframe.world_from_keyframe);
        let nearest = cover::nearest(keyframes, &truth);
        // On a thread of the pool, as the pipeline does.
        let (found, cost) =
            Cost::of(|| rayon::scope(|_| self.poses.pose(&frame, PoseInput::new(number, Some(&truth)))));
        let PoseUpdate { pose: found, anchor, correction, .. } = found?;
        if let Some(segments) = segments::segments(&self.ids, streamed.ground_truth.as_ref(), frame.depth().size()) {
            self.poses.receive(MethodFindings { segments: Some(&segments), ..MethodFindings::default() });
        }
        let name = frame.name();
        if let Some(correction) = &correction {
            print_correction(name, correction, &self.poses);
        }
        if found.state != self.was {
            self.print_state(name, &found, &truth, nearest);
        }
        if found.state == PoseState::Lost {
            self.mapped_views += usize::from(cover::is_mapped(nearest) && !is_covered);
        }
        let is_new = found.state != PoseState::Lost && self.record(number, &found, &anchor, truth);
        let kind = match (correction.is_some(), is_new) {
            (true, _) => "corrects the map",
            (_, true) => "becomes a keyframe",
            _ => "",
        };
        self.costs.add(name, cost, kind);
        Ok(())
    }

    fn print_state(&mut self, name: &str, found: &CameraPose, truth: &Pose, nearest: (f64, f64)) {
        let error = 100.0 * found.world_from_camera.translation().distance(truth.translation());
        let views = self.mapped_views;
        match (found.state, nearest) {
            (PoseState::Lost, _) => println!("{name}: lost"),
            (_, (metres, degrees)) => println!(
                "{name}: found, {error:.1} cm wrong; {views} mapped views before; nearest keyframe {:.0} cm and {degrees:.0}° away",
                100.0 * metres
            ),
        }
        (self.was, self.mapped_views) = (found.state, 0);
    }

    /// Records a frame with a pose. Returns true if it became a keyframe.
    fn record(&mut self, number: usize, found: &CameraPose, anchor: &FrameAnchor, truth: Pose) -> bool {
        let key_from_camera = anchor.world_from_keyframe.inverse() * found.world_from_camera;
        self.tracked.push(Tracked { number, keyframe: anchor.keyframe, key_from_camera, truth });
        self.path.record(anchor.keyframe, &truth)
    }

    fn print_interval(&mut self, frames: usize) {
        let memory = cost::memory();
        let saved = self.poses.save(StateScope::Map).unwrap_or_default();
        let sizes = loops::sizes(&saved).unwrap_or_else(|error| error.to_string());
        println!("after {frames} frames: {}; {sizes}, {memory}", self.costs.since_last());
    }

    fn print_errors(&mut self) {
        let keyframes = self.poses.keyframes();
        let print = |when: &str, is_included: &dyn Fn(usize) -> bool| {
            let included = self.tracked.iter().filter(|frame| is_included(frame.number));
            let squared: Vec<f64> = included
                .map(|frame| {
                    let pose = keyframes[&frame.keyframe].world_from_keyframe * frame.key_from_camera;
                    pose.translation().distance_squared(frame.truth.translation())
                })
                .collect();
            let rms = (squared.iter().sum::<f64>() / squared.len().max(1) as f64).sqrt();
            let largest = squared.iter().copied().fold(0.0, f64::max).sqrt();
            println!("position error{when} (not aligned): {:.2} cm, at most {:.2} cm", 100.0 * rms, 100.0 * largest);
        };
        println!("{} frames tracked of {}, {} keyframes", self.tracked.len(), self.costs.len(), keyframes.len());
        if !self.covered.is_empty() {
            print(" before the cover", &|number| number < self.covered.start);
            print(" after the cover", &|number| number >= self.covered.start);
        }
        print("", &|_| true);
        let poses = self.tracked.iter().map(|frame| frame.key_from_camera);
        println!("hash of the poses: {:016x}", segments::hash(poses));
        self.poses.finish().iter().for_each(|doubt| println!("doubt: {}", doubt.text));
        let bytes = self.poses.save(StateScope::Map).map_or(0, |bytes| bytes.len());
        println!("saved keyframes: {:.1} kB each", bytes as f64 / 1e3 / keyframes.len().max(1) as f64);
    }
}

fn print_correction(name: &str, correction: &MapCorrection, poses: &TrackedPoses) {
    let keyframes = poses.keyframes();
    let moved = correction.new_from_old.iter().map(|(id, motion)| {
        let pose = keyframes[id].world_from_keyframe;
        (motion.inverse() * pose).translation().distance(pose.translation())
    });
    println!("{name}: loop {:?}, up to {:.1} cm", correction.joined, 100.0 * moved.fold(0.0, f64::max));
}
