//! Opening and reading of scene files: regular files only, with a size limit for each kind.

use crate::DatasetError;
use splatseg_files::{MemoryLimit, display_bytes};
use std::fs::File;
use std::io::{ErrorKind, Read, Seek, SeekFrom};
use std::path::Path;
use std::sync::{Mutex, PoisonError};

/// Opens a file of a scene.
pub(crate) fn open_file(path: &Path) -> Result<File, DatasetError> {
    splatseg_files::open_file(path).map_err(|source| match source.kind() {
        ErrorKind::NotFound => DatasetError::NotFound { path: path.to_owned() },
        _ => DatasetError::Io { path: path.to_owned(), source },
    })
}

/// Reads a file of at most `limit` bytes. `what` names its content in errors.
pub(crate) fn read_file(path: &Path, what: &'static str, limit: u64) -> Result<Vec<u8>, DatasetError> {
    splatseg_files::read_file(path, limit).map_err(|source| match source.kind() {
        ErrorKind::NotFound => DatasetError::MissingFile { path: path.to_owned(), what },
        ErrorKind::FileTooLarge => {
            let bytes = std::fs::metadata(path).map_or(limit.saturating_add(1), |metadata| metadata.len());
            DatasetError::FileTooBig { path: path.to_owned(), what, bytes, limit }
        }
        _ => DatasetError::Io { path: path.to_owned(), source },
    })
}

/// Returns true if an optional file of a scene is there. Also true for a broken link and for anything that is not a
/// regular file: reading it reports the problem, which must not look like a scene without that file.
pub(crate) fn is_there(path: &Path) -> bool {
    path.symlink_metadata().is_ok()
}

/// An allocation proportional to a number of pixels.
#[derive(Clone, Copy, Debug)]
pub(crate) struct MemoryRequirement {
    /// Its name in errors.
    pub(crate) what: &'static str,
    /// `(width, height)`.
    pub(crate) size: (usize, usize),
    pub(crate) bytes_per_pixel: u64,
    /// Advice to the user.
    pub(crate) remedy: &'static str,
}

impl MemoryRequirement {
    /// Checks that the allocation is within the memory limit of the process. `path` is named in errors.
    pub(crate) fn check(&self, path: &Path) -> Result<(), DatasetError> {
        self.check_within(MemoryLimit::in_force(), path)
    }

    fn check_within(&self, limit: u64, path: &Path) -> Result<(), DatasetError> {
        let pixels = (self.size.0 as u64).saturating_mul(self.size.1 as u64);
        let needed = pixels.saturating_mul(self.bytes_per_pixel);
        if needed <= limit {
            return Ok(());
        }
        Err(DatasetError::MemoryLimit {
            path: path.to_owned(),
            what: self.what,
            size: self.size,
            needed: display_bytes(needed),
            limit: display_bytes(limit),
            remedy: self.remedy,
        })
    }
}

/// A file that can be read at any offset from any thread.
#[derive(Debug)]
pub(crate) struct RandomAccessFile {
    file: Mutex<File>,
}

impl RandomAccessFile {
    pub(crate) fn new(file: File) -> Self {
        Self { file: Mutex::new(file) }
    }

    /// Reads `len` bytes at `offset`. The caller has checked that they lie within the file.
    pub(crate) fn read(&self, offset: u64, len: u64) -> std::io::Result<Vec<u8>> {
        // A panicked reader leaves no state behind, because every read seeks first.
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        file.seek(SeekFrom::Start(offset))?;
        let mut bytes = Vec::new();
        let read = (&mut *file).take(len).read_to_end(&mut bytes)?;
        if read as u64 == len { Ok(bytes) } else { Err(ErrorKind::UnexpectedEof.into()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exceeding_the_memory_limit_is_an_error_with_advice() {
        let requirement =
            MemoryRequirement { what: "depth image", size: (8192, 8192), bytes_per_pixel: 16, remedy: "raise it" };
        assert!(requirement.check_within(1 << 30, Path::new("a.png")).is_ok());
        let error = requirement.check_within(500_000_000, Path::new("a.png")).unwrap_err();
        assert_eq!(
            error.to_string(),
            "a.png: the depth image of 8192x8192 pixels would take 1.1 GB of memory, but the limit is 500 MB: raise it"
        );
        let endless = MemoryRequirement { size: (usize::MAX, usize::MAX), ..requirement };
        assert!(endless.check_within(u64::MAX - 1, Path::new("a.png")).is_err());
    }
}
