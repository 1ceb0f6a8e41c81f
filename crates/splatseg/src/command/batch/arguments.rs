//! The command line of `splatseg batch`.

use crate::command::options::{ScoreOptions, SettingsOptions};
use clap::Args;
use std::path::PathBuf;

#[derive(Debug, Args)]
#[command(
    after_long_help = "Results are in DIR/<scene>, as `splatseg run` writes them, and DIR has results.parquet (a row per scene), \
    scores.json (the scores over all scenes with ground truth) and failed.csv. A scene is done when DIR/rows has its row: \
    started again, the batch does the others. A scene that cannot be used is listed in failed.csv; the others go on, and \
    the exit code is 1.\n\n\
    Examples:\n  \
    splatseg batch scans/* --out results --jobs 8\n  \
    splatseg batch scenes.txt --out results --segmenter fastsam --weights FastSAM-s.pt\n  \
    splatseg batch scenes.txt --out /shared/results --ray auto"
)]
pub struct BatchArguments {
    /// Scenes, or text files (.txt) with a scene in each line
    #[arg(required = true, value_name = "SCENES")]
    pub scenes: Vec<PathBuf>,
    /// Folder for the results
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Scenes worked on at a time, each by a process of its own [default: one per core, or per --threads cores]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=1024))]
    pub jobs: Option<u64>,
    /// Work on a Ray cluster: its address, or auto for the one that RAY_ADDRESS names or that runs here. DIR must be
    /// reachable by all of its machines. Needs the Python package: pip install 'splatseg[ray]'
    #[arg(long, value_name = "ADDRESS")]
    pub ray: Option<String>,
    /// How often a scene is tried again whose process was killed, e.g. for lack of memory
    #[arg(long, value_name = "N", default_value_t = 2)]
    pub retries: usize,
    /// Replace the results of a batch with other settings in that folder
    #[arg(long)]
    pub overwrite: bool,
    #[arg(long, value_name = "METHOD")]
    pub method: Option<String>,
    #[arg(long, value_name = "N")]
    pub save_every: Option<String>,
    /// Leave out index.html, the page to look at the result
    #[arg(long)]
    pub no_page: bool,
    #[command(flatten)]
    pub score: ScoreOptions,
    #[command(flatten)]
    pub options: SettingsOptions,
    /// Only write the scenes that are to be done to a file, for a program that distributes them
    #[arg(long, hide = true, value_name = "FILE.json")]
    pub plan: Option<PathBuf>,
    /// Only write the tables; the file has the scenes that failed, one JSON object with `scene` and `error` in each line
    #[arg(long, hide = true, value_name = "FILE.jsonl", conflicts_with = "plan")]
    pub collect: Option<PathBuf>,
}
