//! Which scenes are done already, and which are to be done.

use super::BatchArguments;
use super::row::Row;
use crate::Settings;
use crate::command::Failure;
use crate::command::input_paths::InputPaths;
use crate::command::output_folder::file_name;
use crate::settings::SettingsLayers;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use splatseg_input::{MemoryLimit, read_file};
use splatseg_metrics::ScoreSettings;
use splatseg_output::write_atomically;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

/// A larger file is not a list of scenes.
const MAX_LIST_BYTES: u64 = 256_000_000;
/// The file in the folder of results that says what they are.
const BATCH: &str = "batch.json";
/// What a run takes without networks at 640×480, bytes, and some more.
const RUN_BYTES: u64 = 500_000_000;
/// What a network takes, relative to its checkpoint: weights and activations.
const BYTES_PER_CHECKPOINT_BYTE: u64 = 4;

/// A batch.
#[derive(Debug, Serialize)]
pub struct Plan {
    /// All scenes, in the order given.
    pub scenes: Vec<BatchJob>,
    /// Those of them that are to be done.
    pub jobs: Vec<BatchJob>,
    /// Processes that work at a time.
    pub workers: usize,
    /// Threads of each.
    pub num_cpus: usize,
    /// What each may take, bytes.
    pub memory: u64,
    /// How often a scene is tried again whose process was killed.
    pub retries: usize,
}

/// A scene of a batch.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct BatchJob {
    /// The scene as it was given.
    pub scene: String,
    /// The folder for its results.
    pub out: String,
    /// The file for its row.
    pub row: String,
    /// The settings of its run.
    pub settings: Value,
    /// How it is scored.
    pub score: ScoreSettings,
}

/// What `batch.json` says.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
struct BatchFile {
    version: String,
    settings: Value,
    score: ScoreSettings,
}

impl Plan {
    /// Looks at what is done, and gets the folder ready.
    ///
    /// # Errors
    /// If the folder has results of something else, or a list of scenes cannot be read.
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
        let (memory, score) = (memory_of(&settings), arguments.score.settings()?);
        let scenes = listed_scenes(&arguments.scenes)?;
        check_paths(arguments, &settings, &scenes)?;
        let settings = serde_json::to_value(&settings).map_err(Failure::work)?;
        prepare_folder(arguments, &settings, score)?;
        let scenes = name_results(&arguments.out, scenes, &settings, score)?;
        let todo: Vec<BatchJob> = scenes.iter().filter(|job| !job.is_done()).cloned().collect();
        let workers = jobs.unwrap_or_else(|| (cores / num_cpus).max(1));
        Ok(Self { scenes, jobs: todo, workers, num_cpus, memory, retries: arguments.retries })
    }
}

impl BatchJob {
    /// Whether its row is there, made with the same program and settings.
    pub fn is_done(&self) -> bool {
        self.done_row().is_some()
    }

    /// Its row, if it is done.
    pub fn done_row(&self) -> Option<Row> {
        let is_same = |row: &Row| {
            (&row.scene, row.version.as_str()) == (&self.scene, env!("CARGO_PKG_VERSION"))
                && (&without_threads(&row.settings), row.score_settings)
                    == (&without_threads(&self.settings), self.score)
        };
        Row::read(Path::new(&self.row)).filter(is_same)
    }
}

/// Settings without those that results do not depend on and that the number of jobs changes.
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
    let options =
        [("method", arguments.method.as_ref()), ("save_every", arguments.save_every.as_ref()), ("page", page.as_ref())];
    let layers = arguments.options.layers_over(SettingsLayers::default(), options)?;
    layers.resolve().map_err(Failure::input)
}

/// What a worker may take, bytes.
fn memory_of(settings: &Settings) -> u64 {
    if let MemoryLimit::Bytes(bytes) = settings.run.memory_limit {
        return bytes;
    }
    let checkpoints = settings.input_files().into_iter().filter(|input| input.is_checkpoint);
    let bytes = |path: &Path| fs::metadata(path).map_or(0, |metadata| metadata.len());
    RUN_BYTES + BYTES_PER_CHECKPOINT_BYTE * checkpoints.map(|input| bytes(input.path)).sum::<u64>()
}

/// The scenes given, with those that text files list.
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
        let list = String::from_utf8(list).map_err(|error| wrong(&error))?;
        scenes.extend(list.lines().map(str::trim).filter(|line| !line.is_empty()).map(str::to_owned));
    }
    if scenes.is_empty() {
        return Err(Failure::input("the lists name no scene"));
    }
    Ok(scenes)
}

/// Checks that nothing is written where a scene, a mask or a checkpoint is read.
fn check_paths(arguments: &BatchArguments, settings: &Settings, scenes: &[String]) -> Result<(), Failure> {
    let mut inputs = InputPaths::of(settings);
    scenes.iter().for_each(|scene| inputs.add_scene(Path::new(scene)));
    inputs.check_output_folder(&arguments.out)
}

/// Makes the folder, or checks that what is there is of such a batch.
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
    let text = serde_json::to_vec_pretty(&file).map_err(Failure::work)?;
    write_atomically(&out.join(BATCH), &text).map_err(Failure::work)
}

/// Gives each scene a folder for its results, named after the scene; scenes of the same name get the name of the folder
/// around them too.
fn name_results(
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
            return Err(Failure::input(format!("{scene} and {other} would both have their results in {name}")));
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

/// The last `depth` parts of a scene's path as one name.
fn short_name(scene: &str, depth: usize) -> String {
    let parts: Vec<&str> = scene.split(['/', '\\']).filter(|part| !part.is_empty() && *part != ".").collect();
    file_name(&parts[parts.len().saturating_sub(depth)..].join("-").replace([':', ','], "_"))
}
