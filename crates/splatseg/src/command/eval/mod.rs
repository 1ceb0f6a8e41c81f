//! `splatseg eval`: anybody's predictions against a scene's ground truth.

mod annotations;
mod pairing;
mod predictions;

use super::Failure;
use super::options::{DatasetOptions, ScoreOptions};
use super::output_folder::Existing;
use clap::Args;
use pairing::{MissingFrames, SelectedFrames};
use predictions::Predictions;
use serde::Serialize;
use splatseg_dataset::{DatasetSettings, Scene, open_scene, write_atomically};
use splatseg_metrics::{RawCounts, Scores, VideoScore, VideoScorer, Void};
use splatseg_report::{SIZE_COLUMNS_EXPLAINED, terminal_size_table, terminal_table};
use std::path::{Path, PathBuf};

const HELP: &str = "Predictions are one of\n\
    - a folder with <frame>.png for every frame, 8-bit or 16-bit grey, one value per segment, 0 for none;\n\
    - a folder that `splatseg run` wrote; it is read as that run read its scene, unless options say otherwise;\n\
    - a .json file with a list (or an object whose key `annotations` holds it) of\n  \
      tracks, as YouTube-VIS results have them: {\"segmentations\": [RLE or null, one per frame], \"id\": N}, or\n  \
      single masks: {\"frame\": NAME, \"id\": N, \"segmentation\": RLE}.\n  \
      `file_name`, `image`, or `image_id` with a COCO list `images`, may stand for `frame`; `track_id` for `id`; a\n  \
      track without id takes its place in the list. RLE is {\"size\": [height, width], \"counts\": ...}, compressed\n  \
      or not. Masks may overlap. Frames without any mask are listed in a key `frames` (or `images`).\n\n\
    Examples:\n  \
    splatseg eval --gt scene0011_00 --pred out\n  \
    splatseg eval --gt scene0011_00 --stride 20 --resize 320x240 --pred tracks.json --json scores.json";

#[derive(Debug, Args)]
#[command(after_long_help = format!("{HELP}\n\nTable by size: {SIZE_COLUMNS_EXPLAINED}"))]
pub struct EvalArguments {
    /// The scene with its ground truth
    #[arg(long, value_name = "SCENE")]
    pub gt: String,
    /// The predictions
    #[arg(long, value_name = "DIR|FILE.json")]
    pub pred: PathBuf,
    #[command(flatten)]
    pub score: ScoreOptions,
    /// Write the scores as JSON, too
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Replace that file if it exists
    #[arg(long)]
    pub overwrite: bool,
    /// Score frames without prediction as empty ones, and leave out frames without ground truth
    #[arg(long)]
    pub allow_missing: bool,
    /// Ids hold for one frame only: link masks of consecutive frames as the paper does for such methods
    #[arg(long)]
    pub no_ids: bool,
    #[command(flatten)]
    pub dataset: DatasetOptions,
}

/// Whether predicted ids mean the same object in every frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ids {
    /// They do.
    Lasting,
    /// They tell apart the masks of one frame.
    PerFrame,
}

/// What `--json` writes. Its keys are part of the interface.
#[derive(Debug, Serialize)]
struct Evaluation<'a> {
    #[serde(flatten)]
    scores: Scores,
    protocol: &'static str,
    void: Void,
    min_truth_area: f64,
    scene: &'a str,
    predictions: String,
    /// Whether predicted ids last for the whole video.
    ids: bool,
    /// Frames that were scored.
    frames: u64,
    #[serde(flatten)]
    missing: MissingCounts,
    counts: &'a RawCounts,
    version: &'static str,
}

/// Frames that one side lacks.
#[derive(Clone, Copy, Debug, Serialize)]
struct MissingCounts {
    missing_predictions: usize,
    unlabelled_frames: usize,
    unknown_predictions: usize,
}

/// Does what `splatseg eval` asks for.
pub fn eval(arguments: &EvalArguments) -> Result<(), Failure> {
    let settings = arguments.score.settings()?;
    if let Some(path) = &arguments.json
        && path.exists()
        && Existing::from_flag(arguments.overwrite) == Existing::Keep
    {
        return Err(Failure::input(format!("{}: exists: give --overwrite to replace it", path.display())));
    }
    let missing = if arguments.allow_missing { MissingFrames::Allowed } else { MissingFrames::Refused };
    let ids = if arguments.no_ids { Ids::PerFrame } else { Ids::Lasting };
    let dataset = arguments.dataset.over(&dataset_of_run(&arguments.pred)?)?;
    let scene = open_scene(&arguments.gt, &dataset).map_err(Failure::input)?;
    if !scene.has_ground_truth() {
        return Err(Failure::input(format!("{}: the scene has no ground truth", arguments.gt)));
    }
    let frames = SelectedFrames::of(scene.as_ref(), &dataset)?;
    let predictions = Predictions::open(&arguments.pred, &frames)?;
    let mut counts = frames.check(&predictions, missing)?;
    let scoring = Scoring { scene: scene.as_ref(), dataset: &dataset, frames: &frames, predictions: &predictions, ids };
    let (score, unlabelled) = scoring.run(VideoScorer::new(settings), missing)?;
    counts.unlabelled_frames = unlabelled;
    print_scores(arguments, &score, &counts);
    write_json(arguments, &score, counts)
}

fn print_scores(arguments: &EvalArguments, score: &VideoScore, counts: &MissingCounts) {
    let protocol = score.settings().protocol.name();
    say!("{}: {} frames, protocol {protocol}, percent", arguments.gt, score.counts().frames);
    for (count, what) in [
        (counts.missing_predictions, "frames without prediction, scored as empty"),
        (counts.unlabelled_frames, "frames without ground truth, left out"),
        (counts.unknown_predictions, "predictions of frames that the scene does not have, left out"),
    ] {
        if count > 0 {
            say!("{count} {what}");
        }
    }
    let scores = score.scores();
    say!("{}\n\n{}", terminal_table(&scores), terminal_size_table(&scores));
}

fn write_json(arguments: &EvalArguments, score: &VideoScore, missing: MissingCounts) -> Result<(), Failure> {
    let Some(path) = &arguments.json else {
        return Ok(());
    };
    let settings = score.settings();
    let evaluation = Evaluation {
        scores: score.scores(),
        protocol: settings.protocol.name(),
        void: settings.void,
        min_truth_area: settings.min_ground_truth_area,
        scene: &arguments.gt,
        predictions: arguments.pred.display().to_string(),
        ids: !arguments.no_ids,
        frames: score.counts().frames,
        missing,
        counts: score.counts(),
        version: env!("CARGO_PKG_VERSION"),
    };
    let text = serde_json::to_string_pretty(&evaluation).map_err(Failure::work)?;
    write_atomically(path, text.as_bytes()).map_err(Failure::work)
}

/// How a `splatseg run` whose results `path` holds read its scene; the defaults for anybody else's predictions.
fn dataset_of_run(path: &Path) -> Result<DatasetSettings, Failure> {
    let summary = path.join("summary.json");
    if !path.join("segments").is_dir() || !summary.is_file() {
        return Ok(DatasetSettings::default());
    }
    let wrong = |error: &dyn std::fmt::Display| Failure::input(format!("{}: {error}", summary.display()));
    let text = std::fs::read(&summary).map_err(|error| wrong(&error))?;
    let mut summary_value: serde_json::Value = serde_json::from_slice(&text).map_err(|error| wrong(&error))?;
    let settings = summary_value.pointer_mut("/settings/dataset").map(serde_json::Value::take);
    let settings = settings.ok_or_else(|| wrong(&"expected the key settings.dataset"))?;
    serde_json::from_value(settings).map_err(|error| wrong(&error))
}

/// Everything that is scored.
struct Scoring<'a> {
    scene: &'a dyn Scene,
    dataset: &'a DatasetSettings,
    frames: &'a SelectedFrames,
    predictions: &'a Predictions,
    ids: Ids,
}

impl Scoring<'_> {
    /// The video's score, and how many frames have no ground truth.
    fn run(&self, mut scorer: VideoScorer, missing: MissingFrames) -> Result<(VideoScore, usize), Failure> {
        let mut unlabelled = Vec::new();
        for (index, name) in self.frames.selected() {
            let Some(truth) = self.scene.read_ground_truth(*index).map_err(Failure::input)? else {
                unlabelled.push(name.as_str());
                continue;
            };
            let original = truth.size();
            let truth = self.dataset.framing().apply_to_labels(truth).map_err(Failure::input)?;
            let fit = predictions::Fit { framing: self.dataset.framing(), original, framed: truth.size() };
            let prediction = self.predictions.read(name, &fit)?;
            prediction.push_to(&mut scorer, &truth, self.ids).map_err(|error| {
                Failure::input(format!("{}: frame {name}: {error}", self.predictions.path().display()))
            })?;
        }
        if missing == MissingFrames::Refused && !unlabelled.is_empty() {
            return Err(Failure::input(format!(
                "{}; --allow-missing leaves them out",
                pairing::count_and_names(&unlabelled, "without ground truth")
            )));
        }
        if scorer.frames() == 0 {
            return Err(Failure::input("none of the frames has ground truth"));
        }
        Ok((scorer.finish(), unlabelled.len()))
    }
}
