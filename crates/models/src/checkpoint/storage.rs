//! The bytes in a file that tensors are made of.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::ops::Range;

/// Bytes of the file that belong to one storage, in which one or several tensors lie. They are within the file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Storage {
    /// Byte of the file at which it begins.
    pub offset: u64,
    /// Its length in bytes.
    pub len: u64,
    /// CRC-32 of all of it, where the file states one.
    pub crc32: Option<u32>,
}

impl Storage {
    /// Reads a range of it, which must be within it; if that is all of it, the checksum is verified.
    ///
    /// # Errors
    /// Those of the file system; `InvalidData` for a wrong checksum.
    pub fn read(self, mut file: &File, range: Range<u64>) -> io::Result<Vec<u8>> {
        let len = range.end - range.start;
        file.seek(SeekFrom::Start(self.offset + range.start))?;
        let mut bytes = Vec::with_capacity(usize::try_from(len).map_err(io::Error::other)?);
        if file.take(len).read_to_end(&mut bytes)? as u64 != len {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        let stated = self.crc32.filter(|_| len == self.len);
        if stated.is_some_and(|stated| stated != crc32fast::hash(&bytes)) {
            return Err(io::Error::new(io::ErrorKind::InvalidData, "damaged data (the checksum is wrong)"));
        }
        Ok(bytes)
    }
}
