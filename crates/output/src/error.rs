//! Errors writing results.

use serde::Serialize;
use splatseg_annotations::WriteIdsError;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Errors writing results.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum OutputError {
    /// The operating system could not write the file. No partial file is left.
    #[error("{}: cannot be written: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The operating system's error.
        source: std::io::Error,
    },
    /// An id image cannot be written.
    #[error(transparent)]
    WriteIds(#[from] WriteIdsError),
    /// The image cannot be encoded, e.g. because it is empty or too large for the format.
    #[error("{}: cannot be encoded: {source}", path.display())]
    Encode {
        /// The file.
        path: PathBuf,
        /// The encoder's error.
        source: image::ImageError,
    },
    /// The image cannot be encoded as a JPEG: it is empty, or too large for the format.
    #[error("{}: {source}", path.display())]
    EncodeJpeg {
        /// The file.
        path: PathBuf,
        /// The encoder's error.
        source: splatseg_jpeg::EncodeError,
    },
    /// An id image in the folder cannot be read again.
    #[error(transparent)]
    IdImage(#[from] splatseg_dataset::DatasetError),
    /// Another file in the folder cannot be read again.
    #[error("{}: cannot be read: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The operating system's error.
        source: std::io::Error,
    },
    /// An overlay needs an image and segments of the same size.
    #[error("the image has {}x{} pixels but the segments have {}x{}", image.0, image.1, segments.0, segments.1)]
    SizesDiffer {
        /// Size of the image, `(width, height)`.
        image: (usize, usize),
        /// Size of the segment map, `(width, height)`.
        segments: (usize, usize),
    },
}

/// Writes `bytes` to `path`, replacing any existing file. A reader sees the old file or the new one, never a partial
/// file (see [`splatseg_files`]), also after a power cut. The folder must exist.
///
/// # Errors
/// [`OutputError::Io`] names the path; the old file stays as it was.
pub fn write_atomically(path: &Path, bytes: &[u8]) -> Result<(), OutputError> {
    splatseg_files::write_atomically(path, bytes).map_err(|source| OutputError::Io { path: path.to_owned(), source })
}

/// As [`write_atomically`], but does not wait for the disk (see [`splatseg_files::AtomicFile::commit_unsynced`]).
///
/// # Errors
/// As [`write_atomically`].
pub fn write_unsynced(path: &Path, bytes: &[u8]) -> Result<(), OutputError> {
    splatseg_files::write_unsynced(path, bytes).map_err(|source| OutputError::Io { path: path.to_owned(), source })
}

/// The state of the output that writes `file`, as JSON.
pub(crate) fn saved_state(file: &str, state: &impl Serialize) -> Result<Vec<u8>, OutputError> {
    serde_json::to_vec(state).map_err(|error| OutputError::Io { path: PathBuf::from(file), source: error.into() })
}
