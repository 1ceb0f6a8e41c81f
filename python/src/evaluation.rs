//! Scores, computed as by `splatseg eval`.

use crate::errors::{runtime_error, value_error};
use crate::settings::{layers, settings_error};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use splatseg::dataset::{DatasetSettings, open_scene};
use splatseg::evaluation::{Evaluation, EvaluationOptions, Ids, MissingFrames, RunSummary};
use splatseg::metrics::{Protocol, ScoreSettings, Void};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{RecvTimeoutError, sync_channel};
use std::time::Duration;

/// Interval between checks for an interrupt.
const POLL: Duration = Duration::from_millis(100);

/// The scores of predictions, as JSON.
#[pyfunction]
#[pyo3(signature = (gt, predictions, settings, protocol, exclude_void, min_truth_area, allow_missing, ids))]
#[allow(clippy::too_many_arguments, reason = "the options of `splatseg eval`")]
pub fn evaluate(
    py: Python<'_>,
    gt: PathBuf,
    predictions: PathBuf,
    settings: &Bound<'_, PyDict>,
    protocol: &str,
    exclude_void: bool,
    min_truth_area: f64,
    allow_missing: bool,
    ids: bool,
) -> PyResult<String> {
    let protocol = [Protocol::Paper, Protocol::Strict]
        .into_iter()
        .find(|known| known.name() == protocol)
        .ok_or_else(|| value_error(format!("protocol is {protocol:?}, expected \"paper\" or \"strict\"")))?;
    if !(0.0..1.0).contains(&min_truth_area) {
        return Err(value_error(format!("min_truth_area is {min_truth_area}, expected a fraction from 0 to 1")));
    }
    let void = if exclude_void { Void::Excluded } else { Void::Counted };
    let options = EvaluationOptions {
        score: ScoreSettings { protocol, void, min_ground_truth_area: min_truth_area },
        missing: if allow_missing { MissingFrames::Allowed } else { MissingFrames::Refused },
        ids: if ids { Ids::Lasting } else { Ids::PerFrame },
        video: None,
        min_score: 0.0,
        truth: None,
    };
    // The scene is read with the run's settings, except those given here.
    let run = RunSummary::of(&predictions).map_err(value_error)?;
    let base = run.map(|run| run.dataset).unwrap_or_default();
    let dataset = layers(settings, Some("dataset"))?.over_dataset(&base).map_err(settings_error)?;
    // After Ctrl-C, nothing waits for this thread; it runs to its end.
    let (sender, mut receiver) = sync_channel(1);
    let work = move || drop(sender.send(scored(&gt, &dataset, &predictions, &options)));
    std::thread::Builder::new().name("splatseg-eval".to_owned()).spawn(work).map_err(runtime_error)?;
    loop {
        let waiting = &mut receiver;
        match py.detach(move || waiting.recv_timeout(POLL)) {
            Ok(Ok(evaluation)) => return json(&evaluation),
            Ok(Err(error)) => return Err(value_error(error)),
            Err(RecvTimeoutError::Timeout) => py.check_signals()?,
            Err(RecvTimeoutError::Disconnected) => return Err(runtime_error("the scores could not be computed")),
        }
    }
}

fn scored(
    gt: &Path,
    dataset: &DatasetSettings,
    predictions: &Path,
    options: &EvaluationOptions,
) -> Result<Evaluation, String> {
    let scene = open_scene(gt, dataset).map_err(|error| error.to_string())?;
    splatseg::evaluation::evaluate(scene.as_ref(), dataset, predictions, options).map_err(|error| error.to_string())
}

fn json(evaluation: &Evaluation) -> PyResult<String> {
    let mut scores = serde_json::to_value(evaluation.score.scores()).map_err(runtime_error)?;
    scores["frames"] = evaluation.score.counts().frames.into();
    scores["missing"] = serde_json::to_value(evaluation.missing).map_err(runtime_error)?;
    Ok(scores.to_string())
}
