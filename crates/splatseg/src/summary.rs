//! `summary.json`: what a run did, for scripts.

use crate::Settings;
use serde::{Deserialize, Serialize};
use splatseg_tracking::{StageTimes, TrackErrorCounts};
use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

/// The content of `summary.json`. Its keys are part of the interface.
#[derive(Clone, Debug, Serialize)]
pub struct Summary {
    /// Frames with a result.
    pub frames: usize,
    /// Frames that could not be read or segmented.
    pub skipped_frames: usize,
    /// Distinct ids in the results.
    pub segments: usize,
    /// Gaussians in the memory at the end.
    pub gaussians: usize,
    /// Numbers that the memory holds at the end.
    pub parameters: usize,
    /// Largest resident memory of the process so far, megabytes (10^6 bytes); null where the system does not tell.
    pub peak_memory_mb: Option<f64>,
    /// Mean time of each stage per frame, milliseconds.
    pub stage_ms: BTreeMap<String, f64>,
    /// Errors of the tracker that the method found and put right.
    pub track_errors: TrackErrorCounts,
    /// Time of the slowest frame, all stages but the segmenter, milliseconds.
    pub slowest_frame_ms: f64,
    /// Frames per second.
    pub fps: FramesPerSecond,
    /// Whether the run was stopped (Ctrl-C) before the last frame.
    pub interrupted: bool,
    /// The scene as it was given.
    pub scene: String,
    /// The settings that the run was made with.
    pub settings: Settings,
    /// Seed of everything random.
    pub seed: u64,
    /// Version of splatseg.
    pub version: String,
}

/// Speed of a run.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct FramesPerSecond {
    /// Wall-clock, reading and writing included.
    pub total: f64,
    /// All stages of the method but the segmenter.
    pub without_segmenter: f64,
}

/// Counts over the frames of a run.
#[derive(Clone, Debug, Default)]
pub struct RunCounts {
    /// Frames with a result.
    pub frames: usize,
    /// Frames that could not be read or segmented.
    pub skipped_frames: usize,
    /// Ids seen in results.
    pub ids: BTreeSet<u32>,
    /// Summed stage times.
    pub times: StageTimes,
    /// Summed errors of the tracker.
    pub track_errors: TrackErrorCounts,
    /// Slowest frame, all stages but the segmenter.
    pub slowest: Duration,
    /// Stopped before the last frame.
    pub interrupted: bool,
}

impl RunCounts {
    /// Mean time of each stage per frame, milliseconds.
    pub fn stage_ms(&self) -> BTreeMap<String, f64> {
        let frames = self.frames.max(1) as f64;
        self.times.stages().iter().map(|(name, time)| ((*name).to_owned(), time.as_secs_f64() * 1e3 / frames)).collect()
    }

    /// Speed, given the wall-clock time of the whole run.
    pub fn fps(&self, wall: Duration) -> FramesPerSecond {
        let rate = |time: Duration| if time.is_zero() { 0.0 } else { self.frames as f64 / time.as_secs_f64() };
        FramesPerSecond { total: rate(wall), without_segmenter: rate(self.times.without_segmenter()) }
    }
}

/// The largest resident memory that this process has had, megabytes (10^6 bytes). Only Linux tells without help.
pub fn peak_memory_mb() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kibibytes: f64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kibibytes * 1024.0 / 1e6)
}
