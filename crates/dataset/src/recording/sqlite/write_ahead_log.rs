//! The write-ahead log beside a database that was not closed: pages that are newer than those of the database.
//!
//! Specified in section 4 of <https://www.sqlite.org/fileformat2.html>. As in SQLite, frames count up to the last one that
//! ends a transaction; the log ends where salts or checksums are wrong.

use crate::files::RandomAccessFile;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufReader, ErrorKind, Read, Result};

const HEADER_BYTES: usize = 32;
const FRAME_HEADER_BYTES: usize = 24;
/// First number of a log; one more if its checksums are of big-endian numbers.
const MAGIC: u32 = 0x377F_0682;

/// A log with at least one whole transaction.
#[derive(Debug)]
pub(super) struct WriteAheadLog {
    file: RandomAccessFile,
    /// Offset of the newest version of each page in it.
    places: BTreeMap<u32, u64>,
    /// Number of pages of the database after the last transaction.
    pages: u32,
}

/// The result of opening a write-ahead log.
#[derive(Debug)]
pub(super) enum FoundLog {
    Log(WriteAheadLog),
    /// It has no whole transaction, so SQLite does not use it either.
    NoTransaction,
    /// It is not one of this database.
    Unreadable,
}

/// The checksum of a log up to some place.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Checksum(u32, u32);

impl WriteAheadLog {
    /// Reads which pages a log has, for a database with pages of some size.
    pub(super) fn read(file: File, page_bytes: usize) -> Result<FoundLog> {
        let mut reader = BufReader::new(&file);
        let mut header = [0; HEADER_BYTES];
        if !is_filled(&mut reader, &mut header)? {
            return Ok(FoundLog::Unreadable);
        }
        let is_big_endian = word(&header, 0) == MAGIC + 1;
        let mut checksum = Checksum::default().and(&header[..HEADER_BYTES - 8], is_big_endian);
        let is_log = is_big_endian || word(&header, 0) == MAGIC;
        if !is_log || word(&header, 8) as usize != page_bytes || checksum != Checksum::stored(&header, 24) {
            return Ok(FoundLog::Unreadable);
        }
        let (mut places, mut waiting, mut pages) = (BTreeMap::new(), Vec::new(), 0);
        let (mut frame, mut content) = ([0; FRAME_HEADER_BYTES], vec![0; page_bytes]);
        let mut offset = HEADER_BYTES as u64;
        while is_filled(&mut reader, &mut frame)? && is_filled(&mut reader, &mut content)? {
            checksum = checksum.and(&frame[..8], is_big_endian).and(&content, is_big_endian);
            let has_salts = frame.get(8..16) == header.get(16..24);
            if !has_salts || checksum != Checksum::stored(&frame, 16) {
                break;
            }
            waiting.push((word(&frame, 0), offset + FRAME_HEADER_BYTES as u64));
            let pages_if_committed = word(&frame, 4);
            if pages_if_committed > 0 {
                places.extend(waiting.drain(..));
                pages = pages_if_committed;
            }
            offset += (FRAME_HEADER_BYTES + page_bytes) as u64;
        }
        drop(reader);
        Ok(match places.is_empty() {
            true => FoundLog::NoTransaction,
            false => FoundLog::Log(Self { file: RandomAccessFile::new(file), places, pages }),
        })
    }

    /// Number of pages of a database whose file has `stored`. A larger number than that of all known pages is not believed.
    pub(super) fn pages(&self, stored: u32) -> u32 {
        let known = self.places.keys().last().copied().unwrap_or_default();
        self.pages.min(known.max(stored))
    }

    /// Returns a page of the log; `None` if it has none with that number.
    pub(super) fn page(&self, number: u32, page_bytes: usize) -> Result<Option<Vec<u8>>> {
        self.places.get(&number).map(|offset| self.file.read(*offset, page_bytes as u64)).transpose()
    }

    /// Returns the number of the first page after `number` that the log has.
    pub(super) fn next_page(&self, number: u32) -> Option<u32> {
        self.places.range(number.checked_add(1)?..).next().map(|(number, _)| *number)
    }
}

impl Checksum {
    /// The checksum with more bytes, whose number is a multiple of 8.
    fn and(self, bytes: &[u8], is_big_endian: bool) -> Self {
        let [mut first, mut second] = [self.0, self.1];
        for pair in bytes.chunks_exact(8) {
            let [a, b] = [0, 4].map(|at| if is_big_endian { word(pair, at) } else { word(pair, at).swap_bytes() });
            first = first.wrapping_add(a).wrapping_add(second);
            second = second.wrapping_add(b).wrapping_add(first);
        }
        Self(first, second)
    }

    fn stored(bytes: &[u8], at: usize) -> Self {
        Self(word(bytes, at), word(bytes, at + 4))
    }
}

/// A big-endian number of four bytes; 0 beyond the end.
fn word(bytes: &[u8], at: usize) -> u32 {
    bytes.get(at..).and_then(|rest| rest.first_chunk()).map_or(0, |bytes| u32::from_be_bytes(*bytes))
}

/// Fills a buffer; returns false if the file ends before.
fn is_filled(reader: &mut impl Read, buffer: &mut [u8]) -> Result<bool> {
    match reader.read_exact(buffer) {
        Ok(()) => Ok(true),
        Err(error) if error.kind() == ErrorKind::UnexpectedEof => Ok(false),
        Err(error) => Err(error),
    }
}
