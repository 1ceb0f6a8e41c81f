//! Files to memories.

use super::crc32::Crc32;
use super::error::SplatFileError;
use super::header::{self, Header};
use super::record::{self, Records, record_bytes};
use super::{CHECKSUM_BYTES, CHUNK_BYTES, SplatFile, TRAILER_HEAD_BYTES, TRAILER_MAGIC, VERSION};
use crate::Codebook;
use std::fs::File;
use std::io::{BufReader, Read};
use std::path::Path;

/// Reads a file from its beginning to its end, once.
pub fn load(path: &Path) -> Result<SplatFile, SplatFileError> {
    let file = File::open(path).map_err(SplatFileError::io(path, "open"))?;
    let length = file.metadata().map_err(SplatFileError::io(path, "read"))?.len();
    let mut file = BufReader::with_capacity(CHUNK_BYTES, file);
    let header = header::read(&mut file, path)?;
    check_length(&header, None, length, path)?;
    let mut input = Input { file, crc: Crc32::new(), path };
    input.crc.update(&header.bytes);
    let (records, outcome) = read_records(&header, &mut input)?;
    let trailer = Trailer::read(&mut input)?;
    trailer.check(&header, path)?;
    check_length(&header, Some(trailer.codes), length, path)?;
    let vectors = read_floats(trailer.codes * header.feature_dim as u64, &mut input)?;
    input.check_checksum()?;
    // Only now: where bytes were altered, that is the better message.
    outcome?;
    assemble(records, vectors, &trailer, path)
}

/// Refuses a file too short for `header` or, once the number of codes is known, of any other length than theirs.
///
/// Memory is taken only for what has passed here.
fn check_length(header: &Header, codes: Option<u64>, found: u64, path: &Path) -> Result<(), SplatFileError> {
    let Header { gaussians, feature_dim, .. } = *header;
    let records = gaussians.checked_mul(record_bytes(feature_dim) as u64);
    let vectors = codes.unwrap_or(0).checked_mul(4 * feature_dim as u64);
    let framing = (header.bytes.len() + TRAILER_HEAD_BYTES + CHECKSUM_BYTES) as u64;
    let total = records.zip(vectors).and_then(|(records, vectors)| records.checked_add(vectors)?.checked_add(framing));
    let expected = total.unwrap_or(u64::MAX);
    if found == expected || (found > expected && codes.is_none()) {
        return Ok(());
    }
    let content = match codes {
        None => format!("{gaussians} Gaussians with features of dimension {feature_dim}, at least"),
        Some(codes) => format!("{gaussians} Gaussians and {codes} codes of dimension {feature_dim}"),
    };
    Err(SplatFileError::Length { path: path.to_owned(), content, found, expected })
}

/// All Gaussians up to the first impossible one, and what is wrong with that. Reads to the end of the records anyway,
/// for the checksum.
fn read_records(
    header: &Header,
    input: &mut Input<'_>,
) -> Result<(Records, Result<(), SplatFileError>), SplatFileError> {
    let record_bytes = record_bytes(header.feature_dim);
    let mut records = Records::with_capacity(header.gaussians as usize, header.feature_dim);
    let mut outcome = Ok(());
    let records_per_chunk = (CHUNK_BYTES / record_bytes).max(1);
    let mut chunk = Vec::new();
    let mut remaining = header.gaussians;
    while remaining > 0 {
        let count = remaining.min(records_per_chunk as u64) as usize;
        chunk.resize(count * record_bytes, 0);
        input.read(&mut chunk)?;
        for record in chunk.chunks_exact(record_bytes) {
            outcome = outcome.and_then(|()| record::decode(record, &mut records, input.path));
        }
        remaining -= count as u64;
    }
    Ok((records, outcome))
}

fn read_floats(count: u64, input: &mut Input<'_>) -> Result<Vec<f32>, SplatFileError> {
    let mut floats = Vec::with_capacity(count as usize);
    let mut chunk = Vec::new();
    let mut remaining = count;
    while remaining > 0 {
        let count = remaining.min(CHUNK_BYTES as u64 / 4) as usize;
        chunk.resize(count * 4, 0);
        input.read(&mut chunk)?;
        floats.extend(chunk.as_chunks().0.iter().map(|&bytes| f32::from_le_bytes(bytes)));
        remaining -= count as u64;
    }
    Ok(floats)
}

fn assemble(records: Records, vectors: Vec<f32>, trailer: &Trailer, path: &Path) -> Result<SplatFile, SplatFileError> {
    let Records { gaussians, colors, features, segment_ids } = records;
    let codebook = Codebook::from_vectors(trailer.feature_dim as usize, vectors, trailer.seed, trailer.blocks)
        .map_err(|source| SplatFileError::Codebook { path: path.to_owned(), source })?;
    let codes = codebook.len();
    if trailer.used_codes > codes as u64 {
        return Err(SplatFileError::UsedCodes { path: path.to_owned(), found: trailer.used_codes, codes });
    }
    for (index, &id) in segment_ids.iter().enumerate() {
        record::check_segment_id(id, codes, index, path)?;
    }
    let used_codes = trailer.used_codes as usize;
    Ok(SplatFile { gaussians, colors, features, segment_ids, codebook, used_codes })
}

/// The block behind the vertices, up to the codes.
struct Trailer {
    magic: [u8; 8],
    version: u32,
    feature_dim: u32,
    codes: u64,
    used_codes: u64,
    seed: u64,
    blocks: u32,
}

impl Trailer {
    fn read(input: &mut Input<'_>) -> Result<Self, SplatFileError> {
        Ok(Self {
            magic: input.array()?,
            version: u32::from_le_bytes(input.array()?),
            feature_dim: u32::from_le_bytes(input.array()?),
            codes: u64::from_le_bytes(input.array()?),
            used_codes: u64::from_le_bytes(input.array()?),
            seed: u64::from_le_bytes(input.array()?),
            blocks: u32::from_le_bytes(input.array()?),
        })
    }

    fn check(&self, header: &Header, path: &Path) -> Result<(), SplatFileError> {
        let text = |magic: &[u8]| format!("{:?}", String::from_utf8_lossy(magic));
        let fields = [
            ("the mark behind the vertices", text(&self.magic), text(&TRAILER_MAGIC)),
            ("the version behind the vertices", self.version.to_string(), VERSION.to_string()),
            ("the codebook's feature_dim", self.feature_dim.to_string(), header.feature_dim.to_string()),
        ];
        for (field, found, expected) in fields {
            if found != expected {
                return Err(SplatFileError::Trailer { path: path.to_owned(), field, found, expected });
            }
        }
        Ok(())
    }
}

/// The file behind its header, and the checksum of what was read.
struct Input<'a> {
    file: BufReader<File>,
    crc: Crc32,
    path: &'a Path,
}

impl Input<'_> {
    fn read(&mut self, bytes: &mut [u8]) -> Result<(), SplatFileError> {
        self.file.read_exact(bytes).map_err(SplatFileError::io(self.path, "read"))?;
        self.crc.update(bytes);
        Ok(())
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], SplatFileError> {
        let mut bytes = [0; N];
        self.read(&mut bytes)?;
        Ok(bytes)
    }

    /// Compares the checksum of all that was read with the one that follows.
    fn check_checksum(&mut self) -> Result<(), SplatFileError> {
        let found = self.crc.value();
        let expected = u32::from_le_bytes(self.array()?);
        if found == expected {
            return Ok(());
        }
        Err(SplatFileError::Checksum { path: self.path.to_owned(), found, expected })
    }
}
