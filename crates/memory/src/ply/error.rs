//! What can be wrong with a splat file.

use crate::CodebookError;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// A splat file that cannot be read or written.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum SplatFileError {
    /// The file system refused.
    #[error("{}: cannot {action}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What was being done.
        action: &'static str,
        /// Why it failed.
        source: std::io::Error,
    },
    /// The memory is of a kind that has no file format.
    #[error("{}: a memory of this kind cannot be saved", path.display())]
    NoFormat {
        /// The file that was asked for.
        path: PathBuf,
    },
    /// What is to be saved cannot be read off the device that holds it.
    #[error("{}: {source}", path.display())]
    Device {
        /// The file that was asked for.
        path: PathBuf,
        /// What the device reports.
        source: Box<crate::MemoryError>,
    },
    /// The file does not begin like a PLY.
    #[error("{}: not a PLY file: the first line is {found:?}, expected \"ply\"", path.display())]
    NotPly {
        /// The file.
        path: PathBuf,
        /// Its first line, or the beginning of it.
        found: String,
    },
    /// ASCII, big-endian, or a format of the future.
    #[error("{}: the format is {found:?}, expected \"binary_little_endian 1.0\"", path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// The format line's value.
        found: String,
    },
    /// A PLY of another program, or one that another program has saved again.
    #[error(
        "{}: a PLY file, but not a splatseg memory: its header has no \"comment splatseg memory\" (editors drop it, \
         and what stands behind the vertices)",
        path.display()
    )]
    NotAMemory {
        /// The file.
        path: PathBuf,
    },
    /// A version of the format that this program does not know.
    #[error("{}: version {found:?} of the splatseg memory format, expected {expected}", path.display())]
    Version {
        /// The file.
        path: PathBuf,
        /// The version in the file.
        found: String,
        /// The version that can be read.
        expected: u32,
    },
    /// A header line that is not as the format has it.
    #[error("{}: in the header, found {found:?}, expected {expected}", path.display())]
    Header {
        /// The file.
        path: PathBuf,
        /// The line, or the beginning of it.
        found: String,
        /// What should stand there.
        expected: String,
    },
    /// A file shorter or longer than its header says.
    #[error("{}: {found} bytes long, expected {expected} for {content}: cut off or damaged", path.display())]
    Length {
        /// The file.
        path: PathBuf,
        /// What the length was computed for.
        content: String,
        /// Bytes in the file.
        found: u64,
        /// Bytes there should be; `u64::MAX` for numbers that no file can hold.
        expected: u64,
    },
    /// A field of the block behind the vertices that is not as the format has it.
    #[error("{}: {field} is {found}, expected {expected}", path.display())]
    Trailer {
        /// The file.
        path: PathBuf,
        /// The field.
        field: &'static str,
        /// Its value.
        found: String,
        /// What it should be.
        expected: String,
    },
    /// Some byte changed after the file was written.
    #[error("{}: damaged: the checksum is {found:#010x}, expected {expected:#010x}", path.display())]
    Checksum {
        /// The file.
        path: PathBuf,
        /// Checksum of the bytes in the file.
        found: u32,
        /// Checksum stated at its end.
        expected: u32,
    },
    /// A value that no Gaussian can have.
    #[error("{}: {property} of Gaussian {gaussian} is {found}, expected {expected}", path.display())]
    Value {
        /// The file.
        path: PathBuf,
        /// Index of the Gaussian.
        gaussian: usize,
        /// The property, as the file names it.
        property: String,
        /// Its value.
        found: String,
        /// What it should be.
        expected: String,
    },
    /// Arrays to be saved that do not fit together.
    #[error("{}: not saved: {field} has {found} entries, expected {expected}", path.display())]
    Inconsistent {
        /// The file.
        path: PathBuf,
        /// The array.
        field: &'static str,
        /// Its length.
        found: usize,
        /// The length it should have.
        expected: usize,
    },
    /// More segments than there can be ids, or than codes.
    #[error("{}: {found} segments, expected at most {max}", path.display())]
    Segments {
        /// The file.
        path: PathBuf,
        /// Segments there are.
        found: u64,
        /// Segments there can be.
        max: u64,
    },
    /// The codebook in the file is none.
    #[error("{}: {source}", path.display())]
    Codebook {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: CodebookError,
    },
}

impl SplatFileError {
    /// For `map_err`: an error of the file system at `path`.
    pub fn io(path: &Path, action: &'static str) -> impl FnOnce(std::io::Error) -> Self {
        move |source| Self::Io { path: path.to_owned(), action, source }
    }
}
