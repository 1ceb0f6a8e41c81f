//! Settings fixed by a saved memory, read without the rest of the file.

use super::error::SplatFileError;
use super::header::{self, Header};
use super::layout::Layout;
use super::{reader, trailer};
use crate::MemoryKind;

use splatseg_files::open_file;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::Path;

/// Settings fixed by a saved memory: a run that continues it must use the same values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct SavedMemorySettings {
    /// `memory.kind`.
    pub kind: MemoryKind,
    /// `memory.feature_dim` and `memory.num_codes`; `None` for a memory without codes.
    pub codes: Option<SavedCodes>,
}

/// The settings of a saved codebook.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct SavedCodes {
    /// `memory.feature_dim`.
    pub feature_dim: usize,
    /// `memory.num_codes`: number of codes in a block.
    pub num_codes: usize,
}

impl SavedMemorySettings {
    /// Reads the header of a file written by [`SplatFileView::save`](super::SplatFileView::save), and the number of
    /// blocks of codes.
    ///
    /// # Errors
    /// [`SplatFileError`] if the file cannot be read, is another kind of PLY, or differs in length from its header, or if
    /// this program has no kind of memory with its name.
    pub fn read(path: impl AsRef<Path>) -> Result<Self, SplatFileError> {
        let path = path.as_ref();
        let file = open_file(path).map_err(SplatFileError::io(path, "open"))?;
        let length = file.metadata().map_err(SplatFileError::io(path, "open"))?.len();
        let mut file = BufReader::new(file);
        let Header { bytes, sizes, registered_kind, .. } = header::read(&mut file, path)?;
        reader::check_length(&sizes, bytes.len(), length, path)?;
        let codes = match sizes.layout {
            Layout::Evidence | Layout::Arrays => None,
            Layout::Features { feature_dim, codes } => {
                let records = sizes.gaussians * sizes.layout.record_bytes();
                let place = bytes.len() as u64 + records + trailer::BLOCKS_OFFSET;
                let mut blocks = [0; 4];
                let read = file.seek(SeekFrom::Start(place)).and_then(|_| file.read_exact(&mut blocks));
                read.map_err(SplatFileError::io(path, "read"))?;
                // A damaged number of blocks is detected when the file is loaded.
                let num_codes = codes / u64::from(u32::from_le_bytes(blocks)).max(1);
                Some(SavedCodes { feature_dim, num_codes: num_codes as usize })
            }
        };
        let kind = match registered_kind {
            // Arrays always have the name of their kind.
            None => sizes.layout.kind().unwrap_or_default(),
            Some(name) => MemoryKind::from_name(&name).ok_or_else(|| {
                let known = MemoryKind::names().join(", ");
                SplatFileError::UnknownKind { path: path.to_owned(), found: name, known }
            })?,
        };
        Ok(Self { kind, codes })
    }
}
