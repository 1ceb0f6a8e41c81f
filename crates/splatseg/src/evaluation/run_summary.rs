//! Reads the scene, the dataset settings and the outcome from the `summary.json` of a run.

use super::EvaluationError;
use crate::relative_paths::resolved;
use crate::settings::SettingsLayers;
use crate::summary::RELATIVE_PATHS;
use serde_json::Value;
use splatseg_annotations::AnnotationError;
use splatseg_dataset::{DatasetSettings, SyntheticSettings};
use splatseg_files::read_file;
use std::path::{Path, PathBuf};

/// Largest summary that is read, bytes.
const MAX_BYTES: u64 = 16_000_000;

/// The summary of the run that wrote the predictions.
#[derive(Debug)]
pub struct RunSummary {
    path: PathBuf,
    /// The scene.
    pub scene: PathBuf,
    /// Dataset settings of the run.
    pub dataset: DatasetSettings,
    /// Frames with a result, if the summary has their number.
    pub frames: Option<u64>,
    /// Objects that count, if the summary has their number.
    pub objects: Option<u64>,
    /// True if a signal stopped the run before the last frame.
    pub interrupted: bool,
    /// The error that ended the run before the last frame, and errors writing results.
    pub error: Option<String>,
}

impl RunSummary {
    /// Reads the summary in the folder of a run, or beside its folder `segments`. Returns `None` for other predictions.
    ///
    /// # Errors
    /// If the file exists but is not the summary of a run.
    pub fn of(predictions: &Path) -> Result<Option<Self>, EvaluationError> {
        let is_segments = predictions.file_name().is_some_and(|name| name == "segments");
        let folder = match predictions.parent() {
            Some(parent) if is_segments => parent,
            _ => predictions,
        };
        let path = folder.join("summary.json");
        if !folder.join("segments").is_dir() || !path.exists() {
            return Ok(None);
        }
        let wrong = |error: &dyn std::fmt::Display| EvaluationError::from(AnnotationError::at(&path, error));
        let bytes = read_file(&path, MAX_BYTES).map_err(|error| wrong(&error))?;
        let summary: Value = serde_json::from_slice(&bytes).map_err(|error| wrong(&error))?;
        let missing = |key: &str| wrong(&format!("expected the key {key}"));
        let scene = summary.get("scene").and_then(Value::as_str).ok_or_else(|| missing("scene"))?;
        let is_relative = summary.get("paths").and_then(Value::as_str) == Some(RELATIVE_PATHS);
        let scene = if is_relative { resolved(folder, Path::new(scene)) } else { PathBuf::from(scene) };
        if summary.pointer("/settings/dataset").is_none() {
            return Err(missing("settings.dataset"));
        }
        let mut layers = SettingsLayers::default();
        layers.add_file(&path)?;
        let dataset = layers.resolve_shared()?.dataset;
        let number = |key: &str| summary.get(key).and_then(Value::as_u64);
        let (frames, objects) = (number("frames"), number("objects"));
        let interrupted = summary.get("interrupted").and_then(Value::as_bool).unwrap_or(false);
        let error = summary.get("error").and_then(Value::as_str).map(str::to_owned);
        Ok(Some(Self { path, scene, dataset, frames, objects, interrupted, error }))
    }

    /// Checks that the predictions are of this scene.
    ///
    /// # Errors
    /// If the names of the scenes differ.
    pub fn check_scene(&self, scene: &Path) -> Result<(), EvaluationError> {
        if is_same_scene(&self.scene, scene) {
            return Ok(());
        }
        let problem = format!(
            "the predictions are of the scene {}, not of {}; if these are the same scene, give --allow-other-scene",
            self.scene.display(),
            scene.display()
        );
        Err(AnnotationError::at(&self.path, problem).into())
    }
}

/// Returns true if the names of two scenes match. Only the last parts of the paths are compared, as scenes may have been
/// moved.
fn is_same_scene(one: &Path, other: &Path) -> bool {
    let synthetic = |scene: &Path| scene.to_str().and_then(|scene| scene.parse::<SyntheticSettings>().ok());
    if let (Some(one), Some(other)) = (synthetic(one), synthetic(other)) {
        return one == other;
    }
    let full = |scene: &Path| scene.canonicalize().ok();
    // A summary stores the scene as text.
    if one == other
        || one.to_string_lossy() == other.to_string_lossy()
        || full(one).zip(full(other)).is_some_and(|(one, other)| one == other)
    {
        return true;
    }
    name(one) == name(other)
}

/// Name of a scene without `.sens`. For a sequence such as `seq-01` in 7-Scenes, followed by the name of its folder.
fn name(scene: &Path) -> Vec<String> {
    let path = scene.canonicalize().unwrap_or_else(|_| scene.to_owned());
    let mut parts = path.iter().rev().map(|part| part.to_string_lossy().into_owned());
    let last = parts.next().unwrap_or_default();
    let last = last.strip_suffix(".sens").unwrap_or(&last).to_owned();
    let folder = if last.starts_with("seq-") { parts.next() } else { None };
    std::iter::once(last).chain(folder).collect()
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    fn is_same_scene(one: &str, other: &str) -> bool {
        super::is_same_scene(Path::new(one), Path::new(other))
    }

    #[test]
    fn scenes_are_the_same_by_name_wherever_they_are() {
        for (one, other) in [
            ("rooms/dev-a", "/data/rooms/dev-a/"),
            ("scans/scene0011_00", "/x/scene0011_00/scene0011_00.sens"),
            ("chess/seq-01", "/data/chess/seq-01"),
            ("synthetic:frames=18", "synthetic:frames=18,seed=0"),
        ] {
            assert!(is_same_scene(one, other), "{one} {other}");
        }
        for (one, other) in [
            ("rooms/dev-a", "rooms/dev-b"),
            ("chess/seq-01", "fire/seq-01"),
            ("synthetic:frames=18", "synthetic:frames=18,seed=1"),
            ("synthetic", "rooms/dev-b"),
        ] {
            assert!(!is_same_scene(one, other), "{one} {other}");
        }
    }
}
