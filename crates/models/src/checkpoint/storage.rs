//! Storages: the byte ranges of a file that contain tensor data.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::ops::Range;

/// Byte range of one storage, which contains one or more tensors. It lies within the file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Storage {
    /// Byte offset in the file.
    pub offset: u64,
    /// Length in bytes.
    pub len: u64,
    /// CRC-32 of the whole storage, if the file states it.
    pub crc32: Option<u32>,
}

impl Storage {
    /// Reads a range of the storage, which must lie within it. Verifies the checksum if the range is the whole storage.
    ///
    /// # Errors
    /// I/O errors; `InvalidData` for a wrong checksum.
    pub fn read(self, mut file: &File, range: Range<u64>) -> io::Result<Vec<u8>> {
        let len = range.end - range.start;
        file.seek(SeekFrom::Start(self.offset + range.start))?;
        let mut bytes = Vec::with_capacity(usize::try_from(len).map_err(io::Error::other)?);
        if file.take(len).read_to_end(&mut bytes)? as u64 != len {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        let stated = self.crc32.filter(|_| len == self.len);
        if stated.is_some_and(|stated| stated != crc32fast::hash(&bytes)) {
            return Err(wrong_checksum());
        }
        Ok(bytes)
    }

    /// Reads the whole storage and verifies its checksum.
    ///
    /// # Errors
    /// As for [`Storage::read`].
    pub fn verify(self, file: &File) -> io::Result<()> {
        if self.is_intact(file)? { Ok(()) } else { Err(wrong_checksum()) }
    }

    /// True if the data match the checksum, or the file states none.
    ///
    /// # Errors
    /// I/O errors.
    pub fn is_intact(self, mut file: &File) -> io::Result<bool> {
        let Some(stated) = self.crc32 else { return Ok(true) };
        file.seek(SeekFrom::Start(self.offset))?;
        let (mut hasher, mut left, mut block) = (crc32fast::Hasher::new(), self.len, vec![0; 1 << 18]);
        while left > 0 {
            let wanted = left.min(block.len() as u64) as usize;
            file.read_exact(&mut block[..wanted])?;
            hasher.update(&block[..wanted]);
            left -= wanted as u64;
        }
        Ok(hasher.finalize() == stated)
    }
}

fn wrong_checksum() -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, "damaged data (the checksum is wrong)")
}
