//! The formats, and which of them a path holds.

use crate::synthetic::{self, SyntheticScene};
use crate::{DatasetError, DatasetSettings, Scene};
use crate::{MvpdScene, ReplicaScene, ScannetScene, SensScene, SevenScenesScene, TumScene};
use crate::{mvpd, replica, scannet, sevenscenes, tum};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::path::Path;
use std::str::FromStr;
use std::sync::Arc;
use thiserror::Error;

/// The format of a scene.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Format {
    /// Recognised by the scene's files.
    #[default]
    #[serde(rename = "auto")]
    Auto,
    /// A sequence of 7-Scenes.
    #[serde(rename = "7scenes")]
    SevenScenes,
    /// A ScanNet scene exported to folders.
    #[serde(rename = "scannet")]
    Scannet,
    /// A ScanNet recording in its published container, `<scene>.sens`, or a folder with one.
    #[serde(rename = "sens")]
    Sens,
    /// A sequence of TUM RGB-D.
    #[serde(rename = "tum")]
    Tum,
    /// A Replica scene in the layout of NICE-SLAM.
    #[serde(rename = "replica")]
    Replica,
    /// A video of MVPd, in a split's folder or a scene's `.tar.gz`. Of several videos one is chosen by its name, as
    /// `FOLDER:VIDEO`, `FOLDER/imagesRGB/VIDEO` or `SCENE.tar.gz:VIDEO`.
    #[serde(rename = "mvpd")]
    Mvpd,
    /// The built-in synthetic room.
    #[serde(rename = "synthetic")]
    Synthetic,
}

/// Opens a scene of one format.
type OpenScene = fn(&Path, &DatasetSettings) -> Result<Arc<dyn Scene>, DatasetError>;

/// A format as the recogniser knows it.
struct FormatEntry {
    format: Format,
    name: &'static str,
    layout: &'static str,
    looks_like: fn(&Path) -> bool,
    open: OpenScene,
}

/// Every format, in the order in which they are tried. A new one is a row here and a variant of [`Format`].
const FORMATS: &[FormatEntry] = &[
    FormatEntry {
        format: Format::SevenScenes,
        name: "7scenes",
        layout: sevenscenes::LAYOUT,
        looks_like: sevenscenes::looks_like,
        open: |path, settings| Ok(Arc::new(SevenScenesScene::open(path, settings)?)),
    },
    FormatEntry {
        format: Format::Scannet,
        name: "scannet",
        layout: scannet::LAYOUT,
        looks_like: scannet::looks_like,
        open: |path, _| Ok(Arc::new(ScannetScene::open(path)?)),
    },
    FormatEntry {
        format: Format::Sens,
        name: "sens",
        layout: scannet::SENS_LAYOUT,
        looks_like: scannet::looks_like_sens,
        open: |path, _| Ok(Arc::new(SensScene::open(path)?)),
    },
    FormatEntry {
        format: Format::Tum,
        name: "tum",
        layout: tum::LAYOUT,
        looks_like: tum::looks_like,
        open: |path, _| Ok(Arc::new(TumScene::open(path)?)),
    },
    FormatEntry {
        format: Format::Replica,
        name: "replica",
        layout: replica::LAYOUT,
        looks_like: replica::looks_like,
        open: |path, _| Ok(Arc::new(ReplicaScene::open(path)?)),
    },
    FormatEntry {
        format: Format::Mvpd,
        name: "mvpd",
        layout: mvpd::LAYOUT,
        looks_like: mvpd::looks_like,
        open: |path, _| Ok(Arc::new(MvpdScene::open(path)?)),
    },
    FormatEntry {
        format: Format::Synthetic,
        name: "synthetic",
        layout: synthetic::LAYOUT,
        looks_like: synthetic::looks_like,
        open: |path, _| Ok(Arc::new(SyntheticScene::new(path.to_string_lossy().parse()?)?)),
    },
];

/// Opens the scene at `path`: a folder or file, one video of several as `PATH:VIDEO` (see [`Format::Mvpd`]), or
/// `synthetic` with optional settings (`synthetic:frames=60,seed=3`; a folder of that name is `./synthetic`). Frames
/// are not read yet.
///
/// # Errors
/// Distinguishes a path that does not exist, an empty folder, and one that holds no known format (or not the one in
/// `settings.format`), and says which files were looked for.
pub fn open_scene(path: impl AsRef<Path>, settings: &DatasetSettings) -> Result<Arc<dyn Scene>, DatasetError> {
    let path = path.as_ref();
    settings.validate()?;
    if !synthetic::looks_like(path) && !mvpd::looks_like(path) {
        check_path(path)?;
    }
    if settings.format == Format::Auto {
        let entry = FORMATS.iter().find(|entry| (entry.looks_like)(path)).ok_or_else(|| {
            DatasetError::NotRecognised { path: path.to_owned(), supported: supported_formats().join("\n") }
        })?;
        return (entry.open)(path, settings);
    }
    match FORMATS.iter().find(|entry| entry.format == settings.format) {
        Some(entry) if (entry.looks_like)(path) => (entry.open)(path, settings),
        found => Err(DatasetError::OtherFormat {
            path: path.to_owned(),
            format: found.map_or("auto", |entry| entry.name),
            layout: found.map_or("", |entry| entry.layout),
        }),
    }
}

/// One line for each supported format: its name and what its scenes look like.
pub fn supported_formats() -> Vec<String> {
    FORMATS.iter().map(|entry| format!("  {}: {}", entry.name, entry.layout)).collect()
}

fn check_path(path: &Path) -> Result<(), DatasetError> {
    let io_error = |source: std::io::Error| match source.kind() {
        std::io::ErrorKind::NotFound => DatasetError::NotFound { path: path.to_owned() },
        _ => DatasetError::Io { path: path.to_owned(), source },
    };
    let is_folder = std::fs::metadata(path).map_err(io_error)?.is_dir();
    if is_folder && std::fs::read_dir(path).map_err(io_error)?.next().is_none() {
        return Err(DatasetError::EmptyFolder { path: path.to_owned() });
    }
    Ok(())
}

/// Text that names no format.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[error("format: found {found:?}, expected one of auto, {expected}")]
pub struct FormatNameError {
    /// The text.
    pub found: String,
    /// The names of the formats.
    pub expected: String,
}

impl fmt::Display for Format {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = FORMATS.iter().find(|entry| entry.format == *self).map_or("auto", |entry| entry.name);
        formatter.pad(name)
    }
}

impl FromStr for Format {
    type Err = FormatNameError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        if text == "auto" {
            return Ok(Self::Auto);
        }
        FORMATS.iter().find(|entry| entry.name == text).map(|entry| entry.format).ok_or_else(|| FormatNameError {
            found: text.to_owned(),
            expected: FORMATS.iter().map(|entry| entry.name).collect::<Vec<_>>().join(", "),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_the_same_in_text_and_serde() {
        let all = FORMATS.iter().map(|entry| entry.format).chain([Format::Auto]);
        for format in all {
            assert_eq!(format.to_string().parse(), Ok(format));
            assert_eq!(serde_json::to_string(&format).unwrap(), format!("\"{format}\""));
        }
        let error = "kitti".parse::<Format>().unwrap_err();
        let names = "auto, 7scenes, scannet, sens, tum, replica, mvpd, synthetic";
        assert_eq!(error.to_string(), format!("format: found \"kitti\", expected one of {names}"));
    }
}
