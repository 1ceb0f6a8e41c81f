//! The result row of a finished scene.

use serde::{Deserialize, Serialize};
use serde_json::Value;
use splatseg_files::read_file;
use splatseg_metrics::{ScoreSettings, VideoScore};
use std::path::Path;

/// Largest row that is read, bytes.
const MAX_ROW_BYTES: u64 = 64_000_000;

/// A row of `results.parquet`. Its file in `rows/` is written last: if it exists, the scene is done.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Row {
    /// The scene as given on the command line or in a list.
    pub scene: String,
    /// Folder of the scene's results.
    pub out: String,
    /// Version of splatseg.
    pub version: String,
    /// Settings of the run.
    pub settings: Value,
    /// Score settings.
    pub score_settings: ScoreSettings,
    /// Frames with a result.
    pub frames: usize,
    /// Frames that could not be used.
    pub skipped_frames: usize,
    /// Distinct ids.
    pub segments: usize,
    /// Gaussians in the memory at the end.
    pub gaussians: usize,
    /// Peak memory of the worker process, megabytes.
    pub peak_memory_mb: Option<f64>,
    /// Total time including scoring, seconds.
    pub seconds: f64,
    /// The scene's score, or `None` without ground truth.
    pub score: Option<VideoScore>,
}

impl Row {
    /// Reads a row. Returns `None` if the file is missing or invalid.
    pub fn read(path: &Path) -> Option<Self> {
        serde_json::from_slice(&read_file(path, MAX_ROW_BYTES).ok()?).ok()
    }
}
