//! The command line of `splatseg batch`.

use crate::options::{ScoreOptions, SettingsOptions};
use clap::Args;
use std::path::PathBuf;

#[derive(Debug, Args)]
#[command(
    after_long_help = "DIR/scenes/<scene> contains the results of a scene, as written by `splatseg run`. DIR contains \
    results.parquet (a row per scene), scores.json (the scores over all scenes with ground truth) and failed.csv. A scene \
    is done when its row is in DIR/rows: started again, the batch skips it. A scene that cannot be used is listed in \
    failed.csv; the batch continues with the others, and the exit code is 1.\n\n\
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
    /// Number of scenes processed at a time, each in its own process [default: one per core, or per --threads cores]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=1024))]
    pub jobs: Option<u64>,
    /// Run on a Ray cluster: its address, or auto for the cluster in RAY_ADDRESS or on this machine. DIR must be
    /// reachable from all of its machines. Needs the Python package and Ray: pip install ./python 'ray[data]'
    #[arg(long, value_name = "ADDRESS")]
    pub ray: Option<String>,
    /// Number of times to retry a scene whose process was killed, e.g. for lack of memory
    #[arg(long, value_name = "N", default_value_t = 2)]
    pub retries: usize,
    /// Replace the results of a batch with other settings in that folder
    #[arg(long)]
    pub overwrite: bool,
    #[arg(long, value_name = "METHOD")]
    pub method: Option<String>,
    #[arg(long, value_name = "N")]
    pub save_every: Option<String>,
    /// Do not write index.html, the page that shows the results
    #[arg(long)]
    pub no_page: bool,
    /// Do not write overlay/*.jpg, the frames with their objects drawn over them
    #[arg(long)]
    pub no_overlay: bool,
    /// Leave out the final pass, in which the map of the end decides the ids of all frames again: the results, and their
    /// scores, are what was known at the time of each frame, as in the paper
    #[arg(long)]
    pub online: bool,
    #[command(flatten)]
    pub score: ScoreOptions,
    #[command(flatten)]
    pub options: SettingsOptions,
    /// Only write a file with the scenes still to do, for a program that distributes them
    #[arg(long, hide = true, value_name = "FILE.json")]
    pub plan: Option<PathBuf>,
    /// Only write the tables; the file lists the failed scenes, one JSON object with `scene` and `error` per line
    #[arg(long, hide = true, value_name = "FILE.jsonl", conflicts_with = "plan")]
    pub collect: Option<PathBuf>,
}
