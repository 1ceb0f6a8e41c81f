//! Files in which messages lie in one piece, in chunks or not, and reading them again.

use super::chunks::Chunk;
use crate::DatasetError;
use crate::files::RandomAccessFile;
use crate::ros_topics::contents::MessagePlace;
use std::ops::{Deref, Range};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

/// Number of unpacked chunks kept: images of two topics may be in two chunks, and a second thread may use two others.
const CACHED_CHUNKS: usize = 4;

/// The files of a recording, one after the other. Offsets count from the start of the first one.
#[derive(Debug)]
pub(super) struct ChunkedFiles {
    path: PathBuf,
    /// Each with its offset in the recording, increasing.
    files: Vec<(u64, RandomAccessFile)>,
    /// The compressed chunks.
    chunks: Vec<Chunk>,
    cache: Mutex<Vec<(u32, Arc<Vec<u8>>)>>,
}

/// Data of a message.
pub(super) struct MessageData {
    bytes: Arc<Vec<u8>>,
    range: Range<usize>,
}

impl From<Vec<u8>> for MessageData {
    fn from(bytes: Vec<u8>) -> Self {
        Self { range: 0..bytes.len(), bytes: Arc::new(bytes) }
    }
}

impl Deref for MessageData {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        self.bytes.get(self.range.clone()).unwrap_or_default()
    }
}

impl ChunkedFiles {
    /// Creates a recording without files. `path` is named in errors.
    pub(super) fn new(path: &Path) -> Self {
        Self { path: path.to_owned(), files: Vec::new(), chunks: Vec::new(), cache: Mutex::default() }
    }

    /// Adds a file that begins at an offset in the recording.
    pub(super) fn add_file(&mut self, start: u64, file: RandomAccessFile) {
        self.files.push((start, file));
    }

    /// Adds a compressed chunk. Returns its number.
    pub(super) fn add(&mut self, chunk: Chunk) -> Option<u32> {
        let number = u32::try_from(self.chunks.len()).ok();
        self.chunks.push(chunk);
        number
    }

    /// Reads bytes at an offset in the recording.
    fn read_at(&self, offset: u64, len: u64) -> std::io::Result<Vec<u8>> {
        let index = self.files.partition_point(|(start, _)| *start <= offset);
        let part = index.checked_sub(1).and_then(|index| self.files.get(index));
        let (start, file) = part.ok_or(std::io::ErrorKind::UnexpectedEof)?;
        file.read(offset - start, len)
    }

    /// Reads the data at a place, as they are stored there.
    ///
    /// # Errors
    /// If the file cannot be read, or has changed since it was opened.
    pub(super) fn read(&self, place: MessagePlace) -> Result<MessageData, DatasetError> {
        match place.chunk {
            None => {
                let bytes = self.read_at(place.offset, place.len);
                bytes.map(MessageData::from).map_err(|source| DatasetError::Io { path: self.path.clone(), source })
            }
            Some(chunk) => {
                let start = place.offset as usize;
                Ok(MessageData { bytes: self.unpacked(chunk)?, range: start..start + place.len as usize })
            }
        }
    }

    /// Returns the content of a chunk. Other threads wait while it is unpacked, because they most likely want the same
    /// one.
    fn unpacked(&self, index: u32) -> Result<Arc<Vec<u8>>, DatasetError> {
        let changed = |found: String| DatasetError::Field {
            path: self.path.clone(),
            field: format!("chunk {index}"),
            found,
            expected: "the same content as when the recording was opened".to_owned(),
        };
        let mut cache = self.cache.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(at) = cache.iter().position(|(known, _)| *known == index) {
            let entry = cache.remove(at);
            cache.push(entry);
        } else {
            let chunk = self.chunks.get(index as usize).ok_or_else(|| changed("no such chunk".to_owned()))?;
            let stored = self.read_at(chunk.offset, chunk.stored);
            let stored = stored.map_err(|source| DatasetError::Io { path: self.path.clone(), source })?;
            let content = Arc::new(chunk.unpack(&stored).map_err(changed)?.into_owned());
            if cache.len() >= CACHED_CHUNKS {
                cache.remove(0);
            }
            cache.push((index, content));
        }
        cache.last().map(|(_, content)| Arc::clone(content)).ok_or_else(|| changed("nothing".to_owned()))
    }
}
