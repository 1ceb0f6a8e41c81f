//! `splatseg inspect FOLDER`: lists the recordings and scenes in a folder.

use super::scene::is_scene;
use super::{InspectArguments, print_json};
use crate::Failure;
use crate::terminal::counted;
use serde::Serialize;
use splatseg_dataset::{DatasetError, DatasetSettings, RecordingScene, Scene, open_scene};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// A recording or scene in a folder.
#[derive(Debug, Serialize)]
pub struct Member {
    /// Its path.
    path: PathBuf,
    /// Its format; `None` if it cannot be used.
    format: Option<&'static str>,
    frames: usize,
    /// Time from the first to the last frame, seconds; `None` without timestamps.
    duration_s: Option<f64>,
    has_poses: bool,
    has_ground_truth: bool,
    /// Why it cannot be used.
    error: Option<String>,
}

/// Returns the recordings and scenes in a folder that is neither itself; empty for all other paths.
pub fn members(folder: &Path, settings: &DatasetSettings) -> Result<Vec<Member>, Failure> {
    if !folder.is_dir() {
        return Ok(Vec::new());
    }
    let unreadable = |error: std::io::Error| Failure::input(format!("{}: {error}", folder.display()));
    let entries = std::fs::read_dir(folder).map_err(unreadable)?;
    let mut paths: Vec<PathBuf> =
        entries.map(|entry| Ok(entry.map_err(unreadable)?.path())).collect::<Result<_, _>>()?;
    paths.sort();
    let is_file = |path: &&PathBuf| path.is_file() && RecordingScene::is_recording(path);
    if paths.iter().filter(is_file).count() == 1 {
        // It is that recording's folder. Opening it would read all of the recording.
        return Ok(Vec::new());
    }
    let opened = open_scene(folder, settings);
    if !matches!(opened, Err(DatasetError::SeveralSequences { .. } | DatasetError::NotRecognised { .. })) {
        return Ok(Vec::new());
    }
    let is_candidate = |path: &PathBuf| RecordingScene::is_recording(path) || is_scene(path);
    Ok(paths.into_iter().filter(is_candidate).filter_map(|path| member(path, settings)).collect())
}

/// Describes a recording or scene; `None` for a folder that is neither.
fn member(path: PathBuf, settings: &DatasetSettings) -> Option<Member> {
    match open_scene(&path, settings) {
        Ok(scene) => Some(Member {
            format: scene.format().map(|format| format.name()),
            frames: scene.frame_count(),
            duration_s: duration(scene.as_ref()),
            has_poses: scene.has_poses(),
            has_ground_truth: scene.has_ground_truth(),
            error: None,
            path,
        }),
        Err(DatasetError::NotRecognised { .. }) => None,
        Err(error) => {
            let error = Some(error.to_string());
            let (format, frames, duration_s) = (None, 0, None);
            Some(Member { path, format, frames, duration_s, has_poses: false, has_ground_truth: false, error })
        }
    }
}

fn duration(scene: &dyn Scene) -> Option<f64> {
    let time = |index| scene.read_recorded(index).ok()?.frame.timestamp();
    let (first, last): (Duration, Duration) = (time(0)?, time(scene.frame_count().checked_sub(1)?)?);
    Some(last.saturating_sub(first).as_secs_f64())
}

/// Prints a line for each recording or scene.
pub fn print(arguments: &InspectArguments, members: &[Member]) -> Result<(), Failure> {
    if arguments.json {
        return print_json(&members);
    }
    say!("file           {}", arguments.file.display());
    say!("kind           folder of {}", counted(members.len(), "recording"));
    let name = |member: &Member| member.path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let width = members.iter().map(|member| name(member).chars().count()).max().unwrap_or(0);
    for member in members {
        let text = match &member.error {
            Some(error) => error.lines().next().unwrap_or_default().to_owned(),
            None => {
                let duration = member.duration_s.map(|seconds| format!(", {seconds:.1} s")).unwrap_or_default();
                let poses = if member.has_poses { "poses" } else { "no poses" };
                let truth = if member.has_ground_truth { ", ground truth" } else { "" };
                let format = member.format.unwrap_or("scene");
                format!("{format:<11} {}{duration}, {poses}{truth}", counted(member.frames, "frame"))
            }
        };
        say!("  {:<width$}  {text}", name(member));
    }
    Ok(())
}
