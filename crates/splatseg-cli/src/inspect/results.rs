//! `splatseg inspect OUT`: shows what a run has written.

use super::map::is_map;
use super::{InspectArguments, print_json};
use crate::Failure;
use serde::Serialize;
use splatseg::evaluation::RunSummary;
use splatseg_dataset::DatasetError;
use std::path::{Path, PathBuf};

/// The content of `--json`.
#[derive(Serialize)]
struct PrintedResults<'a> {
    file: &'a Path,
    kind: &'static str,
    scene: &'a Path,
    frames: Option<u64>,
    objects: Option<u64>,
    interrupted: bool,
    error: &'a Option<String>,
    /// The page for the browser; null if the run has written none.
    page: Option<PathBuf>,
    /// The maps in the folder.
    maps: Vec<PathBuf>,
}

/// Prints what the run has processed and found, and where to look at it.
pub fn print(arguments: &InspectArguments, run: &RunSummary) -> Result<(), Failure> {
    let folder = &arguments.file;
    let page = Some(folder.join("index.html")).filter(|page| page.is_file());
    let entries =
        std::fs::read_dir(folder).map_err(|error| Failure::input(format!("{}: {error}", folder.display())))?;
    let mut maps: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).filter(|path| is_map(path)).collect();
    maps.sort();
    let RunSummary { scene, frames, objects, interrupted, error, .. } = run;
    if arguments.json {
        return print_json(&PrintedResults {
            file: folder,
            kind: "results",
            scene,
            frames: *frames,
            objects: *objects,
            interrupted: *interrupted,
            error,
            page,
            maps,
        });
    }
    say!("file           {}", folder.display());
    say!("kind           results of a run");
    say!("scene          {}", scene.display());
    let known = |number: &Option<u64>| number.map_or_else(|| "unknown".to_owned(), |number| number.to_string());
    say!("frames         {}", known(frames));
    say!("objects        {}", known(objects));
    if *interrupted {
        say!("interrupted    yes: splatseg run SCENE --out {} --resume goes on", folder.display());
    }
    if let Some(error) = error {
        say!("error          {error}");
    }
    if let Some(page) = page {
        say!("page           {}", page.display());
    }
    for map in maps {
        say!("map            {}", map.display());
    }
    Ok(())
}

/// Why a scene cannot be opened: a folder of results is not a scene, but names one.
pub fn not_opened(path: &Path, error: DatasetError) -> Failure {
    match (&error, RunSummary::of(path)) {
        (DatasetError::NotRecognised { .. }, Ok(Some(run))) => Failure::input(format!(
            "{}: these are the results of a run of {}, and no scene",
            path.display(),
            run.scene.display()
        )),
        _ => Failure::input(error),
    }
}
