//! What is known of a scene that is done.

use serde::{Deserialize, Serialize};
use serde_json::Value;
use splatseg_input::read_file;
use splatseg_metrics::{ScoreSettings, VideoScore};
use std::path::Path;

/// A larger file is not one of our rows.
const MAX_ROW_BYTES: u64 = 64_000_000;

/// A row of `results.parquet`. Its file in `rows/` is written last: where it is, the scene is done.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Row {
    /// The scene as it was given.
    pub scene: String,
    /// The folder of its results.
    pub out: String,
    /// Version of splatseg.
    pub version: String,
    /// The settings of its run.
    pub settings: Value,
    /// How it was scored.
    pub score_settings: ScoreSettings,
    /// Frames with a result.
    pub frames: usize,
    /// Frames that could not be used.
    pub skipped_frames: usize,
    /// Distinct ids.
    pub segments: usize,
    /// Gaussians in the memory at the end.
    pub gaussians: usize,
    /// Peak memory of the process that did it, megabytes.
    pub peak_memory_mb: Option<f64>,
    /// How long it took, with everything.
    pub seconds: f64,
    /// Its score; `None` for a scene without ground truth.
    pub score: Option<VideoScore>,
}

impl Row {
    /// The row in a file, if one is there that can be read.
    pub fn read(path: &Path) -> Option<Self> {
        serde_json::from_slice(&read_file(path, MAX_ROW_BYTES).ok()?).ok()
    }
}
