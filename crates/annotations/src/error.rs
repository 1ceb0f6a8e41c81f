//! Errors reading annotations and writing id images.

use splatseg_dataset::DatasetError;
use splatseg_geometry::SegmentId;
use splatseg_settings::SettingError;
use std::fmt::Display;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// An error reading predictions or a mesh.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum AnnotationError {
    /// An image, or the scene, cannot be read.
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    /// A setting does not fit the scene.
    #[error(transparent)]
    Setting(#[from] SettingError),
    /// A file or folder cannot be used.
    #[error("{}: {problem}", path.display())]
    Unusable {
        /// The file, folder or scene.
        path: PathBuf,
        /// Description of the problem.
        problem: String,
    },
}

impl AnnotationError {
    /// Creates an error about a file, folder or scene.
    pub fn at(path: &Path, problem: impl Display) -> Self {
        Self::Unusable { path: path.to_owned(), problem: problem.to_string() }
    }
}

/// An error writing an id image. No partial file is left.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum WriteIdsError {
    /// The operating system could not write the file.
    #[error("{}: cannot be written: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The operating system's error.
        source: std::io::Error,
    },
    /// An id does not fit an image.
    #[error("{}: segment id {id} does not fit an image (at most {limit})", path.display())]
    IdTooLarge {
        /// The file.
        path: PathBuf,
        /// The id.
        id: SegmentId,
        /// The largest id that fits.
        limit: SegmentId,
    },
    /// The image cannot be encoded, e.g. because it is empty or too large for the format.
    #[error("{}: cannot be encoded: {source}", path.display())]
    Encode {
        /// The file.
        path: PathBuf,
        /// The encoder's error.
        source: image::ImageError,
    },
}

impl WriteIdsError {
    /// Names another file, e.g. the destination of a file that was written to a staging folder.
    #[must_use]
    pub fn with_path(self, path: PathBuf) -> Self {
        match self {
            Self::Io { source, .. } => Self::Io { path, source },
            Self::IdTooLarge { id, limit, .. } => Self::IdTooLarge { path, id, limit },
            Self::Encode { source, .. } => Self::Encode { path, source },
        }
    }
}
