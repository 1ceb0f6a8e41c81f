//! The formats, and which of them a path holds.

use crate::synthetic::{self, SyntheticScene};
use crate::{DatasetError, DatasetSettings, Format, Scene};
use crate::{FolderScene, McapScene, MvpdScene, ReplicaScene, ScannetScene, SensScene, SevenScenesScene, TumScene};
use crate::{mcap, mvpd, plain_folder, replica, scannet, sevenscenes, tum};
use splatseg_settings::SettingError;
use std::path::Path;
use std::sync::Arc;

/// Opens a scene of one format.
type OpenScene = fn(&Path, &DatasetSettings) -> Result<Arc<dyn Scene>, DatasetError>;

/// A format as the recogniser knows it.
struct FormatEntry {
    format: Format,
    layout: &'static str,
    /// The parts that a scene needs, and whether each is at a path; none for what is not a folder.
    parts: fn(&Path) -> Vec<(&'static str, bool)>,
    looks_like: fn(&Path) -> bool,
    open: OpenScene,
}

/// Every format, in the order in which they are tried. A new one is a row here and a variant of [`Format`].
const FORMATS: &[FormatEntry] = &[
    FormatEntry {
        format: Format::SevenScenes,
        layout: sevenscenes::LAYOUT,
        parts: sevenscenes::parts,
        looks_like: sevenscenes::looks_like,
        open: |path, settings| Ok(Arc::new(SevenScenesScene::open(path, settings)?)),
    },
    FormatEntry {
        format: Format::Scannet,
        layout: scannet::LAYOUT,
        parts: scannet::parts,
        looks_like: scannet::looks_like,
        open: |path, _| Ok(Arc::new(ScannetScene::open(path)?)),
    },
    FormatEntry {
        format: Format::Sens,
        layout: scannet::SENS_LAYOUT,
        parts: |_| Vec::new(),
        looks_like: scannet::looks_like_sens,
        open: |path, _| Ok(Arc::new(SensScene::open(path)?)),
    },
    FormatEntry {
        format: Format::Tum,
        layout: tum::LAYOUT,
        parts: tum::parts,
        looks_like: tum::looks_like,
        open: |path, _| Ok(Arc::new(TumScene::open(path)?)),
    },
    FormatEntry {
        format: Format::Replica,
        layout: replica::LAYOUT,
        parts: replica::parts,
        looks_like: replica::looks_like,
        open: |path, _| Ok(Arc::new(ReplicaScene::open(path)?)),
    },
    FormatEntry {
        format: Format::Mvpd,
        layout: mvpd::LAYOUT,
        parts: mvpd::parts,
        looks_like: mvpd::looks_like,
        open: |path, _| Ok(Arc::new(MvpdScene::open(path)?)),
    },
    FormatEntry {
        format: Format::Folder,
        layout: plain_folder::LAYOUT,
        parts: plain_folder::parts,
        looks_like: plain_folder::looks_like,
        open: |path, _| Ok(Arc::new(FolderScene::open(path)?)),
    },
    FormatEntry {
        format: Format::Mcap,
        layout: mcap::LAYOUT,
        parts: |_| Vec::new(),
        looks_like: mcap::looks_like,
        open: |path, settings| Ok(Arc::new(McapScene::open(path, settings)?)),
    },
    FormatEntry {
        format: Format::Synthetic,
        layout: synthetic::LAYOUT,
        parts: |_| Vec::new(),
        looks_like: synthetic::looks_like,
        open: |path, _| Ok(Arc::new(SyntheticScene::new(path.to_string_lossy().parse()?)?)),
    },
];

/// Opens the scene at `path`: a folder or file, one video of several as `PATH:VIDEO` (see [`Format::Mvpd`]), or
/// `synthetic` with optional settings (`synthetic:frames=60,seed=3`; a folder of that name is `./synthetic`). Frames
/// are not read yet.
///
/// # Errors
/// Distinguishes a path that does not exist, an empty folder, one that lacks a part of a format, and one that holds no
/// known format (or not the one in `settings.format`), and says which files were looked for.
pub fn open_scene(path: impl AsRef<Path>, settings: &DatasetSettings) -> Result<Arc<dyn Scene>, DatasetError> {
    let path = path.as_ref();
    settings.validate()?;
    if !synthetic::looks_like(path) && !mvpd::looks_like(path) {
        check_path(path)?;
    }
    if settings.format == Format::Auto {
        return match FORMATS.iter().find(|entry| (entry.looks_like)(path)) {
            Some(entry) => open(entry, path, settings),
            None => Err(best_fit(path).unwrap_or_else(|| DatasetError::NotRecognised {
                path: path.to_owned(),
                supported: supported_formats().join("\n"),
            })),
        };
    }
    match FORMATS.iter().find(|entry| entry.format == settings.format) {
        Some(entry) if (entry.looks_like)(path) => open(entry, path, settings),
        found => Err(found.and_then(|entry| incomplete(entry, path)).map_or_else(
            || DatasetError::OtherFormat {
                path: path.to_owned(),
                format: settings.format.name(),
                layout: found.map_or("", |entry| entry.layout),
            },
            |(_, error)| error,
        )),
    }
}

/// What the format lacks of which most is there, if at least half of it is.
fn best_fit(path: &Path) -> Option<DatasetError> {
    let candidates = FORMATS.iter().filter_map(|entry| incomplete(entry, path)).filter(|(there, _)| *there >= 0.5);
    // The first of several that fit equally well.
    candidates.reduce(|best, next| if next.0 > best.0 { next } else { best }).map(|(_, error)| error)
}

/// What part of a format is at a path, 0 to 1, and the error that names the rest; `None` if nothing of it is there.
fn incomplete(entry: &FormatEntry, path: &Path) -> Option<(f64, DatasetError)> {
    let (there, missing): (Vec<_>, Vec<_>) = (entry.parts)(path).into_iter().partition(|(_, is_there)| *is_there);
    if there.is_empty() {
        return None;
    }
    let fraction = there.len() as f64 / (there.len() + missing.len()) as f64;
    let names = |parts: Vec<(&str, bool)>| parts.into_iter().map(|(part, _)| part).collect::<Vec<_>>().join(", ");
    let (format, found, missing) = (entry.format.name(), names(there), names(missing));
    Some((fraction, DatasetError::Incomplete { path: path.to_owned(), format, found, missing }))
}

fn open(entry: &FormatEntry, path: &Path, settings: &DatasetSettings) -> Result<Arc<dyn Scene>, DatasetError> {
    if settings.register_depth && entry.format != Format::SevenScenes {
        return Err(SettingError {
            key: "dataset.register_depth".to_owned(),
            found: "true".to_owned(),
            expected: format!(
                "false for {}, whose format is {}: only 7scenes has depth that is not registered",
                path.display(),
                entry.format
            ),
        }
        .into());
    }
    if let Some((name, found)) = settings.of_recordings().filter(|_| entry.format != Format::Mcap) {
        return Err(SettingError {
            key: format!("dataset.{name}"),
            found: format!("{found:?}"),
            expected: format!("nothing for {}, whose format is {}: only mcap has topics", path.display(), entry.format),
        }
        .into());
    }
    (entry.open)(path, settings)
}

/// One line for each supported format: its name and what its scenes look like.
pub fn supported_formats() -> Vec<String> {
    FORMATS.iter().map(|entry| format!("  {}: {}", entry.format, entry.layout)).collect()
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
