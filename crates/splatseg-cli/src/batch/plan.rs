//! Determines the scenes that are done, and those still to do.

use super::BatchArguments;
use super::row::Row;
use crate::Failure;
use crate::input_paths::InputPaths;
use crate::output_folder::file_name;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use splatseg::settings::SettingsLayers;
use splatseg::{Pipeline, Settings};
use splatseg_files::{MemoryLimit, read_file, text_of};
use splatseg_metrics::ScoreSettings;
use splatseg_output::write_atomically;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

/// Largest list of scenes that is read, bytes.
const MAX_LIST_BYTES: u64 = 256_000_000;
/// Name of the file that describes the batch, in the folder of results.
const BATCH: &str = "batch.json";
/// Memory of a run without networks at 640×480, with a margin, bytes.
const RUN_BYTES: u64 = 500_000_000;
/// Memory of a network's weights and activations, relative to the size of its checkpoint.
const BYTES_PER_CHECKPOINT_BYTE: u64 = 4;

/// A batch.
#[derive(Debug, Serialize)]
pub struct Plan {
    /// All scenes, in the order given.
    pub scenes: Vec<BatchJob>,
    /// The scenes still to do.
    pub jobs: Vec<BatchJob>,
    /// Number of concurrent worker processes.
    pub workers: usize,
    /// Threads per worker.
    pub num_cpus: usize,
    /// Memory per worker, bytes.
    pub memory: u64,
    /// Number of retries for a scene whose process was killed.
    pub retries: usize,
}

/// A scene of a batch.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct BatchJob {
    /// The scene as given on the command line or in a list.
    pub scene: String,
    /// Folder for the scene's results.
    pub out: String,
    /// File for the scene's row.
    pub row: String,
    /// Settings of the run.
    pub settings: Value,
    /// Score settings.
    pub score: ScoreSettings,
}

/// Content of `batch.json`.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
struct BatchFile {
    version: String,
    settings: Value,
    score: ScoreSettings,
}

impl Plan {
    /// Finds the scenes that are done, and prepares the folder.
    ///
    /// # Errors
    /// If the folder contains other results, or a list of scenes cannot be read.
    pub fn of(arguments: &BatchArguments) -> Result<Self, Failure> {
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        let mut settings = settings(arguments)?;
        let jobs = arguments.jobs.map(|jobs| jobs as usize);
        let num_cpus = match (settings.run.threads, jobs) {
            (0, None) => 1,
            (0, Some(jobs)) => (cores / jobs).max(1),
            (threads, _) => threads,
        };
        settings.run.threads = num_cpus;
        let (memory, score) = (worker_memory(&settings), arguments.score.settings()?);
        Pipeline::builder(&settings).check_depth_predictor().map_err(Failure::input)?;
        let scenes = listed_scenes(&arguments.scenes)?;
        check_paths(arguments, &settings, &scenes)?;
        let settings = serde_json::to_value(&settings).map_err(Failure::runtime)?;
        prepare_folder(arguments, &settings, score)?;
        let scenes = assign_folders(&arguments.out, scenes, &settings, score)?;
        let todo: Vec<BatchJob> = scenes.iter().filter(|job| !job.is_done()).cloned().collect();
        let workers = jobs.unwrap_or_else(|| (cores / num_cpus).max(1));
        Ok(Self { scenes, jobs: todo, workers, num_cpus, memory, retries: arguments.retries })
    }
}

impl BatchJob {
    /// Returns true if the scene's row exists, made by the same version with the same settings.
    pub fn is_done(&self) -> bool {
        self.done_row().is_some()
    }

    /// Returns the scene's row, if it is done.
    pub fn done_row(&self) -> Option<Row> {
        let is_same = |row: &Row| {
            (&row.scene, row.version.as_str()) == (&self.scene, env!("CARGO_PKG_VERSION"))
                && (&without_threads(&row.settings), row.score_settings)
                    == (&without_threads(&self.settings), self.score)
        };
        Row::read(Path::new(&self.row)).filter(is_same)
    }
}

/// Returns the settings without `threads` and `memory_limit`, which do not affect results and may depend on the number
/// of jobs.
fn without_threads(settings: &Value) -> Value {
    let mut settings = settings.clone();
    if let Some(settings) = settings.as_object_mut() {
        for key in ["threads", "memory_limit"] {
            settings.remove(key);
        }
    }
    settings
}

fn settings(arguments: &BatchArguments) -> Result<Settings, Failure> {
    let page = arguments.no_page.then(|| "false".to_owned());
    let overlay = arguments.no_overlay.then(|| "false".to_owned());
    let online = arguments.online.then(|| "true".to_owned());
    let options = [
        ("method", arguments.method.as_ref()),
        ("save_every", arguments.save_every.as_ref()),
        ("page", page.as_ref()),
        ("overlay", overlay.as_ref()),
        ("online", online.as_ref()),
    ];
    let layers = arguments.options.layers_over(SettingsLayers::default(), options)?;
    layers.resolve().map_err(Failure::input)
}

/// Returns the memory per worker, bytes.
fn worker_memory(settings: &Settings) -> u64 {
    if let MemoryLimit::Bytes(bytes) = settings.run.memory_limit {
        return bytes;
    }
    let checkpoints = settings.input_files().into_iter().filter(|input| input.is_checkpoint);
    let bytes = |path: &Path| fs::metadata(path).map_or(0, |metadata| metadata.len());
    RUN_BYTES + BYTES_PER_CHECKPOINT_BYTE * checkpoints.map(|input| bytes(input.path)).sum::<u64>()
}

/// Returns the given scenes, with text files replaced by the scenes they list.
fn listed_scenes(given: &[PathBuf]) -> Result<Vec<String>, Failure> {
    let mut scenes = Vec::new();
    for path in given {
        let text = |path: &Path| {
            let not_utf8 = || Failure::input(format!("{}: its name is not UTF-8", path.display()));
            path.to_str().map(str::to_owned).ok_or_else(not_utf8)
        };
        if path.extension().is_none_or(|extension| extension != "txt") {
            scenes.push(text(path)?);
            continue;
        }
        let wrong = |error: &dyn std::fmt::Display| Failure::input(format!("{}: {error}", path.display()));
        let list = read_file(path, MAX_LIST_BYTES).map_err(|error| wrong(&error))?;
        let list = text_of(list).map_err(|error| wrong(&error))?;
        scenes.extend(list.lines().map(str::trim).filter(|line| !line.is_empty()).map(str::to_owned));
    }
    if scenes.is_empty() {
        return Err(Failure::input("the lists contain no scene"));
    }
    Ok(scenes)
}

/// Checks that the output folder is not an input: a scene, masks or a checkpoint.
fn check_paths(arguments: &BatchArguments, settings: &Settings, scenes: &[String]) -> Result<(), Failure> {
    let mut inputs = InputPaths::of(settings);
    scenes.iter().for_each(|scene| inputs.add_scene(Path::new(scene)));
    inputs.check_output_folder(&arguments.out)
}

/// Creates the folder, or checks that it contains results of the same batch.
fn prepare_folder(arguments: &BatchArguments, settings: &Value, score: ScoreSettings) -> Result<(), Failure> {
    let out = &arguments.out;
    let wrong = |error: &dyn std::fmt::Display| Failure::input(format!("{}: {error}", out.display()));
    let file = BatchFile { version: env!("CARGO_PKG_VERSION").to_owned(), settings: without_threads(settings), score };
    let is_empty = fs::read_dir(out).map_or(true, |mut entries| entries.next().is_none());
    let earlier = read_file(&out.join(BATCH), MAX_LIST_BYTES).ok();
    let earlier: Option<BatchFile> = earlier.and_then(|bytes| serde_json::from_slice(&bytes).ok());
    match earlier {
        Some(earlier) if earlier == file || arguments.overwrite => {}
        Some(_) => {
            let other = "has the results of a batch with other settings or of another version";
            return Err(wrong(&format!("{other}: choose another --out, or give --overwrite to replace them")));
        }
        None if !is_empty => {
            return Err(wrong(&format!("is not empty and has no {BATCH}: choose another --out")));
        }
        None => {}
    }
    fs::create_dir_all(out.join("rows")).map_err(|error| wrong(&error))?;
    let text = serde_json::to_vec_pretty(&file).map_err(Failure::runtime)?;
    write_atomically(&out.join(BATCH), &text).map_err(Failure::runtime)
}

/// Assigns each scene a folder for its results, named after the scene. Scenes with the same name are named after their
/// parent folder as well.
fn assign_folders(
    out: &Path,
    scenes: Vec<String>,
    settings: &Value,
    score: ScoreSettings,
) -> Result<Vec<BatchJob>, Failure> {
    let out = out.canonicalize().map_err(|error| Failure::input(format!("{}: {error}", out.display())))?;
    let names = |depth: usize| -> Vec<String> { scenes.iter().map(|scene| short_name(scene, depth)).collect() };
    let mut counts: BTreeMap<String, usize> = BTreeMap::new();
    names(1).into_iter().for_each(|name| *counts.entry(name).or_default() += 1);
    let is_single = |name: &String| counts.get(name) == Some(&1);
    let chosen = names(1).into_iter().zip(names(2)).map(|(short, long)| if is_single(&short) { short } else { long });
    let mut taken: BTreeMap<String, String> = BTreeMap::new();
    let job = |(scene, name): (String, String)| {
        if let Some(other) = taken.insert(name.clone(), scene.clone()) {
            return Err(Failure::input(format!("{scene} and {other} would both write their results to {name}")));
        }
        let text = |path: PathBuf| {
            path.to_str().map(str::to_owned).ok_or_else(|| Failure::input("--out: its name is not UTF-8"))
        };
        let (row, settings) = (text(out.join("rows").join(format!("{name}.json")))?, settings.clone());
        Ok(BatchJob { scene, out: text(out.join("scenes").join(&name))?, row, settings, score })
    };
    let chosen: Vec<String> = chosen.collect();
    scenes.into_iter().zip(chosen).map(job).collect()
}

/// Joins the last `depth` parts of a scene's path into a name.
fn short_name(scene: &str, depth: usize) -> String {
    let parts: Vec<&str> = scene.split(['/', '\\']).filter(|part| !part.is_empty() && *part != ".").collect();
    file_name(&parts[parts.len().saturating_sub(depth)..].join("-").replace([':', ','], "_"))
}
