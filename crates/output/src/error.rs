//! What can go wrong when results are written.

use serde::Serialize;
use splatseg_memory::MAX_SEGMENT_ID;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Something that cannot be written.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum OutputError {
    /// The operating system could not write the file. No partial file is left.
    #[error("{}: cannot be written: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// An id does not fit an image.
    #[error("{}: segment id {id} does not fit an image (at most {MAX_SEGMENT_ID})", path.display())]
    IdTooLarge {
        /// The file.
        path: PathBuf,
        /// The id.
        id: u32,
    },
    /// The image cannot be encoded, e.g. because it is empty or too large for the format.
    #[error("{}: cannot be encoded: {source}", path.display())]
    Encode {
        /// The file.
        path: PathBuf,
        /// What the encoder said.
        source: image::ImageError,
    },
    /// An id image in the folder cannot be read again.
    #[error(transparent)]
    IdImage(#[from] splatseg_dataset::DatasetError),
    /// Another file in the folder cannot be read again.
    #[error("{}: cannot be read: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the operating system said.
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

/// Writes `bytes` to `path`, replacing what is there, so that a reader sees the old file or the new one, never a part
/// (see [`splatseg_atomic_file`]). The folder must exist.
///
/// # Errors
/// [`OutputError::Io`] names the path; the old file stays as it was.
pub fn write_atomically(path: &Path, bytes: &[u8]) -> Result<(), OutputError> {
    splatseg_atomic_file::write_atomically(path, bytes)
        .map_err(|source| OutputError::Io { path: path.to_owned(), source })
}

/// What an output that writes `file` has kept, as JSON.
pub(crate) fn saved_state(file: &str, state: &impl Serialize) -> Result<Vec<u8>, OutputError> {
    serde_json::to_vec(state).map_err(|error| OutputError::Io { path: PathBuf::from(file), source: error.into() })
}
