//! `summary.json`: the results of a run, for scripts.

use crate::Settings;
use crate::pipeline::{FrameResult, MapScale, StageTimes};
use crate::relative_paths::relative_to;
use serde::{Deserialize, Serialize};
use splatseg_dataset::GuessedCamera;
use splatseg_geometry::{MAX_16_BIT_ID, RemappedId};
use splatseg_objects::ObjectSighting;
use splatseg_odometry::{InputDoubt, PoseEventCounts, PoseState};
use splatseg_tracking::TrackErrorCounts;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::time::Duration;

/// The value of the key `paths` in `summary.json`: relative paths are relative to its folder. Without the key, they are
/// relative to the folder in which the run was started.
pub const RELATIVE_PATHS: &str = "relative to this file";

/// The content of `summary.json`. Its keys are part of the public interface.
#[derive(Clone, Debug, Serialize)]
pub struct Summary {
    /// Frames with a result.
    pub frames: usize,
    /// Number of these frames that existed before `--resume`. Times and speeds exclude them.
    pub resumed_frames: usize,
    /// Frames that could not be read or segmented.
    pub skipped_frames: usize,
    /// Frames by the state of the camera's pose.
    pub pose_states: PoseStateCounts,
    /// How often a lost camera was found in the map, a loop was closed, and a new part of the map began or was joined
    /// with the rest.
    pub pose_events: PoseEventCounts,
    /// Frames in parts of the map that were never joined with the rest: their poses are right relative to each other only.
    pub unjoined_frames: usize,
    /// Median deviation of the measured depth from the surfaces that the camera was tracked against, in units of a
    /// Kinect's deviation; null if no frame was tracked.
    pub pose_residual: Option<f32>,
    /// Doubts about the input, a sentence each, as the run has printed them; absent if there were none.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub input_doubts: Vec<String>,
    /// Number of objects: those that count, as in `objects.json`.
    pub objects: usize,
    /// Tentative objects, which do not count: seen in one frame only, so each may be a mistake.
    pub tentative_objects: usize,
    /// Forgotten objects, which do not count: no longer in the memory.
    pub forgotten_objects: usize,
    /// Distinct ids in the id images, whatever became of their objects.
    pub segments: usize,
    /// Ids that turned out to be the same object as an older id, which has replaced them in all results.
    pub remapped_ids: usize,
    /// Frames whose id image is RGB, id = R + 256 G + 65536 B, because an id is above 65535. The others are 16-bit grey.
    pub rgb_id_images: usize,
    /// Gaussians in the memory at the end.
    pub gaussians: usize,
    /// Number of parameters of the memory at the end.
    pub parameters: usize,
    /// Peak resident memory of the process so far, megabytes (10^6 bytes); null where unknown.
    pub peak_memory_mb: Option<f64>,
    /// Mean time of each stage per frame, milliseconds.
    pub stage_ms: BTreeMap<String, f64>,
    /// Tracker errors that the method found and corrected.
    pub track_errors: TrackErrorCounts,
    /// Time of the slowest frame, all stages except the segmenter, milliseconds.
    pub slowest_frame_ms: f64,
    /// Time before the first frame (opening the scene, loading networks, computing a codebook), seconds.
    pub start_up_s: f64,
    /// Time of the final pass, in which the map of the end decided the ids of all frames again, seconds; null if there was
    /// none. No other time or speed includes it.
    pub final_pass_s: Option<f64>,
    /// Where the map's scale is from, if all of its depth is predicted; null otherwise.
    pub scale: Option<MapScale>,
    /// The focal length that was estimated from the images or assumed, and a range, pixels, if nothing describes the
    /// camera; null otherwise.
    pub guessed_camera: Option<GuessedCamera>,
    /// Frames per second.
    pub fps: FramesPerSecond,
    /// State of the run at up to 64 frames in equal steps.
    pub curve: Vec<CurvePoint>,
    /// True if a signal (Ctrl-C, `kill`) stopped the run before the last frame.
    pub interrupted: bool,
    /// The error that ended the run before the last frame, and errors writing results; null if the run is complete.
    pub error: Option<String>,
    /// The scene as given on the command line; in the file, a relative path is relative to the file's folder.
    pub scene: String,
    /// [`RELATIVE_PATHS`] in the file, where the paths of the scene and in the settings are relative to the file's folder;
    /// missing while they are relative to the current folder.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub paths: Option<&'static str>,
    /// The settings of the run.
    pub settings: Settings,
    /// Random seed.
    pub seed: u64,
    /// Version of splatseg.
    pub version: String,
}

impl Summary {
    /// The text of `summary.json` in `folder`, which must exist.
    ///
    /// # Errors
    /// No known cause: every value can be serialised.
    pub fn to_json(&self, folder: &Path) -> serde_json::Result<String> {
        let scene = relative_to(folder, Path::new(&self.scene)).display().to_string();
        let settings = self.settings.clone().relative_to(folder);
        serde_json::to_string_pretty(&Self { scene, settings, paths: Some(RELATIVE_PATHS), ..self.clone() })
    }
}

/// Numbers of frames by the state of the camera's pose.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct PoseStateCounts {
    /// The pose came with the frame.
    pub given: usize,
    /// The pose was tracked.
    pub tracked: usize,
    /// Tracking was lost.
    pub lost: usize,
}

impl PoseStateCounts {
    /// Adds a frame.
    pub fn add(&mut self, state: PoseState) {
        match state {
            PoseState::Given => self.given += 1,
            PoseState::Tracked => self.tracked += 1,
            PoseState::Lost => self.lost += 1,
        }
    }
}

/// Speed of a run.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct FramesPerSecond {
    /// From wall-clock time, including start-up, reading and writing.
    pub total: f64,
    /// From the time of all stages except the segmenter.
    pub without_segmenter: f64,
}

/// The state of a run at one frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CurvePoint {
    /// Frames with a result so far.
    pub frame: usize,
    /// Gaussians in the memory.
    pub gaussians: usize,
    /// Resident memory of the process, megabytes (10^6 bytes); null where unknown.
    pub memory_mb: Option<f64>,
    /// Mean time per frame since the previous point, all stages except the segmenter, milliseconds.
    pub ms: f64,
}

/// Samples a run of unknown length, one point every `step` frames. `step` doubles when there are too many points.
#[derive(Clone, Debug)]
pub struct RunCurve {
    points: Vec<CurvePoint>,
    step: usize,
    frames: usize,
    time: Duration,
}

impl Default for RunCurve {
    fn default() -> Self {
        Self { points: Vec::new(), step: 1, frames: 0, time: Duration::ZERO }
    }
}

impl RunCurve {
    /// Largest number of points.
    const MAX_POINTS: usize = 64;

    /// Adds a frame. `time` covers all stages except the segmenter.
    pub fn push(&mut self, time: Duration, gaussians: usize) {
        self.frames += 1;
        self.time += time;
        if !self.frames.is_multiple_of(self.step) {
            return;
        }
        let ms = self.time.as_secs_f64() * 1e3 / self.step as f64;
        self.points.push(CurvePoint { frame: self.frames, gaussians, memory_mb: memory_mb("VmRSS:"), ms });
        self.time = Duration::ZERO;
        if self.points.len() >= Self::MAX_POINTS {
            self.halve();
        }
    }

    /// Merges pairs of points.
    fn halve(&mut self) {
        let of_two = |pair: &[CurvePoint]| CurvePoint { ms: 0.5 * (pair[0].ms + pair[1].ms), ..pair[1] };
        self.points = self.points.chunks_exact(2).map(of_two).collect();
        self.step *= 2;
    }

    /// Returns the points.
    pub fn into_points(self) -> Vec<CurvePoint> {
        self.points
    }
}

/// Returns true if the id image of a frame with these objects must be RGB.
pub fn needs_rgb(objects: &[ObjectSighting]) -> bool {
    objects.iter().any(|object| object.id > MAX_16_BIT_ID)
}

/// Counts over the frames of a run.
#[derive(Clone, Debug, Default)]
pub struct RunCounts {
    /// Frames with a result.
    pub frames: usize,
    /// Number of these frames that an earlier run processed before it was resumed. Times and speeds exclude them.
    pub resumed_frames: usize,
    /// Frames that could not be read or segmented.
    pub skipped_frames: usize,
    /// Frames by the state of the camera's pose.
    pub pose_states: PoseStateCounts,
    /// Events of the source of poses.
    pub pose_events: PoseEventCounts,
    /// Frames in parts of the map that were never joined with the rest; known at the end.
    pub unjoined_frames: usize,
    /// Residual of each tracked frame; see [`PoseQuality::residual`](splatseg_odometry::PoseQuality::residual).
    pub pose_residuals: Vec<f32>,
    /// Doubts about the input that the run has printed; each sentence once.
    pub input_doubts: Vec<String>,
    /// Distinct ids in results.
    pub ids: BTreeSet<u32>,
    /// Ids that turned out to be the same object as an older id.
    pub remapped_ids: usize,
    /// Frames with an id above 65535.
    pub rgb_id_images: usize,
    /// Summed stage times.
    pub times: StageTimes,
    /// Summed errors of the tracker.
    pub track_errors: TrackErrorCounts,
    /// State of the run over time.
    pub curve: RunCurve,
    /// Time of the slowest frame, all stages except the segmenter.
    pub slowest: Duration,
    /// True if the run was stopped before the last frame.
    pub interrupted: bool,
}

impl RunCounts {
    /// Adds a frame with a result. `gaussians` is the size of the memory after it.
    pub fn add(&mut self, result: &FrameResult, gaussians: usize) {
        self.rgb_id_images += usize::from(needs_rgb(&result.objects));
        let time = result.times.without_segmenter();
        self.frames += 1;
        self.pose_states.add(result.pose.state);
        result.events.iter().for_each(|event| self.pose_events.add(event));
        self.pose_residuals.extend(result.pose.quality.map(|quality| quality.residual));
        self.times += &result.times;
        self.track_errors += result.output.track_errors;
        self.slowest = self.slowest.max(time);
        self.curve.push(time, gaussians);
        self.remap(&result.remapped);
        self.ids.extend(result.output.segments.areas().into_keys());
    }

    /// Adds a doubt about the input that the run has told.
    pub fn add_doubt(&mut self, doubt: &InputDoubt) {
        // A resumed run may tell the same again.
        if !self.input_doubts.contains(&doubt.text) {
            self.input_doubts.push(doubt.text.clone());
        }
    }

    /// Counts ids that turned out to be the same object as an older id before the next frame.
    pub fn remap(&mut self, remapped: &[RemappedId]) {
        self.remapped_ids += remapped.len();
        for RemappedId { from, into } in remapped {
            if self.ids.remove(from) {
                self.ids.insert(*into);
            }
        }
    }

    /// Median residual of the tracked frames that this run processed itself.
    pub fn pose_residual(&self) -> Option<f32> {
        let mut residuals = self.pose_residuals.clone();
        residuals.sort_by(f32::total_cmp);
        residuals.get(residuals.len() / 2).copied()
    }

    /// Number of frames that this run processed itself.
    fn new_frames(&self) -> usize {
        self.frames - self.resumed_frames
    }

    /// Mean time of each stage per frame, milliseconds.
    pub fn stage_ms(&self) -> BTreeMap<String, f64> {
        let frames = self.new_frames().max(1) as f64;
        self.times.stages().iter().map(|(name, time)| ((*name).to_owned(), time.as_secs_f64() * 1e3 / frames)).collect()
    }

    /// Returns the speed, given the wall-clock time of the whole run.
    pub fn fps(&self, wall: Duration) -> FramesPerSecond {
        let rate = |time: Duration| if time.is_zero() { 0.0 } else { self.new_frames() as f64 / time.as_secs_f64() };
        FramesPerSecond { total: rate(wall), without_segmenter: rate(self.times.without_segmenter()) }
    }
}

/// Returns the peak resident memory of this process, megabytes (10^6 bytes). Known on Linux only.
pub fn peak_memory_mb() -> Option<f64> {
    memory_mb("VmHWM:")
}

fn memory_mb(field: &str) -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix(field))?;
    let kibibytes: f64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kibibytes * 1024.0 / 1e6)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_run_has_few_points_in_equal_steps() {
        let mut curve = RunCurve::default();
        for frame in 1..=1000 {
            curve.push(Duration::from_millis(frame), frame as usize);
        }
        let points = curve.into_points();
        assert!((32..=64).contains(&points.len()), "{}", points.len());
        let step = points[0].frame;
        for (index, point) in points.iter().enumerate() {
            assert_eq!(point.frame, (index + 1) * step);
            assert_eq!(point.gaussians, point.frame);
            let mean = (point.frame as f64 + (point.frame - step + 1) as f64) / 2.0;
            assert!((point.ms - mean).abs() < 1e-9, "{} instead of {mean}", point.ms);
        }
    }
}
