//! The table of how each format is opened, and detection of a path's format. A new format is added here, and its name in
//! `format_names.rs`.

use crate::depth_scale::require_no_depth_scale;
use crate::pose_convention::ConvertedPoses;
use crate::recording::{self, Container, RecordingScene};
use crate::synthetic;
use crate::unread_files::file_error;
use crate::{DatasetError, DatasetSettings, DepthRegistration, Format, Scene};
use crate::{FolderScene, MvpdScene, ReplicaScene, ScannetScene, SensScene, SevenScenesScene, TumScene};
use crate::{
    arkitscenes, mvpd, nerfstudio, plain_folder, polycam, r3d, replica, scannet, sevenscenes, stray, tum, video,
};
use splatseg_settings::SettingError;
use std::path::Path;
use std::sync::Arc;

/// The files that are scenes, for messages.
pub(crate) const FILES: &str =
    ".mcap, .db3, .bag, .mkv of Azure Kinect, .r3d (a zip file), .sens, .tar.gz of MVPd, transforms.json with depth";

/// Function that opens a scene of one format.
type OpenScene = fn(&Path, &DatasetSettings) -> Result<Arc<dyn Scene>, DatasetError>;

/// A row of the format table.
struct FormatEntry {
    format: Format,
    layout: &'static str,
    /// Required parts of a scene, each with true if the path has it. Empty for formats that are not folders.
    parts: fn(&Path) -> Vec<(&'static str, bool)>,
    /// Returns true if a path has all required parts.
    looks_like: fn(&Path) -> bool,
    /// Returns true if a path has the optional parts that distinguish the format, too: poses and the camera's file.
    is_whole: fn(&Path) -> bool,
    open: OpenScene,
}

/// All formats, in the order in which they are tried. To add one, add a row here and a variant of [`Format`] in
/// `format_names.rs`.
const FORMATS: &[FormatEntry] = &[
    FormatEntry {
        format: Format::SevenScenes,
        layout: sevenscenes::LAYOUT,
        parts: sevenscenes::parts,
        looks_like: sevenscenes::looks_like,
        is_whole: sevenscenes::is_whole,
        open: |path, settings| Ok(Arc::new(SevenScenesScene::open(path, settings)?)),
    },
    FormatEntry {
        format: Format::Scannet,
        layout: scannet::LAYOUT,
        parts: scannet::parts,
        looks_like: scannet::looks_like,
        is_whole: scannet::is_whole,
        open: |path, settings| Ok(Arc::new(ScannetScene::open(path, settings)?)),
    },
    FormatEntry {
        format: Format::Sens,
        layout: scannet::SENS_LAYOUT,
        parts: |_| Vec::new(),
        looks_like: scannet::looks_like_sens,
        is_whole: |_| true,
        open: |path, settings| Ok(Arc::new(SensScene::open(path, settings)?)),
    },
    FormatEntry {
        format: Format::Tum,
        layout: tum::LAYOUT,
        parts: tum::parts,
        looks_like: tum::looks_like,
        is_whole: tum::is_whole,
        open: |path, settings| Ok(Arc::new(TumScene::open(path, settings)?)),
    },
    FormatEntry {
        format: Format::Replica,
        layout: replica::LAYOUT,
        parts: replica::parts,
        looks_like: replica::looks_like,
        is_whole: replica::is_whole,
        open: |path, settings| Ok(Arc::new(ReplicaScene::open(path, settings)?)),
    },
    FormatEntry {
        format: Format::Mvpd,
        layout: mvpd::LAYOUT,
        parts: mvpd::parts,
        looks_like: mvpd::looks_like,
        is_whole: |_| true,
        open: |path, settings| Ok(Arc::new(MvpdScene::open(path, settings)?)),
    },
    FormatEntry {
        format: Format::Folder,
        layout: plain_folder::LAYOUT,
        parts: plain_folder::parts,
        looks_like: plain_folder::looks_like,
        is_whole: plain_folder::is_whole,
        open: |path, settings| Ok(Arc::new(FolderScene::open(path, settings)?)),
    },
    FormatEntry {
        format: Format::Mcap,
        layout: Container::Mcap.layout(),
        parts: |_| Vec::new(),
        looks_like: |path| recording::looks_like(path, Container::Mcap),
        is_whole: |_| true,
        open: |path, settings| Ok(Arc::new(RecordingScene::open_as(path, Container::Mcap, settings)?)),
    },
    FormatEntry {
        format: Format::Db3,
        layout: Container::Db3.layout(),
        parts: |_| Vec::new(),
        looks_like: |path| recording::looks_like(path, Container::Db3),
        is_whole: |_| true,
        open: |path, settings| Ok(Arc::new(RecordingScene::open_as(path, Container::Db3, settings)?)),
    },
    FormatEntry {
        format: Format::Bag,
        layout: Container::Bag.layout(),
        parts: |_| Vec::new(),
        looks_like: |path| recording::looks_like(path, Container::Bag),
        is_whole: |_| true,
        open: |path, settings| Ok(Arc::new(RecordingScene::open_as(path, Container::Bag, settings)?)),
    },
    FormatEntry {
        format: Format::Mkv,
        layout: Container::Mkv.layout(),
        parts: |_| Vec::new(),
        looks_like: |path| recording::looks_like(path, Container::Mkv),
        is_whole: |_| true,
        open: |path, settings| Ok(Arc::new(RecordingScene::open_as(path, Container::Mkv, settings)?)),
    },
    FormatEntry {
        format: Format::R3d,
        layout: r3d::LAYOUT,
        parts: |_| Vec::new(),
        looks_like: r3d::looks_like,
        is_whole: |_| true,
        open: |path, settings| Ok(Arc::new(r3d::open(path, settings)?)),
    },
    FormatEntry {
        format: Format::Nerfstudio,
        layout: nerfstudio::LAYOUT,
        parts: nerfstudio::parts,
        looks_like: nerfstudio::looks_like,
        is_whole: nerfstudio::is_whole,
        open: |path, settings| Ok(Arc::new(nerfstudio::open(path, settings)?)),
    },
    FormatEntry {
        format: Format::Polycam,
        layout: polycam::LAYOUT,
        parts: polycam::parts,
        looks_like: polycam::looks_like,
        is_whole: |_| true,
        open: |path, settings| Ok(Arc::new(polycam::open(path, settings)?)),
    },
    FormatEntry {
        format: Format::Stray,
        layout: stray::LAYOUT,
        parts: stray::parts,
        looks_like: stray::looks_like,
        is_whole: |_| true,
        open: |path, settings| Ok(Arc::new(stray::open(path, settings)?)),
    },
    FormatEntry {
        format: Format::ArkitScenes,
        layout: arkitscenes::LAYOUT,
        parts: arkitscenes::parts,
        looks_like: arkitscenes::looks_like,
        is_whole: |_| true,
        open: |path, settings| Ok(Arc::new(arkitscenes::open(path, settings)?)),
    },
    FormatEntry {
        format: Format::Video,
        layout: video::LAYOUT,
        parts: |_| Vec::new(),
        looks_like: video::looks_like,
        is_whole: |_| true,
        open: |path, settings| Ok(Arc::new(video::open(path, settings)?)),
    },
    FormatEntry {
        format: Format::Images,
        layout: plain_folder::IMAGES_LAYOUT,
        parts: |_| Vec::new(),
        looks_like: plain_folder::looks_like_images,
        is_whole: |_| true,
        open: |path, settings| Ok(Arc::new(FolderScene::of_images(path, settings)?)),
    },
    FormatEntry {
        format: Format::Synthetic,
        layout: synthetic::LAYOUT,
        parts: |_| Vec::new(),
        looks_like: synthetic::looks_like,
        is_whole: |_| true,
        open: |path, settings| {
            require_no_depth_scale(settings, Format::Synthetic.name())?;
            synthetic::open(path, settings)
        },
    },
];

/// Opens the scene at `path`: a folder or file, one video of several as `PATH:VIDEO` (see [`Format::Mvpd`]), or
/// `synthetic` with optional settings (`synthetic:frames=60,seed=3`; write `./synthetic` for a folder of that name).
/// Does not read any frames yet.
///
/// # Errors
/// Separate errors for a path that does not exist, an empty folder, a scene with missing parts, and a path not in a
/// known format (or not in `settings.format`). The last two list the expected files.
pub fn open_scene(path: impl AsRef<Path>, settings: &DatasetSettings) -> Result<Arc<dyn Scene>, DatasetError> {
    let path = path.as_ref();
    settings.validate()?;
    if !synthetic::looks_like(path) && !mvpd::looks_like(path) {
        check_path(path)?;
    }
    if settings.format == Format::Auto {
        return match detected(path) {
            Some(entry) => open(entry, path, settings),
            None => Err(file_error(path).or_else(|| best_fit(path)).unwrap_or_else(|| DatasetError::NotRecognised {
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

/// Returns the first format of which a path is a whole scene, otherwise the first of which it may be one. So a recording
/// with poses is preferred to files beside it that were extracted without them.
fn detected(path: &Path) -> Option<&'static FormatEntry> {
    let fits = |entry: &&FormatEntry| (entry.looks_like)(path);
    let whole = FORMATS.iter().find(|entry| fits(entry) && (entry.is_whole)(path));
    let found = whole.or_else(|| FORMATS.iter().find(fits))?;
    // Images may be those of a scene that lacks a part. A camera and poses alone do not make one.
    let is_part = || match best_fit(path) {
        Some(DatasetError::Incomplete { format, .. }) => format != Format::Folder.name() || path.join("color").is_dir(),
        found => found.is_some(),
    };
    (found.format != Format::Images || !is_part()).then_some(found)
}

/// Returns true if a path is a scene of a format that is detected. Reads no frame.
pub fn is_scene(path: &Path) -> bool {
    detected(path).is_some()
}

/// Returns false for a path whose format has no depth, so that it must be predicted, and for a recording whose depth is not
/// read (`depth` is `none`). Reads no frame, and extracts none.
pub fn has_depth(path: &Path, settings: &DatasetSettings) -> bool {
    let is_read = |format: Format| format.has_depth() && (settings.reads_depth_topic() || !format.has_topics());
    format_of(path, settings).is_none_or(is_read)
}

/// Returns true for a recording that has no topic with depth, unless the settings name one. Reads the recording once.
pub fn lacks_depth_topic(path: &Path, settings: &DatasetSettings) -> bool {
    let has_topics = settings.depth.is_none() && format_of(path, settings).is_some_and(Format::has_topics);
    // Opening the recording returns the error.
    has_topics && RecordingScene::lacks_depth(path).unwrap_or(false)
}

/// The format of the settings, or that of the path.
fn format_of(path: &Path, settings: &DatasetSettings) -> Option<Format> {
    match settings.format {
        Format::Auto => detected(path).map(|entry| entry.format),
        format => Some(format),
    }
}

/// Returns the missing-parts error of the best matching format, if at least half of its parts are present.
fn best_fit(path: &Path) -> Option<DatasetError> {
    let candidates =
        FORMATS.iter().filter_map(|entry| incomplete(entry, path)).filter(|(fraction, _)| *fraction >= 0.5);
    // Ties go to the first format.
    candidates.reduce(|best, next| if next.0 > best.0 { next } else { best }).map(|(_, error)| error)
}

/// Returns the fraction of a format's parts found at a path, 0 to 1, and the error that lists the missing ones; `None`
/// if none was found.
fn incomplete(entry: &FormatEntry, path: &Path) -> Option<(f64, DatasetError)> {
    let (found, missing): (Vec<_>, Vec<_>) = (entry.parts)(path).into_iter().partition(|(_, is_present)| *is_present);
    if found.is_empty() {
        return None;
    }
    let fraction = found.len() as f64 / (found.len() + missing.len()) as f64;
    let names = |parts: Vec<(&str, bool)>| parts.into_iter().map(|(part, _)| part).collect::<Vec<_>>().join(", ");
    let error = DatasetError::Incomplete {
        path: path.to_owned(),
        format: entry.format.name(),
        found: names(found),
        missing: names(missing),
    };
    Some((fraction, error))
}

fn open(entry: &FormatEntry, path: &Path, settings: &DatasetSettings) -> Result<Arc<dyn Scene>, DatasetError> {
    if settings.register_depth == DepthRegistration::True && !entry.format.registers_depth() {
        return Err(SettingError {
            key: "dataset.register_depth".to_owned(),
            found: "true".to_owned(),
            expected: format!(
                "auto or false for {}, whose format is {}: only {} have depth that is not registered",
                path.display(),
                entry.format,
                Format::listed(Format::registers_depth)
            ),
        }
        .into());
    }
    if let Some((name, found)) = settings.first_topic_setting().filter(|_| !entry.format.has_topics()) {
        return Err(SettingError {
            key: format!("dataset.{name}"),
            found: format!("{found:?}"),
            expected: format!(
                "no value for {}, whose format is {}: only {} have topics",
                path.display(),
                entry.format,
                Format::listed(Format::has_topics)
            ),
        }
        .into());
    }
    let scene = (entry.open)(path, settings)?;
    let format = settings.pose_format();
    if format.is_default() || converts_poses(entry.format) {
        return Ok(scene);
    }
    Ok(Arc::new(ConvertedPoses { scene, format }))
}

/// Returns true for formats whose readers apply the settings about poses themselves: before they move them to the colour
/// camera (7-Scenes), or around a convention of their own.
fn converts_poses(format: Format) -> bool {
    use Format::{ArkitScenes, Nerfstudio, Polycam, R3d, SevenScenes, Stray};
    matches!(format, SevenScenes | R3d | Nerfstudio | Polycam | Stray | ArkitScenes)
}

/// Returns one line per supported format: its name and layout.
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
