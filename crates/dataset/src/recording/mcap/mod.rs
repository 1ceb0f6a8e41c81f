//! Reading of MCAP files: all records once in order.
//!
//! The format is specified at <https://mcap.dev/spec>. The summary at the end is not used: a truncated recording has
//! none, and images must be found by the stamp in them, which is not in any index.

mod text_lengths;

use super::chunked_files::ChunkedFiles;
use super::chunks::{Chunk, Compression, too_large};
use super::container::{Channel, FoundMessage, RecordSink, max_message_bytes};
use super::recorded_file::ScannedFile;
use crate::DatasetError;
use crate::ros_topics::contents::MessagePlace;
use ::mcap::records::{Record, op};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufReader, Read};
use std::path::Path;

/// First bytes of every MCAP file.
const MAGIC: &[u8] = ::mcap::MAGIC;
/// Bytes of a record's code and length.
const RECORD_HEADER_BYTES: u64 = 9;
/// Bytes of a chunk's header without the name of its compression.
const CHUNK_HEADER_BYTES: u64 = 40;
const READ_BUFFER_BYTES: usize = 1 << 20;
/// Bytes that a schema takes in memory besides its name.
const SCHEMA_BYTES: u64 = 512;

/// Reads all records of a file into `sink`, and adds its compressed chunks to `chunked`. Skips damaged parts.
///
/// # Errors
/// If the file cannot be read, is not an MCAP file, or the sink fails.
pub(super) fn scan(
    file: &mut ScannedFile<'_>,
    chunked: &mut ChunkedFiles,
    sink: &mut dyn RecordSink,
) -> Result<(), DatasetError> {
    let reader = BufReader::with_capacity(READ_BUFFER_BYTES, file.reader()?);
    let mut scan = Scan {
        path: file.path,
        reader,
        file,
        position: 0,
        sink,
        chunked,
        schemas: BTreeMap::new(),
        damaged_chunks: 0,
        has_all_messages: false,
    };
    scan.read_all()?;
    scan.report_all();
    Ok(())
}

/// State while scanning all records.
struct Scan<'a, 'f> {
    path: &'a Path,
    reader: BufReader<File>,
    file: &'a mut ScannedFile<'f>,
    /// Offset of the next record in the file.
    position: u64,
    sink: &'a mut dyn RecordSink,
    /// The files of the recording, to which chunks are added.
    chunked: &'a mut ChunkedFiles,
    /// Message type of each schema.
    schemas: BTreeMap<u16, String>,
    damaged_chunks: usize,
    has_all_messages: bool,
}

impl Scan<'_, '_> {
    /// Adds a line about chunks that are damaged, if there is more than one.
    fn report_all(&mut self) {
        if self.damaged_chunks > 1 {
            let line = format!("{}: {} more chunks are damaged", self.path.display(), self.damaged_chunks - 1);
            self.file.damage.push(line);
        }
    }

    fn io_error(&self, source: std::io::Error) -> DatasetError {
        DatasetError::Io { path: self.path.to_owned(), source }
    }

    fn read_bytes(&mut self, count: u64) -> Result<Vec<u8>, DatasetError> {
        let mut bytes = Vec::new();
        let read = (&mut self.reader).take(count).read_to_end(&mut bytes).map_err(|source| self.io_error(source))?;
        if read as u64 == count { Ok(bytes) } else { Err(self.io_error(std::io::ErrorKind::UnexpectedEof.into())) }
    }

    fn read_all(&mut self) -> Result<(), DatasetError> {
        let start = self.read_bytes(self.file.bytes.min(MAGIC.len() as u64))?;
        if start != MAGIC {
            let found = if start.is_empty() {
                "an empty file".to_owned()
            } else {
                format!("{:?}", start.escape_ascii().to_string())
            };
            return Err(DatasetError::Field {
                path: self.path.to_owned(),
                field: "first bytes".to_owned(),
                found,
                expected: format!("{:?}, the start of every MCAP file", MAGIC.escape_ascii().to_string()),
            });
        }
        self.position = MAGIC.len() as u64;
        while self.read_record()? {}
        Ok(())
    }

    /// Reads the next record outside chunks. Returns `false` at the end of the messages.
    fn read_record(&mut self) -> Result<bool, DatasetError> {
        let left = self.file.bytes - self.position;
        if left < RECORD_HEADER_BYTES {
            self.report_truncation(self.position + RECORD_HEADER_BYTES);
            return Ok(false);
        }
        let header = self.read_bytes(RECORD_HEADER_BYTES)?;
        let (code, len) = record_header(&header).unwrap_or_default();
        let end = self.position.saturating_add(RECORD_HEADER_BYTES).saturating_add(len);
        if end > self.file.bytes {
            self.report_truncation(end);
            return Ok(false);
        }
        let is_read = match code {
            op::FOOTER => return Ok(false),
            // The summary follows. It repeats the topics and adds those without messages.
            op::DATA_END => {
                self.has_all_messages = true;
                false
            }
            op::CHUNK => too_large(len).map(|what| self.report_damaged_chunk(&what)).is_none(),
            op::SCHEMA | op::CHANNEL | op::MESSAGE => self.is_short_enough(len),
            _ => false,
        };
        if is_read {
            let content = self.file.start.saturating_add(self.position).saturating_add(RECORD_HEADER_BYTES);
            let record = self.read_bytes(len)?;
            match code {
                op::CHUNK => self.process_chunk(&record, content)?,
                _ => self.process_record(code, &record, MessagePlace { chunk: None, offset: content, len })?,
            }
        } else {
            let len = i64::try_from(len).unwrap_or(i64::MAX);
            self.reader.seek_relative(len).map_err(|source| self.io_error(source))?;
        }
        self.position = end;
        Ok(true)
    }

    /// Returns true if a record outside chunks can be read, which is reported otherwise.
    fn is_short_enough(&mut self, len: u64) -> bool {
        let fits = len <= max_message_bytes();
        if !fits {
            let (path, position) = (self.path.display(), self.position);
            let line = format!("{path}: the record at byte {position} of {len} bytes is too long to be read");
            self.file.damage.push(line);
        }
        fits
    }

    /// Records that the file ends before the messages do.
    fn report_truncation(&mut self, end: u64) {
        if self.has_all_messages {
            return;
        }
        self.file.damage.push(format!(
            "{}: the recording was not finished: the record at byte {} would end at byte {end}, but the file has {} bytes; \
             reading stops there",
            self.path.display(),
            self.position,
            self.file.bytes
        ));
    }

    fn report_damaged_chunk(&mut self, what: &str) {
        if self.damaged_chunks == 0 {
            let (path, position) = (self.path.display(), self.position);
            self.file.damage.push(format!("{path}: the chunk at byte {position} is damaged and left out: {what}"));
        }
        self.damaged_chunks += 1;
    }

    /// Processes a chunk, whose record begins at `content` in the recording.
    fn process_chunk(&mut self, record: &[u8], content: u64) -> Result<(), DatasetError> {
        let parsed = parsed_chunk(record, content);
        let unpacked = parsed.and_then(|(chunk, stored)| Ok((chunk, chunk.unpack(stored)?)));
        match unpacked {
            Ok((chunk, content)) if chunk.is_plain() => self.process_records(&content, None, chunk.offset),
            Ok((chunk, content)) => {
                let index = self.chunked.add(chunk);
                self.process_records(&content, index, 0)
            }
            Err(what) => {
                self.report_damaged_chunk(&what);
                Ok(())
            }
        }
    }

    /// Processes the records in a chunk's content, which begins at `start` in the recording or in the unpacked chunk.
    fn process_records(&mut self, content: &[u8], chunk: Option<u32>, start: u64) -> Result<(), DatasetError> {
        let mut rest = content;
        while !rest.is_empty() {
            let record = record_header(rest).and_then(|(code, len)| {
                let body = rest.get(RECORD_HEADER_BYTES as usize..)?;
                Some((code, body.split_at_checked(usize::try_from(len).ok()?)?))
            });
            let Some((code, (body, after))) = record else {
                self.report_damaged_chunk("a record in it is longer than the chunk");
                return Ok(());
            };
            let offset = start + (content.len() - after.len() - body.len()) as u64;
            self.process_record(code, body, MessagePlace { chunk, offset, len: body.len() as u64 })?;
            rest = after;
        }
        Ok(())
    }

    fn process_schema(&mut self, id: u16, name: String) -> Result<(), DatasetError> {
        if !self.schemas.contains_key(&id) {
            self.sink.hold(name.len() as u64 + SCHEMA_BYTES)?;
            self.schemas.insert(id, name);
        }
        Ok(())
    }

    /// Processes a record, whose content is at `place`.
    fn process_record(&mut self, code: u8, body: &[u8], place: MessagePlace) -> Result<(), DatasetError> {
        if !matches!(code, op::SCHEMA | op::CHANNEL | op::MESSAGE) {
            return Ok(());
        }
        if !text_lengths::fit(code, body) {
            self.report_damaged_chunk("a text in it is longer than its record");
            return Ok(());
        }
        match ::mcap::parse_record(code, body) {
            Ok(Record::Schema { header, .. }) => self.process_schema(header.id, header.name),
            Ok(Record::Channel(channel)) => self.sink.channel(&Channel {
                id: channel.id.into(),
                topic: &channel.topic,
                type_name: self.schemas.get(&channel.schema_id).map_or("", String::as_str),
                encoding: &channel.message_encoding,
            }),
            Ok(Record::Message { header, data }) => {
                let len = data.len() as u64;
                let place = MessagePlace { offset: place.offset + (place.len - len), len, ..place };
                let (channel, log_time) = (header.channel_id.into(), header.log_time);
                let Some(data) = self.file.unpacking.message(data)? else { return Ok(()) };
                self.sink.message(&FoundMessage { channel, log_time, place, data: Ok(&data) })
            }
            Ok(_) => Ok(()),
            Err(error) => {
                self.report_damaged_chunk(&format!("a record in it cannot be read: {error}"));
                Ok(())
            }
        }
    }
}

/// Parses the code and length of a record.
fn record_header(bytes: &[u8]) -> Option<(u8, u64)> {
    let (code, rest) = bytes.split_first()?;
    Some((*code, u64::from_le_bytes(*rest.first_chunk()?)))
}

/// Parses the record of a chunk, which begins at `content` in the recording. Also returns its stored bytes.
fn parsed_chunk(record: &[u8], content: u64) -> Result<(Chunk, &[u8]), String> {
    if !text_lengths::fit(op::CHUNK, record) {
        return Err("its header is cut off".to_owned());
    }
    match ::mcap::parse_record(op::CHUNK, record) {
        Ok(Record::Chunk { header, data: Cow::Borrowed(stored) }) => {
            let compression = match header.compression.as_str() {
                "" | "none" => Compression::None,
                "zstd" => Compression::Zstd,
                "lz4" => Compression::Lz4,
                other => return Err(format!("the compression {other:?} is not supported, only zstd and lz4 are")),
            };
            let header_bytes = CHUNK_HEADER_BYTES.saturating_add(header.compression.len() as u64);
            let chunk = Chunk {
                offset: content.saturating_add(header_bytes),
                stored: header.compressed_size,
                unpacked: header.uncompressed_size,
                crc: header.uncompressed_crc,
                compression,
            };
            Ok((chunk.checked()?, stored))
        }
        Ok(_) => Err("its header is damaged".to_owned()),
        Err(error) => Err(format!("its header is damaged: {error}")),
    }
}
