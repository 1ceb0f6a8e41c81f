//! `splatseg man`: the manual pages, for packagers.

use super::Failure;
use super::arguments::complete_command;
use clap::Args;
use std::path::PathBuf;

#[derive(Debug, Args)]
#[command(after_long_help = "Example:\n  splatseg man /usr/local/share/man/man1")]
pub struct ManArguments {
    /// The folder, which gets splatseg.1, splatseg-run.1 and a page for every other command
    #[arg(value_name = "DIR")]
    pub folder: PathBuf,
}

/// Writes the pages; earlier ones are replaced.
pub fn man(arguments: &ManArguments) -> Result<(), Failure> {
    let folder = &arguments.folder;
    let failed = |error: std::io::Error| Failure::runtime(format!("{}: cannot be written: {error}", folder.display()));
    std::fs::create_dir_all(folder).map_err(failed)?;
    clap_mangen::generate_to(complete_command(), folder).map_err(failed)?;
    report!("the manual pages are in {}: man -l {}", folder.display(), folder.join("splatseg.1").display());
    Ok(())
}
