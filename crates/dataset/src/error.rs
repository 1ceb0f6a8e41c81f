//! Errors reading a scene or its settings.

use crate::GuessedCamera;
use crate::own_camera::suggestion;
use splatseg_geometry::{DistortionError, FrameError, IntrinsicsError, PoseError};
use splatseg_settings::SettingError;
use splatseg_synthetic::SyntheticError;
use std::path::PathBuf;
use thiserror::Error;

/// Maximum number of names listed in a message.
pub(crate) const NAMES_IN_MESSAGES: usize = 5;
/// Name of colour images in errors.
pub(crate) const COLOR_IMAGE: &str = "colour image";
/// Name of depth images in errors.
pub(crate) const DEPTH_IMAGE: &str = "depth image";
/// Name of images of confidence in errors.
pub(crate) const CONFIDENCE_IMAGE: &str = "confidence image";
/// Name of segment images in errors.
pub(crate) const SEGMENT_IMAGE: &str = "segment image";

/// Error reading a scene or one of its frames.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum DatasetError {
    /// The path does not exist.
    #[error("{}: does not exist", path.display())]
    NotFound {
        /// The given path.
        path: PathBuf,
    },
    /// The folder is empty.
    #[error("{}: the folder is empty", path.display())]
    EmptyFolder {
        /// The given path.
        path: PathBuf,
    },
    /// The path is not a scene in a known format.
    #[error("{}: not a scene in a known format. Supported formats:\n{supported}", path.display())]
    NotRecognised {
        /// The given path.
        path: PathBuf,
        /// One line per format: its name and expected layout.
        supported: String,
    },
    /// The path is a file that no format reads.
    #[error("{}: format: found {found}, expected {expected}", path.display())]
    UnknownFile {
        /// The given path.
        path: PathBuf,
        /// The kind of file, or its first bytes.
        found: String,
        /// The input to use instead.
        expected: String,
    },
    /// The path is a video or a folder of images of colour alone.
    #[error(
        "{}: colour without depth, and depth is needed: predict it (--depth-weights FILE, docs/PREDICTED_DEPTH.md), or give a \
         recording that has both (docs/FORMATS.md)",
        path.display()
    )]
    NoDepth {
        /// The given path.
        path: PathBuf,
    },
    /// The path is not a scene in the requested format.
    #[error("{}: not a scene of format {format}, expected layout: {layout}", path.display())]
    OtherFormat {
        /// The given path.
        path: PathBuf,
        /// Name of the requested format.
        format: &'static str,
        /// Expected layout.
        layout: &'static str,
    },
    /// Some parts of a scene are missing.
    #[error("{}: looks like a scene of format {format}, but this is missing: {missing} (found: {found})", path.display())]
    Incomplete {
        /// The given path.
        path: PathBuf,
        /// Name of the requested or best matching format.
        format: &'static str,
        /// Parts that were found.
        found: String,
        /// Parts that are missing.
        missing: String,
    },
    /// The folder contains several recordings.
    #[error("{}: holds several sequences, pick one of {}", path.display(), sequences.join(", "))]
    SeveralSequences {
        /// The given path.
        path: PathBuf,
        /// Names of the sequence folders, sorted.
        sequences: Vec<String>,
    },
    /// The folder has the right layout but no frames.
    #[error("{}: no frames: looked for {expected}", path.display())]
    NoFrames {
        /// Folder that was searched.
        path: PathBuf,
        /// Expected file names.
        expected: &'static str,
    },
    /// The folder has the right layout, but its files are of other kinds than those that are read.
    #[error("{}: no frames: found {found}, expected {expected}", path.display())]
    OtherFiles {
        /// Folder that was searched.
        path: PathBuf,
        /// Number of files by extension, e.g. `8 .bin`.
        found: String,
        /// Expected file names.
        expected: &'static str,
    },
    /// The frame index is past the end of the scene.
    #[error("{scene}: there is no frame {index}, the scene has {count}")]
    NoSuchFrame {
        /// The scene's name.
        scene: String,
        /// The requested index.
        index: usize,
        /// Number of frames.
        count: usize,
    },
    /// The frame has no pose, and one is needed.
    #[error("{scene}: frame {frame} has no pose")]
    NoPose {
        /// The scene's name.
        scene: String,
        /// The frame's name.
        frame: String,
    },
    /// The camera is not known: no file describes it, and no setting does.
    #[error("{}: the camera is not known: describe it in {file}, or give its focal length in pixels with --fx{}", path.display(), suggestion(estimate.as_ref()))]
    NoCamera {
        /// The scene.
        path: PathBuf,
        /// The file, or files, that would describe it.
        file: &'static str,
        /// The focal length that the motion in the colour images suggests; `None` if it cannot be estimated.
        estimate: Option<GuessedCamera>,
    },
    /// A file required by the format is missing.
    #[error("{}: the {what} is missing", path.display())]
    MissingFile {
        /// The missing file.
        path: PathBuf,
        /// Expected content.
        what: &'static str,
    },
    /// The operating system could not read a file or folder.
    #[error("{}: cannot be read: {source}", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// Error reported by the operating system.
        source: std::io::Error,
    },
    /// A file is too large for its expected content.
    #[error("{}: {bytes} bytes are too many for a {what} (at most {limit})", path.display())]
    FileTooBig {
        /// The file.
        path: PathBuf,
        /// Expected content.
        what: &'static str,
        /// Its size.
        bytes: u64,
        /// The largest size that is accepted.
        limit: u64,
    },
    /// An image or map would exceed the memory limit.
    #[error(
        "{}: the {what} of {}x{} pixels would take {needed} of memory, but the limit is {limit}: {remedy}",
        path.display(), size.0, size.1
    )]
    MemoryLimit {
        /// The file, or the scene's name.
        path: PathBuf,
        /// Name of the image or map.
        what: &'static str,
        /// Its size, `(width, height)`.
        size: (usize, usize),
        /// Memory needed, e.g. `1.1 GB`.
        needed: String,
        /// The limit, e.g. `500 MB`.
        limit: String,
        /// Advice to the user.
        remedy: &'static str,
    },
    /// An image cannot be decoded.
    #[error("{}: the {what} is damaged: {source}", path.display())]
    Image {
        /// The file.
        path: PathBuf,
        /// Expected content.
        what: &'static str,
        /// Error reported by the decoder.
        source: image::ImageError,
    },
    /// A JPEG file is truncated.
    #[error("{}: the {what} is cut off: the JPEG end marker (FF D9) is missing", path.display())]
    CutOff {
        /// The file.
        path: PathBuf,
        /// Expected content.
        what: &'static str,
    },
    /// The image size in a header exceeds the capacity of the file, or the limit for video frames.
    #[error(
        "{}: the {what} claims to have {width}x{height} pixels, more than its {bytes} bytes can hold or more than the limit of {limit}",
        path.display()
    )]
    ImplausibleSize {
        /// The file.
        path: PathBuf,
        /// Expected content.
        what: &'static str,
        /// Stated width.
        width: u32,
        /// Stated height.
        height: u32,
        /// Size of the file.
        bytes: usize,
        /// Maximum number of pixels.
        limit: u64,
    },
    /// An image has the wrong pixel format.
    #[error("{}: the {what} has {found} pixels, expected {expected}", path.display())]
    PixelKind {
        /// The file.
        path: PathBuf,
        /// Expected content.
        what: &'static str,
        /// Pixel format of the file.
        found: String,
        /// Expected pixel format.
        expected: &'static str,
    },
    /// Two images that should have the same size do not.
    #[error("{}: the {what} has {}x{} pixels, but {expected_from} has {}x{}", path.display(), found.0, found.1, expected.0, expected.1)]
    SizesDiffer {
        /// The file (or the frame's name, for rendered scenes).
        path: PathBuf,
        /// Content of the file.
        what: &'static str,
        /// Its size, `(width, height)`.
        found: (usize, usize),
        /// Expected size, `(width, height)`.
        expected: (usize, usize),
        /// Source of the expected size.
        expected_from: &'static str,
    },
    /// A text file has the wrong content.
    #[error("{}: {what}: found {found}, expected {expected}", path.display())]
    Text {
        /// The file.
        path: PathBuf,
        /// Expected content.
        what: &'static str,
        /// Value found.
        found: String,
        /// Value expected.
        expected: &'static str,
    },
    /// A camera pose is not a rigid transform.
    #[error("{}: {source}", path.display())]
    Pose {
        /// The file.
        path: PathBuf,
        /// Underlying error.
        source: PoseError,
    },
    /// Camera intrinsics are invalid.
    #[error("{}: {source}", path.display())]
    Intrinsics {
        /// The file.
        path: PathBuf,
        /// Underlying error.
        source: IntrinsicsError,
    },
    /// The lens distortion model is invalid.
    #[error("{}: {source}", path.display())]
    Distortion {
        /// The file.
        path: PathBuf,
        /// Underlying error.
        source: DistortionError,
    },
    /// A file contains an unknown key.
    #[error(
        "{}: unknown key {key:?}{}: the keys are {known}",
        path.display(),
        nearest.map(|nearest| format!(", did you mean {nearest}")).unwrap_or_default()
    )]
    UnknownKey {
        /// The file.
        path: PathBuf,
        /// The key.
        key: String,
        /// The most similar valid key.
        nearest: Option<&'static str>,
        /// All valid keys.
        known: String,
    },
    /// The parts of a frame are inconsistent.
    #[error("frame {name}: {source}")]
    Frame {
        /// The frame's name.
        name: String,
        /// Underlying error.
        source: FrameError,
    },
    /// The unit of depth leaves nothing of it.
    #[error(
        "{}: all depth is below {:.1} mm: check the unit of the depth (dataset.depth_scale, --depth-scale: stored units per \
         metre, 1000 for millimetres)",
        path.display(),
        (farthest * 1000.0).max(0.1)
    )]
    NoDepthLeft {
        /// The depth image.
        path: PathBuf,
        /// The largest depth, metres.
        farthest: f32,
    },
    /// A field of a file has an invalid value.
    #[error("{}: {field}: found {found}, expected {expected}", path.display())]
    Field {
        /// The file.
        path: PathBuf,
        /// The field, e.g. `depth compression` or `line 12`.
        field: String,
        /// Value found.
        found: String,
        /// Value expected.
        expected: String,
    },
    /// A record extends past the end of its file.
    #[error(
        "{}: {what} would end at byte {end}, but the file has {bytes} bytes: it is cut off, or a size in it is wrong",
        path.display()
    )]
    EndsEarly {
        /// The file.
        path: PathBuf,
        /// Name of the record, e.g. `frame 12`.
        what: String,
        /// End of the record, bytes from the start of the file.
        end: u64,
        /// Size of the file.
        bytes: u64,
    },
    /// A zip or tar.gz file cannot be unpacked.
    #[error("{}: the archive is damaged: {source}", path.display())]
    Archive {
        /// The archive.
        path: PathBuf,
        /// Underlying error.
        source: std::io::Error,
    },
    /// A JSON file is damaged or incomplete.
    #[error("{}: {source}", path.display())]
    Json {
        /// The file.
        path: PathBuf,
        /// Underlying error, with line and column.
        source: serde_json::Error,
    },
    /// The path contains several videos and none was chosen.
    #[error(
        "{path}: holds several videos ({}): choose one by adding its name to the path, e.g. {path}:{}",
        joined_names(videos),
        videos.first().map_or("NAME", String::as_str),
        path = path.display()
    )]
    SeveralVideos {
        /// The folder or archive.
        path: PathBuf,
        /// Names of the first few videos, in the file's order.
        videos: Vec<String>,
    },
    /// No video has the requested name.
    #[error("{}: there is no video {video:?}; the first are {}", path.display(), joined_names(videos))]
    NoSuchVideo {
        /// The folder or archive.
        path: PathBuf,
        /// The requested name.
        video: String,
        /// Names of the first few videos, in the file's order.
        videos: Vec<String>,
    },
    /// The description of a synthetic scene is invalid.
    #[error(transparent)]
    Synthetic(#[from] SyntheticError),
    /// A setting is out of range or does not apply to this scene.
    #[error(transparent)]
    Setting(#[from] SettingError),
    /// A [`Scene`](crate::Scene) implemented outside this crate failed.
    #[error("{scene}: {source}")]
    Other {
        /// The scene's name.
        scene: String,
        /// Underlying error.
        source: Box<dyn std::error::Error + Send + Sync>,
    },
    /// The reader thread ended early, because of a bug in a format's reader.
    #[error("{scene}: the reading thread ended early")]
    ReaderEnded {
        /// The scene's name.
        scene: String,
    },
}

impl DatasetError {
    /// Returns true if the error applies to every frame of a scene.
    pub(crate) fn affects_all_frames(&self) -> bool {
        matches!(self, Self::Setting(_) | Self::MemoryLimit { .. } | Self::NoDepthLeft { .. })
    }
}

/// Joins the names, with an ellipsis if there may be more.
fn joined_names(names: &[String]) -> String {
    if names.is_empty() {
        return "none at all".to_owned();
    }
    let more = if names.len() >= NAMES_IN_MESSAGES { ", ..." } else { "" };
    format!("{}{more}", names.join(", "))
}

/// Error reading one frame. Later frames can still be read.
#[derive(Debug, Error)]
#[error("frame {index} ({name}) cannot be used: {source}")]
pub struct FrameReadError {
    /// Index of the frame in its scene.
    pub index: usize,
    /// The frame's name.
    pub name: String,
    /// Underlying error.
    #[source]
    pub source: Box<DatasetError>,
}
