//! `splatseg eval`: scores predictions of any origin against a scene's ground truth.

use super::Failure;
use super::eval_mesh::eval_mesh;
use super::eval_page::ComparedPage;
use super::eval_trajectory::eval_trajectory;
use super::file_kind::FileKind;
use super::options::{DatasetOptions, ScoreOptions, memory_limit};
use super::output_folder::OverwritePolicy;
use super::terminal::counted;
use clap::Args;
use serde::Serialize;
use splatseg::evaluation::{
    EvaluationOptions, Ids, MissingCounts, MissingFrames, RunSummary, ScoredFrame, evaluate_each,
};
use splatseg_dataset::open_scene;
use splatseg_files::MemoryLimit;
use splatseg_metrics::{RawCounts, Scores, VideoScore, Void};
use splatseg_output::write_atomically;
use splatseg_report::{FRAME_COLUMNS_EXPLAINED, SIZE_COLUMNS_EXPLAINED, overcount_note, windows_note};
use splatseg_report::{terminal_frame_table, terminal_size_table, terminal_table};
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

/// The file of `--json` that stands for standard output.
const TO_OUTPUT: &str = "-";

const HELP: &str = "Predictions are one of\n\
    - a folder with <frame>.png for every frame: 8-bit or 16-bit greyscale, one value per segment, 0 for none, or RGB as in \
    COCO's\n  \
      panoptic format, id = R + 256 G + 65536 B; or a folder with such a folder for each video, named like the scene;\n\
    - a folder written by `splatseg run`; the scene is read with that run's settings, unless options override them;\n\
    - a .json file in COCO's panoptic format, one list of annotations or one for each video, with its RGB images beside it;\n\
    - a .json file with a list (or an object with the list under the key `annotations`) of\n  \
      tracks, as in YouTube-VIS results: {\"segmentations\": [RLE or null, one per frame], \"id\": N}, or\n  \
      single masks: {\"frame\": NAME, \"id\": N, \"segmentation\": RLE}.\n  \
      `file_name`, `image`, or `image_id` with a COCO list `images`, may replace `frame`; `track_id` or\n  \
      `instance_id` may replace `id`, which must be that of the object, not of the mask; the id of a track without one\n  \
      is its position in the list. RLE is {\"size\": [height, width], \"counts\": ...}, compressed or not. Masks may overlap.\n  \
      List frames without any mask under the key `frames` (or `images`).\n\n\
    Examples:\n  \
    splatseg eval --pred out --json | jq .vsq\n  \
    splatseg eval --gt scene0011_00 --pred out --page\n  \
    splatseg eval --gt other_out --pred out --page\n  \
    splatseg eval --gt scene0011_00 --stride 20 --resize 320x240 --pred tracks.json --json scores.json\n  \
    splatseg eval --gt MVPd/test:VIDEO --preset mvpd --min-truth-area 0.001 --pred results.json --video 17\n  \
    splatseg eval --mesh scene0011_00_vh_clean_2.ply --instances scene0011_00.txt --void-labels 1,2 --pred map.ply\n  \
    splatseg eval --trajectory scene0011_00 --pred out\n  \
    splatseg eval --trajectory groundtruth.txt --pred poses.txt --rpe-frames 10";

#[derive(Debug, Args)]
#[command(after_long_help = format!("{HELP}\n\nTable by size: {SIZE_COLUMNS_EXPLAINED}\n\nSingle frames: {FRAME_COLUMNS_EXPLAINED}"))]
pub struct EvalArguments {
    /// Scene with ground truth; by default that of the run in --pred. Or the folder of another run of the same scene, whose
    /// ids are then the truth: how far two runs agree
    #[arg(long, value_name = "SCENE", conflicts_with = "mesh")]
    pub gt: Option<PathBuf>,
    /// Predictions, see below; with --mesh a memory saved by `run --save-memory`; with --trajectory the folder of a run or
    /// a file in TUM's format
    #[arg(long, value_name = "DIR|FILE.json|FILE.ply|FILE.txt")]
    pub pred: PathBuf,
    /// Score 3D instances on the vertices of this mesh (binary PLY), as ScanNet's benchmark does but class-agnostic: AP,
    /// AP50 and AP25
    #[arg(long, value_name = "FILE.ply", requires = "instances")]
    pub mesh: Option<PathBuf>,
    /// With --mesh: the true instance of each vertex, label * 1000 + instance in each line, as in ScanNet's benchmark
    #[arg(long, value_name = "FILE.txt", requires = "mesh")]
    pub instances: Option<PathBuf>,
    /// With --mesh: labels without instances, e.g. wall and floor: 1,2 with ScanNet's 40 labels, 1,3 with its 200
    #[arg(long, value_name = "LABEL,…", value_delimiter = ',', requires = "mesh")]
    pub void_labels: Vec<u64>,
    /// Compare camera poses with the true ones: ATE and RPE, as `evo` computes them. A file in TUM's format (a line
    /// `timestamp tx ty tz qx qy qz qw` per pose), or a scene with poses. Frames without timestamps have the time of
    /// their index / 30
    #[arg(long, value_name = "FILE.txt|SCENE", conflicts_with_all = ["gt", "mesh"])]
    pub trajectory: Option<PathBuf>,
    /// With --trajectory: scale the predicted path, too, for cameras without a measured scale
    #[arg(long, requires = "trajectory")]
    pub correct_scale: bool,
    /// With --trajectory: number of poses from start to end of the motions that RPE compares
    #[arg(long, value_name = "N", default_value = "30", requires = "trajectory")]
    pub rpe_frames: NonZeroUsize,
    #[command(flatten)]
    pub score: ScoreOptions,
    /// Show the true ids on the page of the run in --pred: in the place of its own ones or beside them, with the same colour
    /// for the same object
    #[arg(long, conflicts_with_all = ["mesh", "trajectory", "no_ids"])]
    pub page: bool,
    /// Print the scores as JSON instead of tables; with a FILE, write them there and print the tables
    #[arg(long, value_name = "FILE", num_args = 0..=1, default_missing_value = TO_OUTPUT)]
    pub json: Option<PathBuf>,
    /// Replace the JSON file if it has scores
    #[arg(long, requires = "json")]
    pub overwrite: bool,
    /// Score frames without prediction as empty, and leave out frames without ground truth
    #[arg(long)]
    pub allow_missing: bool,
    /// Score predictions whose summary.json names another scene
    #[arg(long)]
    pub allow_other_scene: bool,
    /// Predicted ids are valid in one frame only: link masks of consecutive frames, as the paper does for per-frame methods
    #[arg(long)]
    pub no_ids: bool,
    /// The video's id or name in predictions for several videos; by default the video named like the scene
    #[arg(long, value_name = "ID|NAME", conflicts_with_all = ["mesh", "trajectory"])]
    pub video: Option<String>,
    /// Leave out predictions with a lower score
    #[arg(long, value_name = "SCORE", default_value_t = 0.0, conflicts_with_all = ["mesh", "trajectory"])]
    pub min_score: f64,
    #[command(flatten)]
    pub dataset: DatasetOptions,
    #[arg(long, value_name = "SIZE")]
    pub memory_limit: Option<String>,
}

impl EvalArguments {
    /// Returns the limit for the command's memory.
    pub fn memory_limit(&self) -> Result<MemoryLimit, Failure> {
        memory_limit(self.memory_limit.as_ref())
    }

    /// True if the tables are printed, not JSON.
    pub fn prints_tables(&self) -> bool {
        self.json.as_deref() != Some(Path::new(TO_OUTPUT))
    }

    /// Writes the scores as JSON, if `--json` is given.
    pub fn write_json(&self, scores: &impl Serialize) -> Result<(), Failure> {
        let Some(path) = &self.json else { return Ok(()) };
        let text = serde_json::to_string_pretty(scores).map_err(Failure::runtime)?;
        if !self.prints_tables() {
            say!("{text}");
            return Ok(());
        }
        write_atomically(path, text.as_bytes()).map_err(Failure::runtime)
    }
}

/// Content of the `--json` file. Its keys are part of the interface.
#[derive(Debug, Serialize)]
struct Evaluation<'a> {
    #[serde(flatten)]
    scores: Scores,
    protocol: &'static str,
    void: Void,
    min_truth_area: f64,
    scene: String,
    predictions: String,
    /// True if a predicted id means the same object in every frame.
    ids: bool,
    /// Frames that were scored.
    frames: u64,
    #[serde(flatten)]
    missing: MissingCounts,
    counts: &'a RawCounts,
    version: &'static str,
}

/// Executes `splatseg eval`.
pub fn eval(arguments: &EvalArguments) -> Result<(), Failure> {
    if let Some(path) = arguments.json.as_ref().filter(|_| arguments.prints_tables()) {
        FileKind::SCORES.check(path, OverwritePolicy::from_flag(arguments.overwrite))?;
    }
    if let Some(truth) = &arguments.trajectory {
        return eval_trajectory(arguments, truth);
    }
    match (&arguments.gt, &arguments.mesh, &arguments.instances) {
        (Some(gt), _, _) => eval_video(arguments, gt),
        (None, Some(mesh), Some(instances)) => eval_mesh(arguments, mesh, instances),
        (None, _, _) => match RunSummary::of(&arguments.pred).map_err(Failure::input)? {
            Some(run) => eval_video(arguments, &run.scene),
            None => Err(Failure::input(format!(
                "{}: is not the folder of a run: give the scene with --gt, --trajectory, or --mesh with --instances",
                arguments.pred.display()
            ))),
        },
    }
}

fn eval_video(arguments: &EvalArguments, gt: &Path) -> Result<(), Failure> {
    let settings = arguments.score.settings()?;
    let missing = if arguments.allow_missing { MissingFrames::Allowed } else { MissingFrames::Refused };
    let ids = if arguments.no_ids { Ids::PerFrame } else { Ids::Lasting };
    arguments.memory_limit()?.enforce();
    let run = RunSummary::of(&arguments.pred).map_err(Failure::input)?;
    let mut page = arguments.page.then(|| ComparedPage::open(&arguments.pred, run.is_some())).transpose()?;
    let other = RunSummary::of(gt).map_err(Failure::input)?;
    let scene = other.as_ref().map_or(gt, |other| other.scene.as_path());
    if let (Some(run), false) = (&run, arguments.allow_other_scene) {
        run.check_scene(scene).map_err(Failure::input)?;
    }
    let dataset = arguments.dataset.over(&run.map(|run| run.dataset).unwrap_or_default())?;
    let scene = open_scene(scene, &dataset).map_err(Failure::input)?;
    let (video, min_score) = (arguments.video.clone(), arguments.min_score);
    let truth = other.is_some().then(|| gt.to_owned());
    let options = EvaluationOptions { score: settings, missing, ids, video, min_score, truth };
    let mut each = |frame: &ScoredFrame<'_>| page.iter_mut().for_each(|page| page.add(frame));
    let found =
        evaluate_each(scene.as_ref(), &dataset, &arguments.pred, &options, &mut each).map_err(Failure::input)?;
    if let Some(page) = page {
        let name = if other.is_some() { gt.display().to_string() } else { "ground truth".to_owned() };
        page.write(&name, &found.score)?;
    }
    if arguments.prints_tables() {
        print_scores(gt, &found.score, &found.missing);
    }
    write_json(arguments, gt, &found.score, found.missing)
}

fn print_scores(gt: &Path, score: &VideoScore, counts: &MissingCounts) {
    let protocol = score.settings().protocol.name();
    let frames = counted(score.counts().frames as usize, "frame");
    say!("{}: {frames}, protocol {protocol}, percent", gt.display());
    for (count, thing, what) in [
        (counts.missing_predictions, "frame", "without prediction, scored as empty"),
        (counts.unlabelled_frames, "frame", "without ground truth, left out"),
        (counts.unknown_predictions, "prediction", "of frames that the scene does not have, left out"),
    ] {
        if count > 0 {
            say!("{} {what}", counted(count, thing));
        }
    }
    let scores = score.scores();
    say!("{}", terminal_table(&scores));
    let overcounted = overcount_note(scores.overcounted_tracks);
    for note in overcounted.iter().cloned().chain(windows_note([score])) {
        say!("{note}");
    }
    say!("\n{}", terminal_size_table(&scores));
    say!("\n{}", terminal_frame_table(&scores.single_frames));
    if overcounted.is_some() {
        say_error!("warning: AQ and STQ count some pixels more than once; --protocol strict counts each once");
    }
}

fn write_json(arguments: &EvalArguments, gt: &Path, score: &VideoScore, missing: MissingCounts) -> Result<(), Failure> {
    let settings = score.settings();
    let evaluation = Evaluation {
        scores: score.scores(),
        protocol: settings.protocol.name(),
        void: settings.void,
        min_truth_area: settings.min_ground_truth_area,
        scene: gt.display().to_string(),
        predictions: arguments.pred.display().to_string(),
        ids: !arguments.no_ids,
        frames: score.counts().frames,
        missing,
        counts: score.counts(),
        version: env!("CARGO_PKG_VERSION"),
    };
    arguments.write_json(&evaluation)
}
