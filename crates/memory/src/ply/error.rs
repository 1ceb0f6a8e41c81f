//! Errors reading and writing splat files.

use super::{OLD_VERSION, VERSION};
use crate::CodebookError;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// An error reading or writing a splat file.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum SplatFileError {
    /// The file system returned an error.
    #[error("{}: cannot {action}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The failed operation.
        action: &'static str,
        /// The error of the file system.
        source: std::io::Error,
    },
    /// The kind of memory has no file format.
    #[error("{}: a memory of this kind cannot be saved", path.display())]
    NoFormat {
        /// The requested file.
        path: PathBuf,
    },
    /// The kind of memory is not one of this program.
    #[error(
        "{}: was saved with memory.kind = \"{found}\", which this program does not have: it has {known}",
        path.display()
    )]
    UnknownKind {
        /// The file.
        path: PathBuf,
        /// The kind in the file.
        found: String,
        /// The kinds that there are.
        known: String,
    },
    /// The lines of the header have the ends of another system, so other bytes have changed, too.
    #[error(
        "{}: the lines of the header end in CR LF: the file was copied as text, which damages it; copy it as binary",
        path.display()
    )]
    CopiedAsText {
        /// The requested file.
        path: PathBuf,
    },
    /// The file does not begin like a PLY file.
    #[error("{}: not a PLY file: the first line is {found:?}, expected \"ply\"", path.display())]
    NotPly {
        /// The file.
        path: PathBuf,
        /// Its first line, or the beginning of it.
        found: String,
    },
    /// The format is not binary little-endian 1.0.
    #[error("{}: the format is {found:?}, expected \"binary_little_endian 1.0\"", path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// The format line's value.
        found: String,
    },
    /// The PLY file was written by another program, or saved again by one.
    #[error(
        "{}: a PLY file, but not a splatseg memory: its header has no \"comment splatseg memory\" (editors drop it, \
         and the data after the vertices)",
        path.display()
    )]
    NotAMemory {
        /// The file.
        path: PathBuf,
    },
    /// The version of the format is unknown.
    #[error(
        "{}: version {found:?} of the splatseg memory format, expected {OLD_VERSION} or {VERSION}: another version of \
         splatseg wrote it",
        path.display()
    )]
    Version {
        /// The file.
        path: PathBuf,
        /// The version in the file.
        found: String,
    },
    /// A header line violates the format.
    #[error("{}: in the header, found {found:?}, expected {expected}", path.display())]
    Header {
        /// The file.
        path: PathBuf,
        /// The line, or the beginning of it.
        found: String,
        /// Description of the expected line.
        expected: String,
    },
    /// The file is shorter or longer than its header says.
    #[error("{}: {found} bytes long, expected {expected} for {content}: cut off or damaged", path.display())]
    Length {
        /// The file.
        path: PathBuf,
        /// Content that the expected length was computed for.
        content: String,
        /// Length of the file in bytes.
        found: u64,
        /// Expected length in bytes; `u64::MAX` for lengths that no file can have.
        expected: u64,
    },
    /// A field of the block after the vertices is invalid.
    #[error("{}: {field} is {found}, expected {expected}", path.display())]
    Trailer {
        /// The file.
        path: PathBuf,
        /// The field.
        field: &'static str,
        /// Its value.
        found: String,
        /// Description of valid values.
        expected: String,
    },
    /// A byte changed after the file was written.
    #[error("{}: damaged: the checksum is {found:#010x}, expected {expected:#010x}", path.display())]
    Checksum {
        /// The file.
        path: PathBuf,
        /// Checksum computed from the bytes of the file.
        found: u32,
        /// Checksum stored at its end.
        expected: u32,
    },
    /// A value of a Gaussian is invalid.
    #[error("{}: {property} of Gaussian {gaussian} is {found}, expected {expected}", path.display())]
    Value {
        /// The file.
        path: PathBuf,
        /// Index of the Gaussian.
        gaussian: usize,
        /// Name of the property in the file.
        property: String,
        /// Its value.
        found: String,
        /// Description of valid values.
        expected: String,
    },
    /// Arrays to be saved contradict each other in length.
    #[error("{}: not saved: {field} has {found} entries, expected {expected}", path.display())]
    Inconsistent {
        /// The file.
        path: PathBuf,
        /// The array.
        field: &'static str,
        /// Its length.
        found: usize,
        /// Expected length.
        expected: usize,
    },
    /// There are more segments than possible ids or than codes.
    #[error("{}: {found} segments, expected at most {max}", path.display())]
    Segments {
        /// The file.
        path: PathBuf,
        /// Number of segments.
        found: u64,
        /// Maximum number of segments.
        max: u64,
    },
    /// The state besides the Gaussians is longer than is read or written.
    #[error("{}: {found} bytes of state besides the Gaussians, expected at most {max}", path.display())]
    SavedState {
        /// The file.
        path: PathBuf,
        /// Length of the state, bytes.
        found: u64,
        /// Maximum length, bytes.
        max: u64,
    },
    /// The header to be written is longer than is read.
    #[error("{}: not saved: a header of {found} bytes, expected at most {max}", path.display())]
    HeaderLength {
        /// The file.
        path: PathBuf,
        /// Length of the header, bytes.
        found: u64,
        /// Maximum length, bytes.
        max: u64,
    },
    /// The state besides the Gaussians cannot be read or written.
    #[error("{}: invalid state besides the Gaussians: {found}", path.display())]
    State {
        /// The file.
        path: PathBuf,
        /// The problem.
        found: String,
    },
    /// A part of the state besides the Gaussians is damaged.
    #[error("invalid state besides the Gaussians: {found}")]
    DamagedSavedState {
        /// The problem.
        found: String,
    },
    /// The codebook in the file is invalid.
    #[error("{}: {source}", path.display())]
    Codebook {
        /// The file.
        path: PathBuf,
        /// The error of the codebook.
        source: CodebookError,
    },
}

impl SplatFileError {
    /// Returns a function for `map_err` that converts a file-system error at `path`.
    pub fn io(path: &Path, action: &'static str) -> impl FnOnce(std::io::Error) -> Self {
        move |source| Self::Io { path: path.to_owned(), action, source }
    }
}
