//! The command line.

use super::Failure;
use super::bench::BenchArguments;
use super::eval::EvalArguments;
use super::inspect::InspectArguments;
use super::options::{SettingsOptions, choice_name};
use clap::{Args, Parser, Subcommand};
use splatseg::Settings;
use splatseg::settings::MethodName;
use std::path::PathBuf;

/// Gives every object in an RGB-D video one id that lasts for the whole video, by remembering what it saw in an online
/// 3D Gaussian splat.
#[derive(Debug, Parser)]
#[command(name = "splatseg", version, propagate_version = true)]
pub struct Arguments {
    #[command(subcommand)]
    pub command: Command,
}

#[derive(Debug, Subcommand)]
pub enum Command {
    /// Segment a short video that is part of the program: needs no file and no network
    Demo(DemoArguments),
    /// Segment a recorded RGB-D video
    Run(Box<RunArguments>),
    /// Score predictions, of this program or any other, against a scene's ground truth
    Eval(Box<EvalArguments>),
    /// Compare methods: scenes × methods × seeds, with tables and a report
    Bench(Box<BenchArguments>),
    /// Tell what a checkpoint holds: network, tensors, parameters
    Inspect(InspectArguments),
}

#[derive(Debug, Args)]
pub struct DemoArguments {
    /// Folder for the video and the results
    #[arg(long, value_name = "DIR", default_value = "splatseg-demo")]
    pub out: PathBuf,
    /// Replace the results of an earlier demo in that folder
    #[arg(long)]
    pub overwrite: bool,
    /// Use at most this many of the clip's 36 frames
    #[arg(long, value_name = "N")]
    pub frames: Option<usize>,
}

#[derive(Debug, Args)]
#[command(after_long_help = "Later layers win: defaults, --config, the options above, --set.\n\nExamples:\n  \
    splatseg run redkitchen --out out --resize 320x240 --crop-border 5\n  \
    splatseg run scene0011_00 --out out --stride 20 --set memory.max_votes=8\n  \
    splatseg run scene --out out --segmenter masks --masks my_model_output\n  \
    splatseg run synthetic:frames=60,seed=3 --out out")]
pub struct RunArguments {
    /// The scene: a folder or file of any format that --format names, or `synthetic[:frames=60,seed=3,…]`
    pub scene: String,
    /// Folder for the results: segments/*.png, overlay/*.jpg, summary.json
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Replace the results of an earlier run in that folder
    #[arg(long)]
    pub overwrite: bool,
    /// Method [default: fastsam-splat]
    #[arg(long, value_enum, value_name = "METHOD", hide_default_value = true)]
    pub method: Option<MethodName>,
    #[command(flatten)]
    pub options: SettingsOptions,
    /// Save the memory when done: a PLY file that any Gaussian-splat viewer opens
    #[arg(long, value_name = "FILE.ply")]
    pub save_memory: Option<PathBuf>,
    /// Continue with a memory saved earlier, and with its ids
    #[arg(long, value_name = "FILE.ply")]
    pub load_memory: Option<PathBuf>,
}

impl RunArguments {
    /// The settings that file, options and assignments make together.
    pub fn settings(&self) -> Result<Settings, Failure> {
        let method = ("method", self.method.as_ref().and_then(choice_name));
        self.options.layers([method])?.resolve().map_err(Failure::input)
    }
}
