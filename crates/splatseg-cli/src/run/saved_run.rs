//! The saved state of a run, for `--resume`.
//!
//! `.splatseg-resume/` in the folder of results contains the memory after some frame, `frames.jsonl` with a line for each
//! frame so far, a similar file and a state file for each output, `shown.jsonl` with what each frame showed (for the final
//! pass), the state of the source of poses (`camera-120.safetensors`, see [`StateBlock`](splatseg_files::StateBlock)), and
//! `state.json`. `state.json` is replaced last and determines the files that belong to the state. Until there is one,
//! `begun.json` has what the run needs to start anew. The frames' images are in the folder of results. Lines are only
//! appended, so that the time of a save does not grow with the run. Lines after the saved state are dropped on resuming.
//!
//! Before `state.json` is replaced, all these files are on the disk. So a power cut loses no more than a kill.

use crate::Failure;
use crate::manifest::{MANIFEST, SUMMARY, place};
use crate::output_folder::{file_name, result_files};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use splatseg::Settings;
use splatseg_files::{read_file, sync_file_system, write_atomically, write_unsynced};
use splatseg_geometry::{KeyframeId, Pose, QuarterTurn, RemappedId, SegmentId};
use splatseg_objects::{ObjectLog, ObjectSighting};
use splatseg_odometry::{PoseEventCounts, PoseState};
use splatseg_output::{FrameRecord, RunOutput};
use splatseg_tracking::TrackErrorCounts;
use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, BTreeSet};
use std::fs::{self, File, OpenOptions};
use std::io::{BufRead, BufReader, Read, Write};
use std::path::{Path, PathBuf};
use std::time::UNIX_EPOCH;

/// Name of the folder inside the folder of results.
pub const FOLDER: &str = ".splatseg-resume";

/// Number of the form of the files. It goes up when a program could not continue what an earlier one has saved.
const FORM: u32 = 2;

const STATE: &str = "state.json";
/// File with what a run that is stopped before its first state needs to start anew.
const BEGUN: &str = "begun.json";
const FRAMES: &str = "frames";
/// Extension of files with a line for each frame.
const LINES: &str = ".jsonl";
/// Largest state file that is read, bytes.
const MAX_STATE_BYTES: u64 = 16_000_000;
/// Largest part of a file of lines that is read, bytes.
const MAX_FRAMES_BYTES: u64 = 1 << 32;
/// Settings that do not affect the results. They may change when a run is resumed.
const FREE_SETTINGS: [&str; 5] = ["memory_limit", "save_every", "segment_ahead", "strict_input", "threads"];

/// The state of a run after some of its frames.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunState {
    /// Version of splatseg.
    pub version: String,
    /// Number of the form of all files; missing in those of earlier programs.
    #[serde(default)]
    pub form: u32,
    /// The scene as given on the command line.
    pub scene: String,
    /// Number of frames of the scene that are done or skipped.
    pub next: usize,
    /// Number of these frames with a result.
    pub frames: usize,
    /// Number of these frames that were skipped.
    pub skipped_frames: usize,
    /// Errors of the tracker so far.
    pub track_errors: TrackErrorCounts,
    /// Events of the source of poses so far.
    pub pose_events: PoseEventCounts,
    /// Doubts about the input so far, a sentence each.
    #[serde(default)]
    pub input_doubts: Vec<String>,
    /// The turn for the segmenter that was told last.
    #[serde(default)]
    pub turn: QuarterTurn,
    /// The largest id in use before the first frame.
    #[serde(default)]
    pub earlier_ids: SegmentId,
    /// The settings of the run.
    pub settings: Value,
    /// The names of the run's outputs.
    pub outputs: Vec<String>,
    /// The map that the run was started with, as given on the command line, and what tells whether the file is still the same.
    #[serde(default)]
    pub loaded_map: Option<LoadedMap>,
    /// The files outside the folder of results as given on the command line, by their options.
    #[serde(default)]
    pub extra_files: BTreeMap<String, String>,
}

/// A map that a run was started with.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LoadedMap {
    /// Path as given on the command line.
    pub path: String,
    /// Size of the file, bytes.
    pub bytes: u64,
    /// Time of its last change, nanoseconds since 1970.
    pub modified: u64,
}

impl LoadedMap {
    /// The file as it is now. `None` if it cannot be read.
    pub fn of(path: &Path) -> Option<Self> {
        let metadata = fs::metadata(path).ok()?;
        let modified = metadata.modified().ok()?.duration_since(UNIX_EPOCH).ok()?;
        let modified = u64::try_from(modified.as_nanos()).ok()?;
        Some(Self { path: path.display().to_string(), bytes: metadata.len(), modified })
    }
}

/// The options that a run records when it begins, for a resume if it is killed before its first saved state.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BegunRun {
    /// The map that it was started with, as given on the command line.
    pub load_memory: Option<String>,
}

impl RunState {
    /// Creates the state of a run before its first frame.
    pub fn initial(scene: &Path, settings: &Settings, outputs: &[Box<dyn RunOutput>]) -> Result<Self, Failure> {
        Ok(Self {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            form: FORM,
            scene: scene.display().to_string(),
            next: 0,
            frames: 0,
            skipped_frames: 0,
            track_errors: TrackErrorCounts::default(),
            pose_events: PoseEventCounts::default(),
            input_doubts: Vec::new(),
            turn: QuarterTurn::default(),
            earlier_ids: 0,
            settings: serde_json::to_value(settings).map_err(Failure::runtime)?,
            outputs: outputs.iter().map(|output| output.name().to_owned()).collect(),
            loaded_map: None,
            extra_files: BTreeMap::new(),
        })
    }

    /// Name of the file with the memory at this state.
    pub fn memory_file(&self) -> String {
        format!("memory-{}.ply", self.next)
    }

    /// Name of the file with the state of the source of poses at this state.
    fn poses_file(&self) -> String {
        format!("camera-{}.safetensors", self.next)
    }

    /// Name of the file with an output's own state at this state.
    fn output_file(&self, name: &str) -> String {
        format!("{name}-{}.json", self.next)
    }
}

/// A frame with a result.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SavedFrame {
    /// Index of the frame in its scene.
    pub index: usize,
    /// Name of the frame's result files, without folder and extension.
    pub file_name: String,
    /// The camera's pose, from the source of poses.
    pub world_from_camera: Pose,
    /// Whether the pose is known.
    pub pose_state: PoseState,
    /// The keyframe to which the pose is attached.
    pub keyframe: KeyframeId,
    /// The keyframe's pose when the frame was processed.
    pub world_from_keyframe: Pose,
    /// The objects in the frame.
    pub objects: Vec<ObjectSighting>,
    /// Ids of earlier frames that turned out to be the same object before this frame.
    pub remapped: Vec<RemappedId>,
}

impl SavedFrame {
    /// The saved form of a frame.
    pub fn new(record: &FrameRecord) -> Self {
        Self {
            index: record.index,
            file_name: record.file_name.clone(),
            world_from_camera: *record.frame.world_from_camera(),
            pose_state: record.pose_state,
            keyframe: record.anchor.keyframe,
            world_from_keyframe: record.anchor.world_from_keyframe,
            objects: record.objects.clone(),
            remapped: record.remapped.clone(),
        }
    }
}

/// A run that was stopped.
#[derive(Debug)]
pub struct SavedRun {
    folder: PathBuf,
    /// The saved state.
    pub state: RunState,
    /// The frames with results.
    pub frames: Vec<SavedFrame>,
}

impl SavedRun {
    /// Returns the file with the settings of the stopped run in `out`, if there is one.
    pub fn settings_file(out: &Path) -> Option<PathBuf> {
        Some(out.join(FOLDER).join(STATE)).filter(|path| path.is_file())
    }

    /// Returns true if `out` has results of a run that was stopped before its first state was saved. It can only start
    /// again.
    pub fn has_only_begun(out: &Path) -> bool {
        let is_saving = out.join(FOLDER).is_dir();
        // A run that ends by itself writes a summary.
        let was_killed = out.join(MANIFEST).is_file() && !out.join(SUMMARY).exists();
        Self::settings_file(out).is_none() && (is_saving || was_killed)
    }

    /// Reads the options of a run in `out` that was stopped before its first saved state; empty if there are none.
    pub fn begun(out: &Path) -> BegunRun {
        let bytes = read_file(&out.join(FOLDER).join(BEGUN), MAX_STATE_BYTES).ok();
        bytes.and_then(|bytes| serde_json::from_slice(&bytes).ok()).unwrap_or_default()
    }

    /// The map that the run was started with, if the file is still the same.
    ///
    /// # Errors
    /// If it is not.
    pub fn loaded_map(&self) -> Result<Option<PathBuf>, Failure> {
        let Some(loaded) = &self.state.loaded_map else { return Ok(None) };
        let path = PathBuf::from(&loaded.path);
        if LoadedMap::of(&path).as_ref() == Some(loaded) {
            return Ok(Some(path));
        }
        Err(Failure::input(format!("{}: is not the file that the run was started with any more", loaded.path)))
    }

    /// The file that the run was started with for an option, such as `--save-memory`.
    pub fn extra_file(&self, option: &str) -> Option<PathBuf> {
        self.state.extra_files.get(option).map(PathBuf::from)
    }

    /// Opens the stopped run in `out`, if there is one that can be resumed.
    ///
    /// # Errors
    /// If its files are damaged.
    pub fn open(out: &Path) -> Result<Option<Self>, Failure> {
        let Some(path) = Self::settings_file(out) else { return Ok(None) };
        let folder = out.join(FOLDER);
        let wrong = |path: &Path, error: &dyn std::fmt::Display| {
            Failure::input(format!("{}: {error}: start the run again with --overwrite", path.display()))
        };
        let bytes = read_file(&path, MAX_STATE_BYTES).map_err(|error| wrong(&path, &error))?;
        let state: RunState = serde_json::from_slice(&bytes).map_err(|error| wrong(&path, &error))?;
        if state.form != FORM {
            return Err(wrong(
                &path,
                &format!("saved by another version of splatseg (form {}, not {FORM})", state.form),
            ));
        }
        let path = folder.join(format!("{FRAMES}{LINES}"));
        let lines = read_lines(&path, state.frames).map_err(|error| wrong(&path, &error))?;
        let frame = |(index, line): (usize, &String)| -> Result<SavedFrame, Failure> {
            serde_json::from_str(line).map_err(|error| wrong(&path, &format!("line {}: {error}", index + 1)))
        };
        let frames = lines.iter().enumerate().map(frame).collect::<Result<_, _>>()?;
        Ok(Some(Self { folder, state, frames }))
    }

    /// Path of the file with the memory.
    pub fn memory(&self) -> PathBuf {
        self.folder.join(self.state.memory_file())
    }

    /// Path of the file with an output's lines, one for each frame.
    pub fn lines_file(&self, name: &str) -> PathBuf {
        self.folder.join(format!("{name}{LINES}"))
    }

    /// Reads an output's lines, one for each frame.
    ///
    /// # Errors
    /// If the file cannot be read or has too few lines.
    pub fn lines(&self, name: &str) -> Result<Vec<String>, String> {
        read_lines(&self.lines_file(name), self.state.frames)
    }

    /// Path of the file with an output's own state. It is missing if the output had failed.
    pub fn output_file(&self, name: &str) -> PathBuf {
        self.folder.join(self.state.output_file(name))
    }

    /// Reads the state of the source of poses, if it was saved.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub fn poses(&self) -> Result<Option<Vec<u8>>, Failure> {
        let path = self.folder.join(self.state.poses_file());
        if !path.exists() {
            return Ok(None);
        }
        read_file(&path, MAX_FRAMES_BYTES).map(Some).map_err(|error| {
            Failure::input(format!("{}: {error}: start the run again with --overwrite", path.display()))
        })
    }

    /// Checks that the images of the frames are still in the folder of results, with overlays or without.
    ///
    /// # Errors
    /// Names the first missing image.
    pub fn require_images(&self, out: &Path, overlays: bool) -> Result<(), Failure> {
        let images_of = |frame: &SavedFrame| result_files(&file_name(&frame.file_name));
        let images =
            self.frames.iter().flat_map(|frame| images_of(frame).into_iter().take(if overlays { 2 } else { 1 }));
        match images.map(|file| place(out, &file)).find(|path| !path.is_file()) {
            None => Ok(()),
            Some(path) => {
                Err(Failure::input(format!("{}: missing: start the run again with --overwrite", path.display())))
            }
        }
    }

    /// Rebuilds the log of objects so far.
    pub fn objects(&self) -> ObjectLog {
        let mut log = ObjectLog::default();
        for frame in &self.frames {
            log.remap(&frame.remapped);
            log.repeat(&frame.objects);
        }
        log
    }

    /// Returns true if a run of this scene with these settings would have the same results.
    pub fn matches(&self, scene: &Path, settings: &Settings) -> bool {
        self.check(scene, settings, &[]).is_ok()
    }

    /// Checks that a run of this scene with these settings and outputs would have the same results.
    ///
    /// # Errors
    /// Names the first difference.
    pub fn check(&self, scene: &Path, settings: &Settings, outputs: &[Box<dyn RunOutput>]) -> Result<(), Failure> {
        let now = RunState::initial(scene, settings, outputs)?;
        let mut changes = Vec::new();
        for (what, before, now) in
            [("the version", &self.state.version, &now.version), ("the scene", &self.state.scene, &now.scene)]
        {
            if before != now {
                changes.push(format!("{what} is {now}, but was {before}"));
            }
        }
        add_changes("", &self.state.settings, &now.settings, &mut changes);
        let new = now.outputs.iter().find(|name| !self.state.outputs.contains(name));
        changes.extend(new.map(|name| format!("it was started without --save-{name}")));
        match changes.first() {
            None => Ok(()),
            Some(change) => Err(Failure::input(format!(
                "{}: the run cannot be resumed: {change}; start it again with --overwrite",
                self.folder.display()
            ))),
        }
    }
}

/// Reads the first `count` lines of a file.
///
/// # Errors
/// If it cannot be read or has fewer lines.
fn read_lines(path: &Path, count: usize) -> Result<Vec<String>, String> {
    let file = splatseg_files::open_file(path).map_err(|error| error.to_string())?;
    let lines = BufReader::new(file.take(MAX_FRAMES_BYTES)).lines().take(count);
    let lines: Vec<String> = lines.collect::<Result<_, _>>().map_err(|error| error.to_string())?;
    if lines.len() < count {
        return Err(format!("{} lines, expected at least {count}", lines.len()));
    }
    Ok(lines)
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
    let names: BTreeSet<&String> = old.keys().chain(new.keys()).collect();
    for name in names {
        let of = |values: &serde_json::Map<String, Value>| values.get(name).cloned().unwrap_or_default();
        add_changes(&splatseg_settings::full_key(key, name), &of(old), &of(new), changes);
    }
}

/// Saves the state of a run.
#[derive(Debug)]
pub struct StateWriter {
    folder: PathBuf,
    /// Files of lines, by name.
    lines: BTreeMap<&'static str, File>,
}

impl StateWriter {
    /// Starts saving a run whose results are in `out`.
    ///
    /// # Errors
    /// If the folder cannot be written.
    pub fn start(out: &Path, begun: &BegunRun) -> std::io::Result<Self> {
        let folder = out.join(FOLDER);
        remove(out)?;
        fs::create_dir(&folder)?;
        write_unsynced(&folder.join(BEGUN), &serde_json::to_vec(begun)?)?;
        Ok(Self { folder, lines: BTreeMap::new() })
    }

    /// Goes on saving a run whose results are in `out`.
    ///
    /// # Errors
    /// If the folder cannot be written.
    pub fn resume(out: &Path, saved: &SavedRun) -> std::io::Result<Self> {
        let folder = out.join(FOLDER);
        for entry in fs::read_dir(&folder)? {
            let path = entry?.path();
            if path.file_name().is_some_and(|file| is_leftover(&file.to_string_lossy())) {
                fs::remove_file(&path)?;
            } else if path.extension().is_some_and(|extension| LINES.ends_with(&*extension.to_string_lossy())) {
                cut_lines(&path, saved.state.frames)?;
            }
        }
        Ok(Self { folder, lines: BTreeMap::new() })
    }

    /// Adds a frame whose images are in place. `outputs` has each output's line for the frame, by name.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn add_frame(&mut self, record: &FrameRecord, outputs: Vec<(&'static str, Vec<u8>)>) -> std::io::Result<()> {
        let frame = (FRAMES, serde_json::to_vec(&SavedFrame::new(record))?);
        for (name, mut line) in std::iter::once(frame).chain(outputs) {
            line.push(b'\n');
            self.open_lines(name)?.write_all(&line)?;
        }
        Ok(())
    }

    /// Returns the file of lines with this name, opened for appending.
    fn open_lines(&mut self, name: &'static str) -> std::io::Result<&mut File> {
        Ok(match self.lines.entry(name) {
            Entry::Occupied(file) => file.into_mut(),
            Entry::Vacant(place) => {
                let path = self.folder.join(format!("{name}{LINES}"));
                place.insert(OpenOptions::new().append(true).create(true).open(path)?)
            }
        })
    }

    /// Saves a state. The file `memory` is moved into the folder. `poses` is the state of the source of poses, and `outputs`
    /// has each output's own state, by name.
    ///
    /// # Errors
    /// If it cannot be written. The earlier state stays.
    pub fn save(
        &mut self,
        state: &RunState,
        memory: &Path,
        poses: Option<&[u8]>,
        outputs: &[(&str, Vec<u8>)],
    ) -> std::io::Result<()> {
        let mut current = BTreeSet::from([state.memory_file()]);
        fs::rename(memory, self.folder.join(state.memory_file()))?;
        if let Some(poses) = poses {
            write_unsynced(&self.folder.join(state.poses_file()), poses)?;
            current.insert(state.poses_file());
        }
        for (name, kept) in outputs {
            write_unsynced(&self.folder.join(state.output_file(name)), kept)?;
            current.insert(state.output_file(name));
        }
        // Everything that the state refers to, with the frames' images.
        sync_file_system(&self.folder)?;
        write_atomically(&self.folder.join(STATE), &serde_json::to_vec_pretty(state)?)?;
        for entry in fs::read_dir(&self.folder)? {
            let file = entry?.file_name();
            if file.to_str().is_some_and(|file| is_state_file(file) && !current.contains(file)) {
                fs::remove_file(self.folder.join(file))?;
            }
        }
        Ok(())
    }
}

/// Truncates a file after its first `count` lines.
///
/// # Errors
/// If it cannot be read or changed.
fn cut_lines(path: &Path, count: usize) -> std::io::Result<()> {
    let mut file = BufReader::new(OpenOptions::new().read(true).write(true).open(path)?);
    let (mut length, mut line) = (0, Vec::new());
    for _ in 0..count {
        line.clear();
        length += file.read_until(b'\n', &mut line)? as u64;
    }
    file.into_inner().set_len(length)
}

/// Removes the saved state of the run whose results are in `out`.
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
        let is_ours = |file: &str| {
            [STATE, BEGUN].contains(&file) || file.ends_with(LINES) || is_state_file(file) || is_leftover(file)
        };
        if file.to_str().is_some_and(is_ours) {
            fs::remove_file(folder.join(file))?;
        }
    }
    fs::remove_dir(&folder)
}

/// Returns true for the name of a file that a killed run has left incomplete.
fn is_leftover(file: &str) -> bool {
    file.starts_with(".writing-")
}

/// Returns true if a file of this name belongs to one state: `memory-120.ply`, `camera-120.safetensors`, `page-120.json`.
fn is_state_file(file: &str) -> bool {
    let stem = [".ply", ".safetensors", ".json"].into_iter().find_map(|extension| file.strip_suffix(extension));
    let number = stem.and_then(|stem| stem.split_once('-')).map(|(_, number)| number);
    number.is_some_and(|number| !number.is_empty() && number.bytes().all(|byte| byte.is_ascii_digit()))
}
