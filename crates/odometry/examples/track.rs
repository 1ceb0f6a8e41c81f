//! Tracks the camera through a scene with poses, and compares the result with them.
//!
//! `cargo run --release -p splatseg-odometry --example track -- SCENE [WIDTHxHEIGHT] [FIRST] [MAX_FRAMES] [FROM+COUNT]`
//!
//! With `FROM+COUNT`, the lens is covered for that many frames: they are black and without depth. `-` stands for a default.
//!
//! Prints losses, corrections, the error of the trajectory (after the best rigid alignment of the first frame only), and
//! times per frame; after a loss also the number of frames in which a part of the map was in view that is not too far for
//! the camera to be found.

use splatseg_dataset::{DatasetSettings, FrameStream, GroundTruth, open_scene};
use splatseg_geometry::{CameraFrame, Image, KeyframeId, Pose};
use splatseg_odometry::{PoseMode, PoseSource, PoseState, TrackedPoses};
use std::error::Error;
use std::ops::Range;
use std::time::Instant;

/// A view is mapped if a keyframe is this close to it, metres and degrees.
const MAPPED: (f64, f64) = (0.5, 30.0);

/// A tracked frame: its number, its keyframe, its pose relative to that, the true pose.
struct Tracked {
    number: usize,
    keyframe: KeyframeId,
    key_from_camera: Pose,
    truth: Pose,
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let argument = |index: usize| arguments.get(index).filter(|text| *text != "-");
    let scene = argument(0).ok_or("expected SCENE")?;
    let mut settings = DatasetSettings::default();
    settings.resize = argument(1).map(|size| size.parse()).transpose()?;
    let first: usize = argument(2).map_or(Ok(0), |first| first.parse())?;
    let count: usize = argument(3).map_or(Ok(usize::MAX), |count| count.parse())?;
    let covered_frames = argument(4).map_or(Ok(0..0), |text| covered_frames(text))?;
    let frames = FrameStream::open(open_scene(scene, &settings)?, &settings, GroundTruth::Skip)?;
    let mut poses = TrackedPoses::new(PoseMode::Track);
    let (mut tracked, mut times, mut was, mut mapped_views) = (Vec::new(), Vec::new(), PoseState::Tracked, 0);
    for (number, streamed) in frames.skip(first).take(count).enumerate() {
        let streamed = streamed?;
        let truth = streamed.world_from_camera.ok_or("the scene has no poses")?;
        let is_covered = covered_frames.contains(&number);
        let frame = if is_covered { covered(&streamed.frame)? } else { streamed.frame };
        let nearest = nearest_keyframe(&poses, &truth);
        let started = Instant::now();
        let found = poses.pose(&frame, Some(&truth))?;
        times.push(started.elapsed().as_secs_f64() * 1e3);
        let name = frame.name();
        if let Some(correction) = poses.take_correction() {
            let moved = correction.new_from_old.iter().map(|(id, motion)| {
                let pose = poses.keyframe_poses()[id];
                (motion.inverse() * pose).translation().distance(pose.translation())
            });
            let most = moved.fold(0.0, f64::max);
            println!("{name}: loop {:?}, up to {:.1} cm", correction.joined, 100.0 * most);
        }
        if found.state != was {
            let error = found.world_from_camera.translation().distance(truth.translation());
            match found.state {
                PoseState::Lost => println!("{name}: lost"),
                _ => println!(
                    "{name}: found, {:.1} cm wrong; {mapped_views} mapped views before; nearest keyframe {:.0} cm and {:.0}° away",
                    100.0 * error,
                    100.0 * nearest.0,
                    nearest.1
                ),
            }
            (was, mapped_views) = (found.state, 0);
        }
        if found.state == PoseState::Lost {
            let is_mapped = nearest.0 <= MAPPED.0 && nearest.1 <= MAPPED.1;
            mapped_views += usize::from(is_mapped && !is_covered);
        } else {
            let anchor = poses.anchor();
            let key_from_camera = anchor.world_from_keyframe.inverse() * found.world_from_camera;
            tracked.push(Tracked { number, keyframe: anchor.keyframe, key_from_camera, truth });
        }
    }
    report(&poses, &tracked, &mut times, &covered_frames);
    Ok(())
}

/// Prints errors and times.
fn report(poses: &TrackedPoses, tracked: &[Tracked], times: &mut [f64], covered_frames: &Range<usize>) {
    let keyframes = poses.keyframe_poses();
    let print = |when: &str, frames: &[&Tracked]| {
        let squared: Vec<f64> = frames
            .iter()
            .map(|frame| {
                let pose = keyframes[&frame.keyframe] * frame.key_from_camera;
                pose.translation().distance_squared(frame.truth.translation())
            })
            .collect();
        let rms = (squared.iter().sum::<f64>() / squared.len().max(1) as f64).sqrt();
        let largest = squared.iter().copied().fold(0.0, f64::max).sqrt();
        println!("position error{when} (not aligned): {:.2} cm, at most {:.2} cm", 100.0 * rms, 100.0 * largest);
    };
    println!("{} frames tracked of {}, {} keyframes", tracked.len(), times.len(), keyframes.len());
    if !covered_frames.is_empty() {
        let (before, after): (Vec<&Tracked>, Vec<&Tracked>) =
            tracked.iter().partition(|frame| frame.number < covered_frames.start);
        print(" before the cover", &before);
        print(" after the cover", &after);
    }
    print("", &tracked.iter().collect::<Vec<_>>());
    times.sort_by(f64::total_cmp);
    let mean = times.iter().sum::<f64>() / times.len().max(1) as f64;
    let quantile = |share: f64| times.get((share * times.len() as f64) as usize).copied().unwrap_or(0.0);
    println!("ms per frame: mean {mean:.1}, median {:.1}, 99 % {:.1}", quantile(0.5), quantile(0.99));
    let bytes = poses.keyframes().map_or(0, |bytes| bytes.len());
    println!("saved keyframes: {:.1} kB each", bytes as f64 / 1e3 / keyframes.len().max(1) as f64);
}

/// The frames that `FROM+COUNT` means.
fn covered_frames(text: &str) -> Result<Range<usize>, Box<dyn Error>> {
    let (from, count) = text.split_once('+').ok_or("expected FROM+COUNT")?;
    let from: usize = from.parse()?;
    Ok(from..from + count.parse::<usize>()?)
}

/// The frame with a covered lens.
fn covered(frame: &CameraFrame<'_>) -> Result<CameraFrame<'static>, Box<dyn Error>> {
    let (width, height) = (frame.width(), frame.height());
    let (color, depth) = (Image::filled(width, height, [0; 3]), Image::filled(width, height, 0.0));
    Ok(CameraFrame::new(frame.name(), color, depth, *frame.intrinsics())?)
}

/// Distance of the keyframe nearest to a pose, relative to [`MAPPED`]: metres and degrees.
fn nearest_keyframe(poses: &TrackedPoses, truth: &Pose) -> (f64, f64) {
    let apart = |pose: &Pose| {
        let difference = (pose.inverse() * *truth).rotation();
        let cosine = 0.5 * (difference.x_axis.x + difference.y_axis.y + difference.z_axis.z - 1.0);
        (pose.translation().distance(truth.translation()), cosine.clamp(-1.0, 1.0).acos().to_degrees())
    };
    let relative = |(metres, degrees): &(f64, f64)| (metres / MAPPED.0).max(degrees / MAPPED.1);
    let distances = poses.keyframe_poses().into_values().map(|pose| apart(&pose));
    let nearest = distances.min_by(|one, other| relative(one).total_cmp(&relative(other)));
    nearest.unwrap_or((f64::INFINITY, f64::INFINITY))
}
