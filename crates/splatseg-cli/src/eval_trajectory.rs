//! `splatseg eval --trajectory`: compares the poses of a camera with the true ones.

use super::Failure;
use super::eval::EvalArguments;
use super::terminal::counted;
use serde::Serialize;
use splatseg::evaluation::{RunSummary, SceneTrajectory};
use splatseg_annotations::read_trajectory;
use splatseg_dataset::{DatasetError, open_scene};
use splatseg_geometry::StampedPose;
use splatseg_metrics::{ErrorStatistics, TrajectorySettings, score_trajectory};
use splatseg_output::PosesFile;
use std::path::{Path, PathBuf};

/// Content of the `--json` file. Its keys are part of the interface.
#[derive(Debug, Serialize)]
struct TrajectoryEvaluation {
    /// Number of pairs of a true and a predicted pose.
    pairs: usize,
    path_length_m: f64,
    /// The factor by which the predicted path was scaled.
    scale: f64,
    #[serde(skip)]
    corrects_scale: bool,
    ate_m: Option<ErrorStatistics>,
    rpe_frames: usize,
    /// Number of motions that RPE compares.
    rpe_motions: usize,
    rpe_m: Option<ErrorStatistics>,
    rpe_deg: Option<ErrorStatistics>,
    truth: String,
    true_poses: usize,
    predictions: String,
    predicted_poses: usize,
    version: &'static str,
}

/// Executes `splatseg eval --trajectory`.
pub fn eval_trajectory(arguments: &EvalArguments, truth: &Path) -> Result<(), Failure> {
    arguments.memory_limit()?.enforce();
    let pred = &arguments.pred;
    let predicted = read_trajectory(&predicted_file(pred)?).map_err(Failure::input)?;
    let true_poses = true_poses(arguments, truth)?;
    let rpe_frames = arguments.rpe_frames.get();
    let settings =
        TrajectorySettings { rpe_frames, corrects_scale: arguments.correct_scale, ..TrajectorySettings::default() };
    let score = score_trajectory(&true_poses, &predicted, &settings)
        .map_err(|error| Failure::input(format!("{}: {error}", pred.display())))?;
    let evaluation = TrajectoryEvaluation {
        pairs: score.pairs,
        path_length_m: score.path_length_m,
        scale: score.scale,
        corrects_scale: arguments.correct_scale,
        ate_m: score.ate.map(|ate| ate.distance_m),
        rpe_frames,
        rpe_motions: score.rpe.map_or(0, |rpe| rpe.motions),
        rpe_m: score.rpe.map(|rpe| rpe.translation_m),
        rpe_deg: score.rpe.map(|rpe| rpe.rotation_deg),
        truth: truth.display().to_string(),
        true_poses: true_poses.len(),
        predictions: pred.display().to_string(),
        predicted_poses: predicted.len(),
        version: env!("CARGO_PKG_VERSION"),
    };
    if arguments.prints_tables() {
        print(&evaluation);
    }
    arguments.write_json(&evaluation)
}

/// Returns the file with the predicted poses: in the folder of a run, its list of poses.
fn predicted_file(pred: &Path) -> Result<PathBuf, Failure> {
    if !pred.is_dir() {
        return Ok(pred.to_owned());
    }
    let file = pred.join(PosesFile::FILE);
    if file.exists() {
        return Ok(file);
    }
    Err(Failure::input(format!(
        "{}: found no {}, expected the folder of a run that ended, or a file in TUM's format",
        pred.display(),
        PosesFile::FILE
    )))
}

/// Reads the true poses from a scene, as the run that made the predictions read it, or from a file. A file in none of the
/// formats of scenes is a trajectory.
fn true_poses(arguments: &EvalArguments, truth: &Path) -> Result<Vec<StampedPose>, Failure> {
    let run = RunSummary::of(&arguments.pred).map_err(Failure::input)?;
    let base = run.as_ref().map(|run| run.dataset.clone()).unwrap_or_default();
    let dataset = arguments.dataset.over(&base)?;
    let scene = match open_scene(truth, &dataset) {
        Ok(scene) => scene,
        Err(DatasetError::UnknownFile { .. } | DatasetError::OtherFormat { .. }) if truth.is_file() => {
            return read_trajectory(truth).map_err(Failure::input);
        }
        Err(error) => return Err(Failure::input(error)),
    };
    if let (Some(run), false) = (&run, arguments.allow_other_scene) {
        run.check_scene(truth).map_err(Failure::input)?;
    }
    let found = SceneTrajectory::read(scene.as_ref(), &dataset).map_err(Failure::input)?;
    if found.left_out > 0 {
        inform!("{} of the scene without a usable pose, left out", counted(found.left_out, "frame"));
    }
    Ok(found.poses)
}

fn print(found: &TrajectoryEvaluation) {
    say!(
        "{}: {} and {}, {} in {:.2} m of path",
        found.truth,
        counted(found.true_poses, "true pose"),
        counted(found.predicted_poses, "predicted one"),
        counted(found.pairs, "pair"),
        found.path_length_m
    );
    let rpe = format!("RPE over {}", counted(found.rpe_frames, "frame"));
    let rows = [
        ("ATE, cm".to_owned(), found.ate_m, 100.0),
        (format!("{rpe}, cm"), found.rpe_m, 100.0),
        (format!("{rpe}, °"), found.rpe_deg, 1.0),
    ];
    let width = rows.iter().map(|(name, _, _)| name.chars().count()).max().unwrap_or(0);
    say!("{:width$}{:>9}{:>9}{:>9}{:>9}", "", "rmse", "mean", "median", "max");
    for (name, statistics, unit) in rows {
        let cells = statistics.map(|errors| [errors.rmse, errors.mean, errors.median, errors.max]);
        let cell = |index: usize| cells.map_or("-".to_owned(), |cells| format!("{:.2}", unit * cells[index]));
        say!("{name:width$}{:>9}{:>9}{:>9}{:>9}", cell(0), cell(1), cell(2), cell(3));
    }
    if found.corrects_scale {
        let share = found.ate_m.map_or(f64::NAN, |ate| 100.0 * ate.rmse / found.path_length_m);
        say!("the predicted path was scaled by {:.4}; ATE is {share:.2} % of the true one", found.scale);
    }
    if found.ate_m.is_none() {
        say!("no ATE: the positions lie on one line, so that they determine no alignment");
    }
    if found.rpe_m.is_none() {
        say!("no RPE: it needs more than {}", counted(found.rpe_frames, "pair"));
    }
}
