//! The folder for the results of a run for which none was chosen.

use super::input_paths::real_path;
use std::path::{Path, PathBuf};

/// Ends the names of such folders.
const SUFFIX: &str = "-splatseg";
/// Names a folder whose scene has no name.
const NAMELESS: &str = "scene";

/// Returns a folder for the results of a scene that does not exist yet: `NAME-splatseg` in the current folder, or
/// `NAME-splatseg-2` and so on. If the current folder is inside the scene, it is beside the scene. With `resume` it is the
/// last of these folders that exists, if there is one.
pub fn default_out(scene: &Path, resume: bool) -> PathBuf {
    let place = place(scene);
    let name = name(scene) + SUFFIX;
    let numbered = |number: usize| place.join(if number == 1 { name.clone() } else { format!("{name}-{number}") });
    // A broken link exists, too.
    let is_free = |path: &PathBuf| path.symlink_metadata().is_err();
    let free = (1..).find(|number| is_free(&numbered(*number))).unwrap_or(1);
    numbered(if resume { (free - 1).max(1) } else { free })
}

/// The current folder, as a relative path; beside the scene if that contains the current folder.
fn place(scene: &Path) -> PathBuf {
    let (here, scene) = (real_path(Path::new(".")), real_path(scene));
    match scene.parent() {
        Some(parent) if scene.is_dir() && here.starts_with(&scene) => parent.to_owned(),
        _ => PathBuf::new(),
    }
}

/// The name of a scene: that of its folder, of its file without extension, of the video in `ARCHIVE:VIDEO`, or the word
/// before the parameters of a synthetic one.
fn name(scene: &Path) -> String {
    let text = scene.to_string_lossy();
    let name = if scene.exists() {
        let real = real_path(scene);
        let name = if real.is_dir() { real.file_name() } else { real.file_stem() };
        name.map(|name| name.to_string_lossy().into_owned())
    } else {
        let last = match text.split_once(':') {
            Some((kind, _)) if kind == "synthetic" => kind,
            _ => text.rsplit([':', '/', std::path::MAIN_SEPARATOR]).find(|part| !part.is_empty()).unwrap_or_default(),
        };
        Some(last.to_owned())
    };
    name.filter(|name| !name.is_empty()).unwrap_or_else(|| NAMELESS.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folders_are_named_like_the_scene() {
        let folder = tempfile::tempdir().unwrap();
        let recording = folder.path().join("drive.2.mcap");
        std::fs::write(&recording, "").unwrap();
        let named = |scene: &str| name(Path::new(scene));
        assert_eq!(name(&recording), "drive.2");
        assert_eq!(name(&folder.path().join(".")), folder.path().file_name().unwrap().to_str().unwrap());
        assert_eq!(named("synthetic:frames=60,seed=3"), "synthetic");
        assert_eq!(named("MVPd/test:VIDEO"), "VIDEO");
        assert_eq!(named("nowhere/kitchen/"), "kitchen");
        assert_eq!([named("/"), named("")], [NAMELESS, NAMELESS]);
    }
}
