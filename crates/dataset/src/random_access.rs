//! Reading parts of a file from any thread.

use std::fs::File;
use std::io::{Read, Result, Seek, SeekFrom};
use std::sync::{Mutex, PoisonError};

/// A file whose parts are read from any thread.
#[derive(Debug)]
pub(crate) struct RandomAccessFile {
    file: Mutex<File>,
}

impl RandomAccessFile {
    pub(crate) fn new(file: File) -> Self {
        Self { file: Mutex::new(file) }
    }

    /// The `len` bytes from `offset` on. The caller has checked that they lie within the file.
    pub(crate) fn read(&self, offset: u64, len: u64) -> Result<Vec<u8>> {
        // A reader that panicked leaves no state behind: everyone seeks first.
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        file.seek(SeekFrom::Start(offset))?;
        let mut bytes = Vec::new();
        let read = (&mut *file).take(len).read_to_end(&mut bytes)?;
        if read as u64 == len { Ok(bytes) } else { Err(std::io::ErrorKind::UnexpectedEof.into()) }
    }
}
