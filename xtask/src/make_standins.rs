//! Stand-ins for the paper's data sets, to try `splatseg bench --preset paper` without them.

use crate::standins::write_standins;
use anyhow::{Result, anyhow, ensure};
use splatseg_dataset::{DatasetSettings, Scene, open_scene};
use std::path::PathBuf;

/// Write miniature stand-ins for ScanNet and MVPd, in their layouts, from scenes with ground truth
///
/// `splatseg bench --preset paper --stride 1 --scannet DIR/ScanNet --instances DIR/instances --mvpd DIR/MVPd ...` reads them.
#[derive(clap::Args)]
pub struct Arguments {
    /// Scenes with ground truth and frames of 320x240 or so
    #[arg(required = true)]
    scenes: Vec<PathBuf>,
    /// Frames of each scene
    #[arg(long, value_name = "N", default_value_t = 20, value_parser = clap::value_parser!(u16).range(1..))]
    frames: u16,
    /// A new folder
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    ensure!(!arguments.out.exists(), "{}: exists", arguments.out.display());
    let settings = DatasetSettings::default();
    let scenes = arguments.scenes.iter().map(|path| Ok(open_scene(path, &settings)?)).collect::<Result<Vec<_>>>()?;
    let scenes: Vec<&dyn Scene> = scenes.iter().map(AsRef::as_ref).collect();
    write_standins(&scenes, usize::from(arguments.frames), &arguments.out).map_err(|error| anyhow!("{error}"))
}
