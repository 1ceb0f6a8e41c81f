//! The rows of `results.json` and `failures.json`. Their keys are part of the interface.

use super::Results;
use super::job::JobResult;
use crate::command::score_table::protocol_name;
use serde::Serialize;
use splatseg::Settings;
use splatseg::summary::FramesPerSecond;
use splatseg_metrics::{Protocol, Scores};
use splatseg_tracking::TrackErrorCounts;
use std::collections::BTreeMap;

/// A result and what it is the result of.
pub struct Finished<'a> {
    /// Index of the scene.
    pub scene: usize,
    /// Index of the variant.
    pub variant: usize,
    /// The seed.
    pub seed: u64,
    /// Name of its job.
    pub key: &'a str,
    /// What was measured.
    pub result: &'a JobResult,
}

/// A result that is not there.
#[derive(Clone, Debug, Serialize)]
pub struct Failed<'a> {
    /// Name of the scene.
    pub scene: &'a str,
    /// The scene as it was given.
    pub scene_path: &'a str,
    /// Name of the method.
    pub method: &'static str,
    /// The ablated settings.
    pub variant: Option<String>,
    /// The seed.
    pub seed: u64,
    /// Why.
    pub error: &'a str,
}

/// A row of `results.json`.
#[derive(Clone, Debug, Serialize)]
pub struct Row<'a> {
    /// Name of the scene.
    pub scene: &'a str,
    /// The scene as it was given.
    pub scene_path: &'a str,
    /// Name of the method.
    pub method: &'static str,
    /// The ablated settings, e.g. `memory.feature_dim=14`.
    pub variant: Option<String>,
    /// The seed.
    pub seed: u64,
    /// Name of the segmenter.
    pub segmenter: &'static str,
    /// The protocol of the scores that follow.
    pub protocol: &'static str,
    /// The scores in that protocol, percent.
    #[serde(flatten)]
    pub scores: Scores,
    /// The scores in the other protocol, under its name.
    #[serde(flatten)]
    pub other_protocol: BTreeMap<&'static str, Scores>,
    /// Speed, without scoring.
    pub fps: FramesPerSecond,
    /// Frames with a result.
    pub frames: usize,
    /// Frames that could not be read, and are not scored.
    pub skipped_frames: usize,
    /// Frames that the segmenter failed on, scored as empty.
    pub failed_frames: usize,
    /// Distinct ids in the results.
    pub segments: usize,
    /// Gaussians in the memory at the end.
    pub gaussians: usize,
    /// Numbers that the memory holds at the end.
    pub parameters: usize,
    /// Mean time of each stage per frame, milliseconds.
    pub stage_ms: &'a BTreeMap<String, f64>,
    /// Errors of the tracker that the method found and put right.
    pub track_errors: TrackErrorCounts,
    /// Where the full result is.
    pub file: String,
    /// All settings; `threads` is 0.
    pub settings: &'a Settings,
    /// Version of splatseg.
    pub version: &'a str,
}

impl<'a> Row<'a> {
    /// The row of a result.
    pub fn new(results: &'a Results, finished: &Finished<'a>) -> Self {
        let result = finished.result;
        let (scene, variant) = (&results.plan.scenes[finished.scene], &results.plan.variants[finished.variant]);
        let other = match results.protocol {
            Protocol::Paper => Protocol::Strict,
            Protocol::Strict => Protocol::Paper,
        };
        Self {
            scene: &scene.name,
            scene_path: &scene.path,
            method: variant.method.name(),
            variant: variant.change(),
            seed: finished.seed,
            segmenter: result.inputs.settings.segmenter.name(),
            protocol: protocol_name(results.protocol),
            scores: result.score(results.protocol).scores(),
            other_protocol: BTreeMap::from([(protocol_name(other), result.score(other).scores())]),
            fps: result.fps,
            frames: result.frames,
            skipped_frames: result.skipped_frames,
            failed_frames: result.failed_frames,
            segments: result.segments,
            gaussians: result.gaussians,
            parameters: result.parameters,
            stage_ms: &result.stage_ms,
            track_errors: result.track_errors,
            file: format!("results/{}.json", finished.key),
            settings: &result.inputs.settings,
            version: &result.inputs.version,
        }
    }
}
