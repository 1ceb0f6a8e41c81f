//! Everything that can be wrong with a scene or its settings.

use splatseg_geometry::{DistortionError, FrameError, IntrinsicsError, PoseError};
use splatseg_settings::SettingError;
use std::path::PathBuf;
use thiserror::Error;

/// The most names that a message lists.
pub(crate) const NAMES_IN_MESSAGES: usize = 5;

/// A scene, or one of its frames, that cannot be read.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum DatasetError {
    /// There is nothing at the path.
    #[error("{}: does not exist", path.display())]
    NotFound {
        /// The path that was given.
        path: PathBuf,
    },
    /// The folder is empty.
    #[error("{}: the folder is empty", path.display())]
    EmptyFolder {
        /// The path that was given.
        path: PathBuf,
    },
    /// The path holds something, but not a scene of a known format.
    #[error("{}: not a scene of a known format. Supported are:\n{supported}", path.display())]
    NotRecognised {
        /// The path that was given.
        path: PathBuf,
        /// One line for each format: its name and what was looked for.
        supported: String,
    },
    /// The path does not hold a scene of the requested format.
    #[error("{}: not a scene of format {format}, which is laid out as {layout}", path.display())]
    OtherFormat {
        /// The path that was given.
        path: PathBuf,
        /// Name of the requested format.
        format: &'static str,
        /// What was looked for.
        layout: &'static str,
    },
    /// The path holds a part of a scene.
    #[error("{}: looks like a scene of format {format}, but this is missing: {missing} (found: {found})", path.display())]
    Incomplete {
        /// The path that was given.
        path: PathBuf,
        /// Name of the format that fits best, or that was requested.
        format: &'static str,
        /// The parts that are there.
        found: String,
        /// The parts that are not.
        missing: String,
    },
    /// The folder holds several recordings.
    #[error("{}: holds several sequences, pick one of {}", path.display(), sequences.join(", "))]
    SeveralSequences {
        /// The path that was given.
        path: PathBuf,
        /// Names of the sequence folders, sorted.
        sequences: Vec<String>,
    },
    /// The folder has the right layout but no frames.
    #[error("{}: no frames: looked for {expected}", path.display())]
    NoFrames {
        /// The folder in which frames were looked for.
        path: PathBuf,
        /// The file names that were looked for.
        expected: &'static str,
    },
    /// A frame index past the end.
    #[error("{scene}: there is no frame {index}, the scene has {count}")]
    NoSuchFrame {
        /// The scene's name.
        scene: String,
        /// The requested index.
        index: usize,
        /// Number of frames.
        count: usize,
    },
    /// A file that the format needs is not there.
    #[error("{}: the {what} is missing", path.display())]
    MissingFile {
        /// The file that was looked for.
        path: PathBuf,
        /// What it would hold.
        what: &'static str,
    },
    /// The operating system could not read a file or folder.
    #[error("{}: cannot be read: {source}", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// What the operating system reported.
        source: std::io::Error,
    },
    /// A file is too big to be what it should be.
    #[error("{}: {bytes} bytes are too many for a {what} (at most {limit})", path.display())]
    FileTooBig {
        /// The file.
        path: PathBuf,
        /// What it should be.
        what: &'static str,
        /// Its size.
        bytes: u64,
        /// The largest size that is accepted.
        limit: u64,
    },
    /// Something would take more memory than the program may.
    #[error(
        "{}: the {what} of {}x{} pixels would take {needed} of memory, but the limit is {limit}: {remedy}",
        path.display(), size.0, size.1
    )]
    MemoryLimit {
        /// The file, or the scene's name.
        path: PathBuf,
        /// What it is.
        what: &'static str,
        /// Its size, `(width, height)`.
        size: (usize, usize),
        /// What it would take, e.g. `1.1 GB`.
        needed: String,
        /// The limit, e.g. `500 MB`.
        limit: String,
        /// What the user can do about it.
        remedy: &'static str,
    },
    /// An image cannot be decoded.
    #[error("{}: the {what} is damaged: {source}", path.display())]
    Image {
        /// The file.
        path: PathBuf,
        /// What it should hold.
        what: &'static str,
        /// What the decoder reported.
        source: image::ImageError,
    },
    /// A JPEG file ends before its image does.
    #[error("{}: the {what} is cut off: a JPEG ends with the marker FF D9, which is missing", path.display())]
    CutOff {
        /// The file.
        path: PathBuf,
        /// What it should hold.
        what: &'static str,
    },
    /// An image's header states a size that its file cannot hold, or that is larger than any frame of a video.
    #[error(
        "{}: the {what} claims to have {width}x{height} pixels, which its {bytes} bytes cannot hold or is more than {limit} pixels",
        path.display()
    )]
    ImplausibleSize {
        /// The file.
        path: PathBuf,
        /// What it should hold.
        what: &'static str,
        /// Stated width.
        width: u32,
        /// Stated height.
        height: u32,
        /// Size of the file.
        bytes: usize,
        /// Most pixels that are accepted.
        limit: u64,
    },
    /// An image has the wrong kind of pixels.
    #[error("{}: the {what} has {found} pixels, expected {expected}", path.display())]
    PixelKind {
        /// The file.
        path: PathBuf,
        /// What it should hold.
        what: &'static str,
        /// The kind of pixels in the file.
        found: String,
        /// The kind of pixels that it should have.
        expected: &'static str,
    },
    /// Two images that should have the same size differ.
    #[error("{}: the {what} has {}x{} pixels, but {expected_from} has {}x{}", path.display(), found.0, found.1, expected.0, expected.1)]
    SizesDiffer {
        /// The file (or the frame's name, for rendered scenes).
        path: PathBuf,
        /// What it holds.
        what: &'static str,
        /// Its size, `(width, height)`.
        found: (usize, usize),
        /// The size it should have, `(width, height)`.
        expected: (usize, usize),
        /// Where the expected size comes from.
        expected_from: &'static str,
    },
    /// A text file does not hold what it should.
    #[error("{}: {what}: found {found}, expected {expected}", path.display())]
    Text {
        /// The file.
        path: PathBuf,
        /// What it should hold.
        what: &'static str,
        /// What was found.
        found: String,
        /// What was expected.
        expected: &'static str,
    },
    /// A camera pose is not a rigid transform.
    #[error("{}: {source}", path.display())]
    Pose {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: PoseError,
    },
    /// Intrinsics are not those of a camera.
    #[error("{}: {source}", path.display())]
    Intrinsics {
        /// The file.
        path: PathBuf,
        /// What is wrong with them.
        source: IntrinsicsError,
    },
    /// A lens is not described as it should be.
    #[error("{}: {source}", path.display())]
    Distortion {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: DistortionError,
    },
    /// A file has a key that it should not have.
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
        /// The most similar key that the file can have.
        nearest: Option<&'static str>,
        /// All keys that the file can have.
        known: String,
    },
    /// The parts of a frame do not fit together.
    #[error("frame {name}: {source}")]
    Frame {
        /// The frame's name.
        name: String,
        /// What is wrong.
        source: FrameError,
    },
    /// A field of a file does not hold what it should.
    #[error("{}: {field}: found {found}, expected {expected}", path.display())]
    Field {
        /// The file.
        path: PathBuf,
        /// The field, e.g. `depth compression` or `line 12`.
        field: String,
        /// What was found.
        found: String,
        /// What was expected.
        expected: String,
    },
    /// Something would reach past the end of its file.
    #[error(
        "{}: {what} would end at byte {end}, but the file has {bytes} bytes: it is cut off, or a size in it is wrong",
        path.display()
    )]
    EndsEarly {
        /// The file.
        path: PathBuf,
        /// What does not fit, e.g. `frame 12`.
        what: String,
        /// Where it would end, bytes from the start of the file.
        end: u64,
        /// Size of the file.
        bytes: u64,
    },
    /// A zip or tar.gz file cannot be unpacked.
    #[error("{}: the archive is damaged: {source}", path.display())]
    Archive {
        /// The archive.
        path: PathBuf,
        /// What is wrong with it.
        source: std::io::Error,
    },
    /// A JSON file is damaged or lacks something.
    #[error("{}: {source}", path.display())]
    Json {
        /// The file.
        path: PathBuf,
        /// What is wrong, in which line and column.
        source: serde_json::Error,
    },
    /// The path holds several videos and none is chosen.
    #[error(
        "{path}: holds several videos ({}): choose one by adding its name to the path, e.g. {path}:{}",
        few(videos),
        videos.first().map_or("NAME", String::as_str),
        path = path.display()
    )]
    SeveralVideos {
        /// The folder or archive.
        path: PathBuf,
        /// Names of the first few videos, in the file's order.
        videos: Vec<String>,
    },
    /// There is no video of the requested name.
    #[error("{}: there is no video {video:?}; the first are {}", path.display(), few(videos))]
    NoSuchVideo {
        /// The folder or archive.
        path: PathBuf,
        /// The requested name.
        video: String,
        /// Names of the first few videos, in the file's order.
        videos: Vec<String>,
    },
    /// A description of a synthetic scene cannot be understood.
    #[error("{text:?}: {field}: found {found:?}, expected {expected}")]
    Synthetic {
        /// The whole description.
        text: String,
        /// The setting in question.
        field: String,
        /// What was found.
        found: String,
        /// What was expected.
        expected: String,
    },
    /// A setting is out of range, or does not suit this scene.
    #[error(transparent)]
    Setting(#[from] SettingError),
    /// A [`Scene`](crate::Scene) that is defined elsewhere failed.
    #[error("{scene}: {source}")]
    Other {
        /// The scene's name.
        scene: String,
        /// What it reports.
        source: Box<dyn std::error::Error + Send + Sync>,
    },
    /// The thread that reads frames ended early: a format's reader has a defect.
    #[error("{scene}: the reading thread ended early")]
    ReaderEnded {
        /// The scene's name.
        scene: String,
    },
}

impl DatasetError {
    /// Whether it holds for every frame of a scene alike.
    pub(crate) fn is_of_the_scene(&self) -> bool {
        matches!(self, Self::Setting(_) | Self::MemoryLimit { .. })
    }
}

/// Names in a message, with dots if there may be more.
fn few(names: &[String]) -> String {
    if names.is_empty() {
        return "none at all".to_owned();
    }
    let more = if names.len() >= NAMES_IN_MESSAGES { ", ..." } else { "" };
    format!("{}{more}", names.join(", "))
}

/// A frame that could not be read; the frames after it can be.
#[derive(Debug, Error)]
#[error("frame {index} ({name}) cannot be used: {source}")]
pub struct FrameReadError {
    /// Index of the frame in its scene.
    pub index: usize,
    /// The frame's name.
    pub name: String,
    /// What is wrong with it.
    #[source]
    pub source: Box<DatasetError>,
}
