//! Reading of memories from files.

use super::checked_stream::Input;
use super::error::SplatFileError;
use super::header::{self, Header};
use super::layout::{Layout, Sizes};
use super::record::{self, Records};
use super::trailer::{Contents, Trailer, file_bytes};
use super::{CHUNK_BYTES, CONTENT, SplatContent, SplatFile};
use splatseg_files::open_file;
use std::io::BufReader;
use std::path::Path;

/// Reads a file in one pass.
pub fn load(path: &Path) -> Result<SplatFile, SplatFileError> {
    let file = open_file(path).map_err(SplatFileError::io(path, "open"))?;
    let length = file.metadata().map_err(SplatFileError::io(path, "read"))?.len();
    let mut file = BufReader::with_capacity(CHUNK_BYTES, file);
    let header = header::read(&mut file, path)?;
    let sizes = header.sizes;
    check_length(&sizes, header.bytes.len(), length, path)?;
    let mut input = Input::new(file, &header.bytes, path);
    let (records, outcome) = read_records(&sizes, &mut input)?;
    let trailer = Trailer::read(&sizes, &mut input)?;
    input.check_checksum()?;
    // Reported only now: if bytes were altered, the checksum error is the better message.
    outcome?;
    assemble(header, records, trailer.checked(&sizes, path)?, path)
}

/// Returns an error if the length of a file differs from the length in its header. Memory is allocated only after this
/// check.
pub fn check_length(sizes: &Sizes, header_bytes: usize, found: u64, path: &Path) -> Result<(), SplatFileError> {
    let expected = file_bytes(sizes, header_bytes);
    if found == expected {
        return Ok(());
    }
    Err(SplatFileError::Length { path: path.to_owned(), content: sizes.description(), found, expected })
}

/// Reads all Gaussians up to the first invalid one, and returns its error with them. Always reads to the end of the
/// records, for the checksum.
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

fn assemble(header: Header, records: Records, contents: Contents, path: &Path) -> Result<SplatFile, SplatFileError> {
    let Records { map, votes, features, segment_ids } = records;
    let Contents { frames, codebook, ids, sightings, carried, mut saved_state } = contents;
    record::check_last_seen(&map.last_seen, frames, path)?;
    record::check_ids(&segment_ids, &votes, &ids, path)?;
    let content = match (header.sizes.layout, codebook) {
        (Layout::Arrays, _) => SplatContent::Arrays { arrays: saved_state.take_block(CONTENT) },
        (_, None) => SplatContent::Evidence { votes },
        (_, Some(codebook)) => SplatContent::Features { features, codebook },
    };
    let Header { origin, registered_kind, .. } = header;
    Ok(SplatFile { origin, map, content, registered_kind, segment_ids, ids, sightings, carried, frames, saved_state })
}
