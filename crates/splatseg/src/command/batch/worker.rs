//! A process that works on one scene after another: jobs come in on standard input, answers go out on standard output,
//! each a line of JSON. It ends when there are no more.

use super::plan::BatchJob;
use super::row::Row;
use crate::command::Failure;
use crate::command::output_folder::Existing;
use crate::command::run::{Job, SavedRun, execute};
use crate::evaluation::{EvaluationOptions, Ids, MissingFrames, evaluate};
use crate::pipeline::LoadedNetworks;
use crate::{Settings, summary::Summary};
use serde::{Deserialize, Serialize};
use splatseg_dataset::open_scene;
use splatseg_metrics::VideoScore;
use splatseg_output::write_atomically;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

/// What a worker says about a job.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Answer {
    /// Frames with a result.
    pub frames: usize,
    /// Why the scene failed, if it did.
    pub error: Option<String>,
}

/// Works on jobs until there are no more.
///
/// # Errors
/// If standard input has something other than jobs, or nobody reads the answers.
pub fn work() -> Result<(), Failure> {
    let networks = Arc::new(LoadedNetworks::default());
    for line in std::io::stdin().lines() {
        let job: BatchJob = serde_json::from_str(&line.map_err(Failure::input)?).map_err(Failure::input)?;
        let answer = match row_of(&job, &networks) {
            Ok(row) => Answer { frames: row.frames, error: None },
            Err(Failure::Interrupted { code, text }) => return Err(Failure::Interrupted { code, text }),
            Err(failure) => Answer { frames: 0, error: Some(failure.to_string()) },
        };
        let mut output = std::io::stdout().lock();
        let text = serde_json::to_string(&answer).map_err(Failure::work)?;
        writeln!(output, "{text}").and_then(|()| output.flush()).map_err(Failure::work)?;
    }
    Ok(())
}

/// Does a job, unless it is done already, and writes its row.
fn row_of(job: &BatchJob, networks: &Arc<LoadedNetworks>) -> Result<Row, Failure> {
    if let Some(row) = job.done_row() {
        return Ok(row);
    }
    let started = Instant::now();
    let settings: Settings = serde_json::from_value(job.settings.clone()).map_err(Failure::input)?;
    let summary = execute(&run_of(job, &settings, networks)?)?;
    let score = score_of(job, &settings)?;
    let row = new_row(job, &summary, score, started.elapsed().as_secs_f64());
    let text = serde_json::to_vec(&row).map_err(Failure::work)?;
    write_atomically(Path::new(&job.row), &text).map_err(Failure::work)?;
    Ok(row)
}

/// The run of a job: it goes on with one that was stopped, if that is possible.
fn run_of(job: &BatchJob, settings: &Settings, networks: &Arc<LoadedNetworks>) -> Result<Job, Failure> {
    let (scene, out) = (PathBuf::from(&job.scene), PathBuf::from(&job.out));
    let saved = SavedRun::open(&out).ok().flatten();
    let resume = saved.filter(|saved| settings.run.save_every > 0 && saved.is_of(&scene, settings));
    Ok(Job {
        existing: if resume.is_some() { Existing::Resume } else { Existing::Replace },
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

/// The score of a scene with ground truth.
fn score_of(job: &BatchJob, settings: &Settings) -> Result<Option<VideoScore>, Failure> {
    let scene = open_scene(&job.scene, &settings.dataset).map_err(Failure::input)?;
    if !scene.has_ground_truth() {
        return Ok(None);
    }
    // Frames that could not be used are in the summary, and count as empty.
    let (missing, ids) = (MissingFrames::Allowed, Ids::Lasting);
    let options = EvaluationOptions { score: job.score, missing, ids, video: None, min_score: 0.0 };
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
