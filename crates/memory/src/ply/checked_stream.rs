//! Reading and writing with a checksum of all bytes.

use super::CHUNK_BYTES;
use super::error::SplatFileError;
use crc32fast::Hasher;
use std::fs::File;
use std::io::{BufReader, BufWriter, Read, Write};
use std::path::{Path, PathBuf};

/// The file after its header, and the checksum of the bytes read.
pub struct Input<'a> {
    file: BufReader<File>,
    crc: Hasher,
    /// The file, for errors.
    pub path: &'a Path,
}

impl<'a> Input<'a> {
    /// The rest of a file whose header, `header`, was read.
    pub fn new(file: BufReader<File>, header: &[u8], path: &'a Path) -> Self {
        let mut crc = Hasher::new();
        crc.update(header);
        Self { file, crc, path }
    }

    /// Fills `bytes`.
    pub fn read(&mut self, bytes: &mut [u8]) -> Result<(), SplatFileError> {
        self.file.read_exact(bytes).map_err(SplatFileError::io(self.path, "read"))?;
        self.crc.update(bytes);
        Ok(())
    }

    /// Reads the next `N` bytes.
    pub fn array<const N: usize>(&mut self) -> Result<[u8; N], SplatFileError> {
        let mut bytes = [0; N];
        self.read(&mut bytes)?;
        Ok(bytes)
    }

    /// Reads the next `count` numbers of four bytes.
    pub fn words<T>(&mut self, count: u64, convert: fn([u8; 4]) -> T) -> Result<Vec<T>, SplatFileError> {
        let mut words = Vec::with_capacity(count as usize);
        let mut chunk = Vec::new();
        let mut remaining = count;
        while remaining > 0 {
            let count = remaining.min(CHUNK_BYTES as u64 / 4) as usize;
            chunk.resize(count * 4, 0);
            self.read(&mut chunk)?;
            words.extend(chunk.as_chunks().0.iter().map(|&bytes| convert(bytes)));
            remaining -= count as u64;
        }
        Ok(words)
    }

    /// Compares the checksum of all bytes read with the stored checksum that follows.
    pub fn check_checksum(&mut self) -> Result<(), SplatFileError> {
        let found = self.crc.clone().finalize();
        let expected = u32::from_le_bytes(self.array()?);
        if found == expected {
            return Ok(());
        }
        Err(SplatFileError::Checksum { path: self.path.to_owned(), found, expected })
    }
}

/// The file being written and the checksum of its bytes.
pub struct Output<W: Write> {
    file: BufWriter<W>,
    crc: Hasher,
    path: PathBuf,
}

impl<W: Write> Output<W> {
    /// An empty file.
    pub fn new(file: W, path: &Path) -> Self {
        Self { file: BufWriter::new(file), crc: Hasher::new(), path: path.to_owned() }
    }

    /// Appends bytes.
    pub fn write(&mut self, bytes: &[u8]) -> Result<(), SplatFileError> {
        self.crc.update(bytes);
        self.file.write_all(bytes).map_err(SplatFileError::io(&self.path, "write"))
    }

    /// Appends numbers of four bytes.
    pub fn write_words(&mut self, words: impl Iterator<Item = [u8; 4]>) -> Result<(), SplatFileError> {
        let mut chunk = Vec::with_capacity(CHUNK_BYTES);
        for word in words {
            chunk.extend(word);
            if chunk.len() >= CHUNK_BYTES {
                self.write(&chunk)?;
                chunk.clear();
            }
        }
        self.write(&chunk)
    }

    /// Writes the checksum, and everything that is still buffered.
    pub fn finish(mut self) -> Result<(), SplatFileError> {
        let checksum = self.crc.clone().finalize();
        self.write(&checksum.to_le_bytes())?;
        self.file.flush().map_err(SplatFileError::io(&self.path, "write"))
    }
}
