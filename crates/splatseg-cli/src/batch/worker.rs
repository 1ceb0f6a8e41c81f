//! A worker process that runs one scene after another. It reads jobs from standard input and writes answers to standard
//! output, each as a line of JSON, until its input ends.

use super::plan::BatchJob;
use super::row::Row;
use crate::Failure;
use crate::output_folder::OverwritePolicy;
use crate::run::{RunJob, SavedRun, execute};
use serde::{Deserialize, Serialize};
use splatseg::evaluation::{EvaluationOptions, Ids, MissingFrames, evaluate};
use splatseg::pipeline::LoadedNetworks;
use splatseg::{Settings, summary::Summary};
use splatseg_dataset::open_scene;
use splatseg_metrics::VideoScore;
use splatseg_output::write_atomically;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

/// A worker's answer to a job.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Answer {
    /// Frames with a result.
    pub frames: usize,
    /// Error message, if the scene failed.
    pub error: Option<String>,
}

/// Processes jobs until there are no more.
///
/// # Errors
/// If a line of standard input is not a job, or an answer cannot be written.
pub fn work() -> Result<(), Failure> {
    let networks = Arc::new(LoadedNetworks::default());
    for line in std::io::stdin().lines() {
        let job: BatchJob = serde_json::from_str(&line.map_err(Failure::input)?).map_err(Failure::input)?;
        let answer = match run_job(&job, &networks) {
            Ok(row) => Answer { frames: row.frames, error: None },
            Err(Failure::Interrupted { code, text }) => return Err(Failure::Interrupted { code, text }),
            Err(failure) => Answer { frames: 0, error: Some(failure.to_string()) },
        };
        let mut output = std::io::stdout().lock();
        let text = serde_json::to_string(&answer).map_err(Failure::runtime)?;
        writeln!(output, "{text}").and_then(|()| output.flush()).map_err(Failure::runtime)?;
    }
    Ok(())
}

/// Runs a job, unless it is done, and writes its row.
fn run_job(job: &BatchJob, networks: &Arc<LoadedNetworks>) -> Result<Row, Failure> {
    if let Some(row) = job.done_row() {
        return Ok(row);
    }
    let started = Instant::now();
    let mut settings: Settings = serde_json::from_value(job.settings.clone()).map_err(Failure::input)?;
    settings.settle_depth(Path::new(&job.scene)).map_err(Failure::input)?;
    let summary = execute(&planned_run(job, &settings, networks)?)?;
    let score = score_scene(job, &settings)?;
    let row = new_row(job, &summary, score, started.elapsed().as_secs_f64());
    let text = serde_json::to_vec(&row).map_err(Failure::runtime)?;
    write_atomically(Path::new(&job.row), &text).map_err(Failure::runtime)?;
    Ok(row)
}

/// Returns the run of a job. It resumes a stopped run if possible.
fn planned_run(job: &BatchJob, settings: &Settings, networks: &Arc<LoadedNetworks>) -> Result<RunJob, Failure> {
    let (scene, out) = (PathBuf::from(&job.scene), PathBuf::from(&job.out));
    let saved = SavedRun::open(&out).ok().flatten();
    let resume = saved.filter(|saved| settings.run.save_every > 0 && saved.matches(&scene, settings));
    Ok(RunJob {
        existing: if resume.is_some() { OverwritePolicy::Resume } else { OverwritePolicy::Replace },
        scene,
        out,
        settings: settings.clone(),
        save_memory: None,
        load_memory: None,
        resume,
        save_coco: None,
        save_mcap: None,
        networks: Arc::clone(networks),
    })
}

/// Scores a scene. Returns `None` if it has no ground truth.
fn score_scene(job: &BatchJob, settings: &Settings) -> Result<Option<VideoScore>, Failure> {
    let scene = open_scene(&job.scene, &settings.dataset).map_err(Failure::input)?;
    if !scene.has_ground_truth() {
        return Ok(None);
    }
    // Frames that could not be used are counted in the summary and scored as empty.
    let (missing, ids) = (MissingFrames::Allowed, Ids::Lasting);
    let options = EvaluationOptions { score: job.score, missing, ids, video: None, min_score: 0.0, truth: None };
    let found = evaluate(scene.as_ref(), &settings.dataset, Path::new(&job.out), &options);
    Ok(Some(found.map_err(Failure::input)?.score))
}

fn new_row(job: &BatchJob, summary: &Summary, score: Option<VideoScore>, seconds: f64) -> Row {
    Row {
        scene: job.scene.clone(),
        out: job.out.clone(),
        version: summary.version.clone(),
        settings: job.settings.clone(),
        score_settings: job.score,
        frames: summary.frames,
        skipped_frames: summary.skipped_frames,
        segments: summary.segments,
        gaussians: summary.gaussians,
        peak_memory_mb: summary.peak_memory_mb,
        seconds,
        score,
    }
}
