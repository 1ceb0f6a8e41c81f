//! A run on disk that `--resume` goes on with.
//!
//! `.splatseg-resume/` in the folder of results has the memory after some frame, `frames.jsonl` with a line for each frame
//! up to then, and `state.json`, which is replaced last and says what belongs together. The frames' images are in the
//! folder of results.

use crate::command::Failure;
use crate::command::manifest::place;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use splatseg::Settings;
use splatseg_atomic_file::write_atomically;
use splatseg_input::read_file;
use splatseg_objects::{ObjectLog, ObjectSighting};
use splatseg_output::FrameRecord;
use splatseg_tracking::TrackErrorCounts;
use std::fs::{self, File, OpenOptions};
use std::io::{BufRead, BufReader, Read, Write};
use std::path::{Path, PathBuf};

/// The folder in the folder of results.
pub const FOLDER: &str = ".splatseg-resume";

const STATE: &str = "state.json";
const FRAMES: &str = "frames.jsonl";
/// Larger files are not ours.
const MAX_STATE_BYTES: u64 = 16_000_000;
const MAX_FRAMES_BYTES: u64 = 1 << 32;
/// Settings that results do not depend on: a run may go on with others.
const FREE_SETTINGS: [&str; 5] = ["memory_limit", "save_every", "segment_ahead", "strict_input", "threads"];

/// How far a run is.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunState {
    /// Version of splatseg.
    pub version: String,
    /// The scene as it was given.
    pub scene: String,
    /// Frames of the scene that are done or skipped.
    pub next: usize,
    /// How many of them have a result.
    pub frames: usize,
    /// How many were skipped.
    pub skipped_frames: usize,
    /// Errors of the tracker so far.
    pub track_errors: TrackErrorCounts,
    /// The settings of the run.
    pub settings: Value,
}

impl RunState {
    /// The state of a run before its first frame.
    pub fn at_the_start(scene: &Path, settings: &Settings) -> Result<Self, Failure> {
        Ok(Self {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            scene: scene.display().to_string(),
            next: 0,
            frames: 0,
            skipped_frames: 0,
            track_errors: TrackErrorCounts::default(),
            settings: serde_json::to_value(settings).map_err(Failure::work)?,
        })
    }

    /// The name of the file with the memory of this state.
    pub fn memory_file(&self) -> String {
        format!("memory-{}.ply", self.next)
    }
}

/// A frame with a result.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SavedFrame {
    /// Its index in the scene.
    pub index: usize,
    /// The name of its result files.
    pub file_name: String,
    /// Its objects.
    pub objects: Vec<ObjectSighting>,
}

/// A run that was stopped.
#[derive(Debug)]
pub struct SavedRun {
    folder: PathBuf,
    /// How far it was.
    pub state: RunState,
    /// Its frames with results.
    pub frames: Vec<SavedFrame>,
}

impl SavedRun {
    /// The file with the settings of the run whose results are in `out`, if one was stopped there.
    pub fn settings_file(out: &Path) -> Option<PathBuf> {
        Some(out.join(FOLDER).join(STATE)).filter(|path| path.is_file())
    }

    /// The run whose results are in `out`, if one was stopped there that can go on.
    ///
    /// # Errors
    /// If what is there is damaged.
    pub fn open(out: &Path) -> Result<Option<Self>, Failure> {
        let Some(path) = Self::settings_file(out) else { return Ok(None) };
        let folder = out.join(FOLDER);
        let wrong = |path: &Path, error: &dyn std::fmt::Display| {
            Failure::input(format!("{}: {error}: start the run again with --overwrite", path.display()))
        };
        let bytes = read_file(&path, MAX_STATE_BYTES).map_err(|error| wrong(&path, &error))?;
        let state: RunState = serde_json::from_slice(&bytes).map_err(|error| wrong(&path, &error))?;
        let path = folder.join(FRAMES);
        let file = splatseg_input::open_file(&path).map_err(|error| wrong(&path, &error))?;
        let mut frames = Vec::new();
        for line in BufReader::new(file.take(MAX_FRAMES_BYTES)).lines().take(state.frames) {
            let line = line.map_err(|error| wrong(&path, &error))?;
            let frame: SavedFrame = serde_json::from_str(&line)
                .map_err(|error| wrong(&path, &format!("line {}: {error}", frames.len() + 1)))?;
            frames.push(frame);
        }
        if frames.len() < state.frames {
            return Err(wrong(&path, &format!("{} lines, expected at least {}", frames.len(), state.frames)));
        }
        Ok(Some(Self { folder, state, frames }))
    }

    /// The file with the memory.
    pub fn memory(&self) -> PathBuf {
        self.folder.join(self.state.memory_file())
    }

    /// The objects so far.
    pub fn objects(&self) -> ObjectLog {
        let mut log = ObjectLog::default();
        self.frames.iter().for_each(|frame| log.repeat(&frame.objects));
        log
    }

    /// Checks that a run of this scene with these settings would have the same results.
    ///
    /// # Errors
    /// Names what differs.
    pub fn check(&self, scene: &Path, settings: &Settings) -> Result<(), Failure> {
        let now = RunState::at_the_start(scene, settings)?;
        let mut changes = Vec::new();
        for (what, before, now) in
            [("the version", &self.state.version, &now.version), ("the scene", &self.state.scene, &now.scene)]
        {
            if before != now {
                changes.push(format!("{what} is {now}, but was {before}"));
            }
        }
        add_changes("", &self.state.settings, &now.settings, &mut changes);
        match changes.first() {
            None => Ok(()),
            Some(change) => Err(Failure::input(format!(
                "{}: the run cannot go on: {change}; start it again with --overwrite",
                self.folder.display()
            ))),
        }
    }
}

/// Lists the settings whose values differ.
fn add_changes(key: &str, before: &Value, now: &Value, changes: &mut Vec<String>) {
    if before == now || FREE_SETTINGS.contains(&key) {
        return;
    }
    let (Value::Object(old), Value::Object(new)) = (before, now) else {
        changes.push(format!("{key} is {now}, but was {before}"));
        return;
    };
    let names: std::collections::BTreeSet<&String> = old.keys().chain(new.keys()).collect();
    for name in names {
        let of = |values: &serde_json::Map<String, Value>| values.get(name).cloned().unwrap_or_default();
        add_changes(&splatseg_settings::full_key(key, name), &of(old), &of(new), changes);
    }
}

/// Saves how far a run is.
#[derive(Debug)]
pub struct StateWriter {
    folder: PathBuf,
    frames: File,
}

impl StateWriter {
    /// Starts to save a run whose results are in `out`, after a state if it goes on from one.
    ///
    /// # Errors
    /// If the folder cannot be written.
    pub fn start(out: &Path, after: Option<&SavedRun>) -> std::io::Result<Self> {
        let folder = out.join(FOLDER);
        let mut lines = String::new();
        match after {
            None => {
                remove(out)?;
                fs::create_dir(&folder)?;
            }
            Some(saved) => {
                for frame in &saved.frames {
                    lines += &serde_json::to_string(frame)?;
                    lines.push('\n');
                }
            }
        }
        let path = folder.join(FRAMES);
        write_atomically(&path, lines.as_bytes())?;
        Ok(Self { folder, frames: OpenOptions::new().append(true).open(path)? })
    }

    /// Adds a frame whose images are in place.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn add_frame(&mut self, index: usize, record: &FrameRecord) -> std::io::Result<()> {
        let frame = SavedFrame { index, file_name: record.file_name.clone(), objects: record.objects.clone() };
        self.frames.write_all(format!("{}\n", serde_json::to_string(&frame)?).as_bytes())
    }

    /// Saves a state, with the memory that `memory` has; that file is moved.
    ///
    /// # Errors
    /// If it cannot be written. The state before stays.
    pub fn save(&mut self, state: &RunState, memory: &Path) -> std::io::Result<()> {
        let name = state.memory_file();
        fs::rename(memory, self.folder.join(&name))?;
        write_atomically(&self.folder.join(STATE), &serde_json::to_vec_pretty(state)?)?;
        for entry in fs::read_dir(&self.folder)? {
            let file = entry?.file_name();
            if file.to_str().is_some_and(|file| is_memory(file) && file != name) {
                fs::remove_file(self.folder.join(file))?;
            }
        }
        Ok(())
    }
}

/// Removes what is saved of the run whose results are in `out`.
///
/// # Errors
/// If it cannot be removed.
pub fn remove(out: &Path) -> std::io::Result<()> {
    let folder = out.join(FOLDER);
    let entries = match fs::read_dir(&folder) {
        Ok(entries) => entries,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(()),
        Err(error) => return Err(error),
    };
    for entry in entries {
        let file = entry?.file_name();
        if file.to_str().is_some_and(|file| file == STATE || file == FRAMES || is_memory(file)) {
            fs::remove_file(folder.join(file))?;
        }
    }
    fs::remove_dir(&folder)
}

/// Whether this is the name of a memory's file.
fn is_memory(file: &str) -> bool {
    let number = file.strip_prefix("memory-").and_then(|rest| rest.strip_suffix(".ply"));
    number.is_some_and(|number| !number.is_empty() && number.bytes().all(|byte| byte.is_ascii_digit()))
}

/// The id image of a frame in the folder of results.
pub fn id_image(out: &Path, file_name: &str) -> PathBuf {
    // Only the name: a damaged list must not lead out of the folder.
    place(out, &format!("segments/{}.png", crate::command::output_folder::file_name(file_name)))
}
