//! The command line.

use super::Failure;
use clap::{Args, Parser, Subcommand};
use splatseg::settings::{MethodName, SegmenterName, Settings, SettingsLayers};
use splatseg_dataset::Format;
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
    splatseg run scene0011_00 --out out --stride 20 --set memory.feature_dim=14\n  \
    splatseg run scene --out out --segmenter masks --masks my_model_output\n  \
    splatseg run synthetic:frames=60,seed=3 --out out")]
pub struct RunArguments {
    /// Folder of the scene (7-Scenes or exported ScanNet layout), or `synthetic[:frames=60,seed=3,…]`
    pub scene: String,
    /// Folder for the results: segments/*.png, overlay/*.jpg, summary.json
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Replace the results of an earlier run in that folder
    #[arg(long)]
    pub overwrite: bool,
    /// Format of the scene: auto, 7scenes, scannet or synthetic [default: auto]
    #[arg(long, value_name = "FORMAT")]
    pub format: Option<Format>,
    /// Method [default: fastsam-splat]
    #[arg(long, value_enum, value_name = "METHOD", hide_default_value = true)]
    pub method: Option<MethodName>,
    /// Segmenter that the method builds on [default: graph]
    #[arg(long, value_enum, value_name = "SEGMENTER")]
    pub segmenter: Option<SegmenterName>,
    /// Precomputed masks for --segmenter masks: <frame>.png with an id per pixel, or <frame>.json with COCO masks
    #[arg(long, value_name = "DIR")]
    pub masks: Option<PathBuf>,
    /// Use every N-th frame
    #[arg(long, value_name = "N")]
    pub stride: Option<usize>,
    /// Resize frames first, e.g. 320x240
    #[arg(long, value_name = "WxH")]
    pub resize: Option<String>,
    /// Then cut this many pixels off on each side
    #[arg(long, value_name = "PX")]
    pub crop_border: Option<usize>,
    /// Position of the first frame, counted from 0
    #[arg(long, value_name = "N")]
    pub start: Option<usize>,
    /// Use at most this many frames
    #[arg(long, value_name = "N")]
    pub max_frames: Option<usize>,
    /// 7-Scenes as published: warp depth into the colour camera
    #[arg(long)]
    pub register_depth: bool,
    /// Settings from a TOML file
    #[arg(long, value_name = "FILE.toml")]
    pub config: Option<PathBuf>,
    /// Any setting, e.g. memory.feature_dim=14; `summary.json` lists them all
    #[arg(long, value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Seed of everything random [default: 0]
    #[arg(long, value_name = "N")]
    pub seed: Option<u64>,
    /// Threads to compute with; results do not depend on it [default: one per core]
    #[arg(long, value_name = "N")]
    pub threads: Option<usize>,
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
        let mut layers = SettingsLayers::default();
        if let Some(path) = &self.config {
            layers.add_file(path).map_err(Failure::input)?;
        }
        self.add_options(&mut layers)?;
        for assignment in &self.set {
            layers.add_assignment(assignment).map_err(Failure::input)?;
        }
        layers.resolve().map_err(Failure::input)
    }

    fn add_options(&self, layers: &mut SettingsLayers) -> Result<(), Failure> {
        let whole = |number: usize| i64::try_from(number).ok().map(toml::Value::Integer);
        let text = |text: String| Some(toml::Value::String(text));
        let options = [
            ("dataset.format", self.format.and_then(|format| text(format.to_string()))),
            ("method", self.method.as_ref().and_then(choice_name)),
            ("segmenter", self.segmenter.as_ref().and_then(choice_name)),
            ("masks", self.masks.as_ref().and_then(|path| text(path.to_string_lossy().into_owned()))),
            ("dataset.stride", self.stride.and_then(whole)),
            ("dataset.resize", self.resize.clone().and_then(text)),
            ("dataset.crop_border", self.crop_border.and_then(whole)),
            ("dataset.start", self.start.and_then(whole)),
            ("dataset.max_frames", self.max_frames.and_then(whole)),
            ("dataset.register_depth", self.register_depth.then_some(toml::Value::Boolean(true))),
            ("seed", self.seed.and_then(|seed| i64::try_from(seed).ok().map(toml::Value::Integer))),
            ("threads", self.threads.and_then(whole)),
        ];
        for (key, value) in options {
            if let Some(value) = value {
                layers.add(key, value).ok_or_else(|| Failure::input(format!("{key} is no table in the settings")))?;
            }
        }
        Ok(())
    }
}

/// The name of a choice on the command line, which is also its name in settings.
fn choice_name(choice: &impl clap::ValueEnum) -> Option<toml::Value> {
    choice.to_possible_value().map(|value| toml::Value::String(value.get_name().to_owned()))
}
