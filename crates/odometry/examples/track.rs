//! Tracks the camera through a scene with poses, and compares the result with them.
//!
//! `cargo run --release -p splatseg-odometry --example track -- SCENE [WIDTHxHEIGHT] [FIRST] [MAX_FRAMES]`
//!
//! Prints losses, corrections, the error of the trajectory (after the best rigid alignment of the first frame only), and
//! times per frame.

use splatseg_dataset::{DatasetSettings, FrameStream, GroundTruth, open_scene};
use splatseg_geometry::{KeyframeId, Pose};
use splatseg_odometry::{PoseMode, PoseSource, PoseState, TrackedPoses};
use std::error::Error;
use std::time::Instant;

/// A tracked frame: its keyframe, its pose relative to that, the true pose.
struct Tracked {
    keyframe: KeyframeId,
    key_from_camera: Pose,
    truth: Pose,
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let scene = arguments.next().ok_or("expected SCENE")?;
    let mut settings = DatasetSettings::default();
    settings.resize = arguments.next().filter(|size| size != "-").map(|size| size.parse()).transpose()?;
    let first: usize = arguments.next().map_or(Ok(0), |first| first.parse())?;
    let count: usize = arguments.next().map_or(Ok(usize::MAX), |count| count.parse())?;
    let frames = FrameStream::open(open_scene(&scene, &settings)?, &settings, GroundTruth::Skip)?;
    let mut poses = TrackedPoses::new(PoseMode::Track);
    let (mut tracked, mut times, mut was) = (Vec::new(), Vec::new(), PoseState::Tracked);
    for streamed in frames.skip(first).take(count) {
        let streamed = streamed?;
        let truth = streamed.world_from_camera.ok_or("the scene has no poses")?;
        let started = Instant::now();
        let found = poses.pose(&streamed.frame, Some(&truth))?;
        times.push(started.elapsed().as_secs_f64() * 1e3);
        let name = streamed.frame.name();
        if let Some(correction) = poses.take_correction() {
            let moved = correction.new_from_old.iter().map(|(id, motion)| {
                let pose = poses.keyframe_poses()[id];
                (motion.inverse() * pose).translation().distance(pose.translation())
            });
            let most = moved.fold(0.0, f64::max);
            println!("{name}: loop {:?}, up to {:.1} cm", correction.joined, 100.0 * most);
        }
        if found.state != was {
            println!("{name}: {:?}", found.state);
            was = found.state;
        }
        if found.state != PoseState::Lost {
            let anchor = poses.anchor();
            let key_from_camera = anchor.world_from_keyframe.inverse() * found.world_from_camera;
            tracked.push(Tracked { keyframe: anchor.keyframe, key_from_camera, truth });
        }
    }
    let keyframes = poses.keyframe_poses();
    let squared: Vec<f64> = tracked
        .iter()
        .map(|frame| {
            let pose = keyframes[&frame.keyframe] * frame.key_from_camera;
            pose.translation().distance_squared(frame.truth.translation())
        })
        .collect();
    let rms = (squared.iter().sum::<f64>() / squared.len().max(1) as f64).sqrt();
    let largest = squared.iter().copied().fold(0.0, f64::max).sqrt();
    times.sort_by(f64::total_cmp);
    let mean = times.iter().sum::<f64>() / times.len().max(1) as f64;
    let quantile = |share: f64| times.get((share * times.len() as f64) as usize).copied().unwrap_or(0.0);
    println!("{} frames tracked of {}, {} keyframes", tracked.len(), times.len(), keyframes.len());
    println!("position error (not aligned): {:.2} cm, at most {:.2} cm", 100.0 * rms, 100.0 * largest);
    println!("ms per frame: mean {mean:.1}, median {:.1}, 99 % {:.1}", quantile(0.5), quantile(0.99));
    let bytes = poses.keyframes().map_or(0, |bytes| bytes.len());
    println!("saved keyframes: {:.1} kB each", bytes as f64 / 1e3 / keyframes.len().max(1) as f64);
    Ok(())
}
