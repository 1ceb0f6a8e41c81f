//! `splatseg inspect`: the contents of a checkpoint.

use super::Failure;
use clap::Args;
use splatseg_models::checkpoint::{Checkpoint, CheckpointError, Dtype, Format};
use splatseg_models::completeness::missing_tensors;
use std::collections::BTreeMap;
use std::path::PathBuf;

#[derive(Debug, Args)]
pub struct InspectArguments {
    /// A checkpoint: .pt of Ultralytics or Meta, or .safetensors
    pub file: PathBuf,
    /// Also write it as a .safetensors file, without a pickle; an existing file is not replaced
    #[arg(long, value_name = "FILE.safetensors")]
    pub convert: Option<PathBuf>,
    /// Also list every tensor with its type and shape
    #[arg(long)]
    pub tensors: bool,
}

/// Prints the contents of the file.
pub fn inspect(arguments: &InspectArguments) -> Result<(), Failure> {
    let checkpoint = Checkpoint::open(&arguments.file).map_err(Failure::input)?;
    print(&checkpoint);
    print_missing(&checkpoint, arguments.tensors);
    if arguments.tensors {
        for tensor in checkpoint.tensors() {
            say!("  {} {} {:?}", tensor.name(), tensor.dtype(), tensor.shape());
        }
    }
    if let Some(out) = &arguments.convert {
        checkpoint.convert(out).map_err(|error| match error {
            // The input was right, but e.g. the disk is full.
            CheckpointError::Io { ref path, .. } if path == out => Failure::work(error),
            error => Failure::input(error),
        })?;
        say!("converted to   {}", out.display());
    }
    Ok(())
}

fn print(checkpoint: &Checkpoint) {
    let container = match checkpoint.format() {
        Format::Torch => "PyTorch zip archive",
        Format::Safetensors => "safetensors",
    };
    let kind = match checkpoint.class() {
        Some(class) => format!("{container}, module {class}"),
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

/// Largest number of missing tensors listed without `--tensors`.
const LISTED: usize = 10;

fn print_missing(checkpoint: &Checkpoint, all: bool) {
    let Some(missing) = missing_tensors(checkpoint) else {
        say!("missing        unknown: splatseg runs FastSAM and SAM 2.1 only");
        return;
    };
    if missing.is_empty() {
        say!("missing        nothing");
        return;
    }
    let listed = if all { missing.len() } else { missing.len().min(LISTED) };
    say!("missing        {} tensors that the network needs", missing.len());
    missing[..listed].iter().for_each(|tensor| say!("  {tensor}"));
    if listed < missing.len() {
        say!("  … and {} more (--tensors lists them)", missing.len() - listed);
    }
}
