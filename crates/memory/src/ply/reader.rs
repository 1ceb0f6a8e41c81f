//! Files to memories.

use super::error::SplatFileError;
use super::header::{self, Header};
use super::layout::Sizes;
use super::record::{self, Records};
use super::trailer::{Contents, Trailer};
use super::{CHUNK_BYTES, SplatContent, SplatFile};
use crc32fast::Hasher;
use glam::DVec3;
use splatseg_input::open_file;
use std::fs::File;
use std::io::{BufReader, Read};
use std::path::Path;

/// Reads a file from its beginning to its end, once.
pub fn load(path: &Path) -> Result<SplatFile, SplatFileError> {
    let file = open_file(path).map_err(SplatFileError::io(path, "open"))?;
    let length = file.metadata().map_err(SplatFileError::io(path, "read"))?.len();
    let mut file = BufReader::with_capacity(CHUNK_BYTES, file);
    let Header { bytes, sizes, origin } = header::read(&mut file, path)?;
    check_length(&sizes, bytes.len(), length, path)?;
    let mut input = Input { file, crc: Hasher::new(), path };
    input.crc.update(&bytes);
    let (records, outcome) = read_records(&sizes, &mut input)?;
    let trailer = Trailer::read(&sizes, &mut input)?;
    input.check_checksum()?;
    // Only now: where bytes were altered, that is the better message.
    outcome?;
    assemble(origin, records, trailer.checked(&sizes, path)?, path)
}

/// Refuses a file of another length than its header announces. Memory is taken only for what has passed here.
pub fn check_length(sizes: &Sizes, header_bytes: usize, found: u64, path: &Path) -> Result<(), SplatFileError> {
    let expected = sizes.file_bytes(header_bytes);
    if found == expected {
        return Ok(());
    }
    Err(SplatFileError::Length { path: path.to_owned(), content: sizes.description(), found, expected })
}

/// All Gaussians up to the first impossible one, and what is wrong with that. Reads to the end of the records anyway,
/// for the checksum.
fn read_records(sizes: &Sizes, input: &mut Input<'_>) -> Result<(Records, Result<(), SplatFileError>), SplatFileError> {
    let record_bytes = sizes.layout.record_bytes() as usize;
    let mut records = Records::with_capacity(sizes);
    let mut outcome = Ok(());
    let records_per_chunk = (CHUNK_BYTES / record_bytes).max(1);
    let mut chunk = Vec::new();
    let mut remaining = sizes.gaussians;
    while remaining > 0 {
        let count = remaining.min(records_per_chunk as u64) as usize;
        chunk.resize(count * record_bytes, 0);
        input.read(&mut chunk)?;
        for record in chunk.chunks_exact(record_bytes) {
            outcome = outcome.and_then(|()| record::decode(record, sizes, &mut records, input.path));
        }
        remaining -= count as u64;
    }
    Ok((records, outcome))
}

fn assemble(origin: DVec3, records: Records, contents: Contents, path: &Path) -> Result<SplatFile, SplatFileError> {
    let Records { map, votes, features, segment_ids } = records;
    let Contents { frames, codebook, ids, sightings, carried, short_term } = contents;
    record::check_last_seen(&map.last_seen, frames, path)?;
    record::check_ids(&segment_ids, &votes, &ids, path)?;
    let content = match codebook {
        None => SplatContent::Evidence { votes },
        Some(codebook) => SplatContent::Features { features, codebook },
    };
    Ok(SplatFile { origin, map, content, segment_ids, ids, sightings, carried, frames, short_term })
}

/// The file behind its header, and the checksum of what was read.
pub struct Input<'a> {
    file: BufReader<File>,
    crc: Hasher,
    path: &'a Path,
}

impl Input<'_> {
    /// Fills `bytes`.
    pub fn read(&mut self, bytes: &mut [u8]) -> Result<(), SplatFileError> {
        self.file.read_exact(bytes).map_err(SplatFileError::io(self.path, "read"))?;
        self.crc.update(bytes);
        Ok(())
    }

    /// The next `N` bytes.
    pub fn array<const N: usize>(&mut self) -> Result<[u8; N], SplatFileError> {
        let mut bytes = [0; N];
        self.read(&mut bytes)?;
        Ok(bytes)
    }

    /// The next `count` numbers of four bytes.
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

    /// Compares the checksum of all that was read with the one that follows.
    fn check_checksum(&mut self) -> Result<(), SplatFileError> {
        let found = self.crc.clone().finalize();
        let expected = u32::from_le_bytes(self.array()?);
        if found == expected {
            return Ok(());
        }
        Err(SplatFileError::Checksum { path: self.path.to_owned(), found, expected })
    }
}
