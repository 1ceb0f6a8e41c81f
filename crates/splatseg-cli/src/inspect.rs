//! `splatseg inspect`: shows the contents of a checkpoint, a map, a recording, a scene, the results of a run, or a folder of
//! recordings.

mod folder;
mod map;
mod recording;
pub mod results;
mod scene;

use super::Failure;
use super::options::{CameraOptions, TopicOptions};
use clap::Args;
use serde::Serialize;
use serde_json::{Value, json};
use splatseg::evaluation::RunSummary;
use splatseg_dataset::{DatasetSettings, RecordingScene, open_scene};
use splatseg_models::checkpoint::{Architecture, Checkpoint, CheckpointError, Dtype, Format, printable};
use splatseg_models::clip::ClipNetwork;
use splatseg_models::completeness::missing_tensors;
use splatseg_models::depth_anything::{DepthAnythingNetwork, DepthOutput};
use splatseg_models::device::{DeviceError, HAS_NETWORKS};
use std::collections::BTreeMap;
use std::path::PathBuf;

#[derive(Debug, Args)]
pub struct InspectArguments {
    /// A recording (.mcap, .db3, .bag, .mkv of Azure Kinect, or a folder with one), a scene (a folder or file in any format of
    /// `run`), a folder with several of them, the results of a run, a map (.ply), or a checkpoint (.pt from
    /// Ultralytics or Meta, or .safetensors)
    pub file: PathBuf,
    /// Also write the checkpoint as a .safetensors file, without a pickle; an existing file is not replaced
    #[arg(long, value_name = "FILE.safetensors")]
    pub convert: Option<PathBuf>,
    /// Also list every tensor with its type and shape
    #[arg(long)]
    pub tensors: bool,
    /// Of a map, list all objects, and tentative ones, too
    #[arg(long)]
    pub all: bool,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub camera: CameraOptions,
    #[command(flatten)]
    pub topics: TopicOptions,
}

impl InspectArguments {
    /// Refuses the options for checkpoints; `what` is something else.
    fn refuse_checkpoint_options(&self, what: &str) -> Result<(), Failure> {
        if self.convert.is_none() && !self.tensors {
            return Ok(());
        }
        let message = format!("--convert and --tensors are for checkpoints, this is {what}");
        Err(Failure::input(format!("{}: {message}", self.file.display())))
    }
}

/// Prints a value as JSON.
pub fn print_json(value: &impl Serialize) -> Result<(), Failure> {
    say!("{}", serde_json::to_string_pretty(value).map_err(Failure::runtime)?);
    Ok(())
}

/// Prints the contents of the file.
pub fn inspect(arguments: &InspectArguments) -> Result<(), Failure> {
    // For scores, a run's folder `segments` stands for all of its results.
    if arguments.file.join("segments").is_dir()
        && let Some(run) = RunSummary::of(&arguments.file).map_err(Failure::input)?
    {
        arguments.refuse_checkpoint_options("the results of a run")?;
        return results::print(arguments, &run);
    }
    let members = folder::members(&arguments.file, &arguments.topics.settings(&arguments.camera)?)?;
    if !members.is_empty() {
        arguments.refuse_checkpoint_options("a folder")?;
        return folder::print(arguments, &members);
    }
    if RecordingScene::is_recording(&arguments.file) {
        return recording::inspect(arguments);
    }
    if map::is_map(&arguments.file) {
        arguments.refuse_checkpoint_options("a map")?;
        return map::inspect(arguments);
    }
    if scene::is_scene(&arguments.file) {
        return scene::inspect(arguments);
    }
    let checkpoint = Checkpoint::open(&arguments.file).map_err(|error| not_read(arguments, error))?;
    let complaints = complaints(&checkpoint)?;
    if arguments.json {
        print_json(&described(&checkpoint, &complaints, arguments.tensors))?;
    } else {
        print(&checkpoint);
        print_missing(&checkpoint, arguments.tensors);
        if arguments.tensors {
            for tensor in checkpoint.tensors() {
                say!("  {} {} {:?}", printable(tensor.name()), tensor.dtype(), tensor.shape());
            }
        }
        for (kind, complaint) in &complaints {
            say!("{kind:<14} {complaint}");
        }
    }
    if let Some(out) = &arguments.convert {
        checkpoint.convert(out).map_err(|error| match error {
            // The input was valid, but e.g. the disk is full.
            CheckpointError::Io { ref path, .. } if path == out => Failure::runtime(error),
            error => Failure::input(error),
        })?;
        report!("converted to   {}", out.display());
    }
    match complaints.as_slice() {
        [] => Ok(()),
        complaints => {
            let texts: Vec<&str> = complaints.iter().map(|(_, complaint)| complaint.as_str()).collect();
            Err(Failure::input(format!("{}: {}", arguments.file.display(), texts.join("; "))))
        }
    }
}

/// Returns why a file is not read: as a checkpoint, if it is called one or must be one, otherwise as anything.
fn not_read(arguments: &InspectArguments, error: CheckpointError) -> Failure {
    let ending = arguments.file.extension().map(|ending| ending.to_string_lossy().to_ascii_lowercase());
    let is_called_checkpoint = ending.is_some_and(|ending| CHECKPOINT_ENDINGS.contains(&ending.as_str()));
    if is_called_checkpoint || arguments.convert.is_some() || arguments.tensors {
        return Failure::input(error);
    }
    match open_scene(&arguments.file, &DatasetSettings::default()) {
        Err(other) => Failure::input(other),
        Ok(_) => Failure::input(error),
    }
}

/// Returns reasons not to use the file, each with its kind and text.
fn complaints(checkpoint: &Checkpoint) -> Result<Vec<(&'static str, String)>, Failure> {
    let mut complaints = Vec::new();
    let code = checkpoint.foreign_code();
    if !code.is_empty() {
        let calls = listed(code);
        complaints.push(("unsafe", format!("would {calls}: never executed here, but do not load it elsewhere")));
    }
    let damaged = checkpoint.damaged_entries().map_err(Failure::input)?;
    if !damaged.is_empty() {
        let verb = if damaged.len() == 1 { "is" } else { "are" };
        complaints.push(("damaged", format!("CRC of {} {verb} wrong", listed(&damaged))));
    }
    Ok(complaints)
}

/// Formats the first few names of a list, and the number of the others.
fn listed<T: AsRef<str>>(names: &[T]) -> String {
    let first: Vec<&str> = names.iter().take(LISTED).map(AsRef::as_ref).collect();
    match names.len() - first.len() {
        0 => first.join(", "),
        more => format!("{} and {more} more", first.join(", ")),
    }
}

/// The content of `--json`.
fn described(checkpoint: &Checkpoint, complaints: &[(&str, String)], with_tensors: bool) -> Value {
    let missing = missing_tensors(checkpoint);
    let missing = missing.map(|missing| missing.iter().map(ToString::to_string).collect::<Vec<_>>());
    let mut described = json!({
        "file": checkpoint.path(),
        "kind": "checkpoint",
        "architecture": checkpoint.architecture().to_string(),
        "tensors": checkpoint.tensors().count(),
        "parameters": checkpoint.parameters(),
        // Null if that is not known.
        "missing": missing,
        "problems": complaints.iter().map(|(_, complaint)| complaint).collect::<Vec<_>>(),
    });
    if with_tensors {
        let tensors = checkpoint.tensors();
        let tensor = tensors
            .map(|tensor| json!({"name": tensor.name(), "type": tensor.dtype().to_string(), "shape": tensor.shape()}));
        described["tensor_list"] = tensor.collect();
    }
    described
}

fn print(checkpoint: &Checkpoint) {
    let container = match checkpoint.format() {
        Format::Torch => "PyTorch zip archive",
        Format::Safetensors => "safetensors",
    };
    let kind = match checkpoint.class() {
        Some(class) => format!("{container}, module {}", printable(class)),
        None => format!("{container}, state dict"),
    };
    let mut dtypes: BTreeMap<Dtype, usize> = BTreeMap::new();
    for tensor in checkpoint.tensors() {
        *dtypes.entry(tensor.dtype()).or_default() += 1;
    }
    let dtypes: Vec<String> = dtypes.iter().map(|(dtype, count)| format!("{count} {dtype}")).collect();
    say!("file           {}", checkpoint.path().display());
    say!("kind           {kind}");
    say!("architecture   {}", checkpoint.architecture());
    say!("tensors        {} ({})", checkpoint.tensors().count(), dtypes.join(", "));
    say!("parameters     {}", checkpoint.parameters());
    if let Some(eps) = checkpoint.batch_norm_eps() {
        say!("batch-norm eps {eps}");
    }
}

/// The sizes of a CLIP network, or what is wrong with it.
fn print_clip(checkpoint: &Checkpoint) {
    match ClipNetwork::load(checkpoint) {
        Ok(network) => {
            let config = network.config();
            let (image, text) = (config.image, config.text);
            say!(
                "images         {0} x {0} pixels, {1} blocks of width {2}",
                config.image_size,
                image.blocks,
                image.width
            );
            say!("texts          {} tokens, {} blocks of width {}", config.context, text.blocks, text.width);
            config.assumed.iter().for_each(|assumed| say!("assumed        {assumed}"));
            say!("missing        nothing: --names reads it");
        }
        Err(error) => say!("missing        {error}"),
    }
}

/// The sizes of a Depth Anything network, or what is wrong with it.
fn print_depth_anything(checkpoint: &Checkpoint) {
    match DepthAnythingNetwork::load(checkpoint, None) {
        Ok(network) => {
            let config = network.config();
            say!(
                "encoder        {} blocks of width {}, patches of {} pixels",
                config.encoder.blocks,
                config.encoder.width,
                config.patch
            );
            let output = match config.output {
                DepthOutput::Relative => "inverse depth without a scale".to_owned(),
                DepthOutput::Metric { max_depth } => format!("metres, up to {max_depth}"),
            };
            say!("returns        {output}");
            config.assumed.iter().for_each(|assumed| say!("assumed        {assumed}"));
            say!("missing        nothing: --depth-weights reads it");
        }
        Err(error) => say!("missing        {error}"),
    }
}

/// Endings of the names of checkpoints.
const CHECKPOINT_ENDINGS: [&str; 6] = ["pt", "pth", "ckpt", "bin", "safetensors", "pkl"];
/// Maximum number of names listed without `--tensors`.
const LISTED: usize = 10;

fn print_missing(checkpoint: &Checkpoint, all: bool) {
    if let Architecture::Clip { .. } = checkpoint.architecture() {
        return print_clip(checkpoint);
    }
    if let Architecture::DepthAnything { .. } = checkpoint.architecture() {
        return print_depth_anything(checkpoint);
    }
    let Some(missing) = missing_tensors(checkpoint) else {
        let reason = match checkpoint.architecture() {
            Architecture::Unknown => {
                "splatseg runs FastSAM, SAM 2.1, EdgeTAM, EfficientTAM, CLIP, Perception Encoder and Depth Anything V2 only".to_owned()
            }
            _ if !HAS_NETWORKS => DeviceError::NoNetworks.to_string(),
            _ => "the tensors from which the network's size is read are missing or damaged".to_owned(),
        };
        say!("missing        unknown: {reason}");
        return;
    };
    if missing.is_empty() {
        say!("missing        nothing");
        return;
    }
    let listed = if all { missing.len() } else { missing.len().min(LISTED) };
    say!("missing        {} tensors that the network needs", missing.len());
    // The names may contain text from the file, e.g. from its configuration.
    missing[..listed].iter().for_each(|tensor| say!("  {}", printable(&tensor.to_string())));
    if listed < missing.len() {
        say!("  … and {} more (--tensors lists them)", missing.len() - listed);
    }
}
