//! Reading of MCAP files: all records once in order, then single messages again.
//!
//! A recording is one file, or several into which it was split. Offsets count from the start of the first one. Messages
//! that rosbag2 has compressed one by one are unpacked here.
//!
//! The format is specified at <https://mcap.dev/spec>. The summary at the end is not used: a truncated recording has
//! none, and images must be found by the stamp in them, which is not in any index.

use super::chunks::{Chunk, too_large};
use super::recording_parts::{OpenPart, RecordingParts};
use super::{text_lengths, zstd};
use crate::DatasetError;
use crate::files::RandomAccessFile;
use crate::ros_topics::contents::MessagePlace;
use crate::ros_topics::frame_names::listed;
use mcap::records::{Record, op};
use splatseg_files::{MemoryLimit, display_bytes};
use std::borrow::Cow;
use std::fs::File;
use std::io::{BufReader, Read};
use std::ops::{Deref, Range};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

/// First bytes of every MCAP file.
const MAGIC: &[u8] = mcap::MAGIC;
/// Bytes of a record's code and length.
const RECORD_HEADER_BYTES: u64 = 9;
/// Bytes of a chunk's header without the name of its compression.
const CHUNK_HEADER_BYTES: u64 = 40;
/// Maximum length of a record outside chunks; longer ones are skipped. The largest image has 256 MB.
const MAX_RECORD_BYTES: u64 = 272 << 20;
const READ_BUFFER_BYTES: usize = 1 << 20;
/// Number of unpacked chunks kept: images of two topics may be in two chunks, and a second thread may use two others.
const CACHED_CHUNKS: usize = 4;
/// The messages of a file may unpack to this many times its size, and always to the second number of bytes.
const MAX_RATIO: u64 = 256;
const ALWAYS_UNPACKED_BYTES: u64 = 4 << 30;

/// Returns the maximum size of a record outside chunks, and of an unpacked message, bytes.
fn max_record_bytes() -> u64 {
    MAX_RECORD_BYTES.min(MemoryLimit::in_force() / 2)
}

/// A message found while scanning.
pub(super) struct FoundMessage<'a> {
    pub(super) channel: u16,
    /// Recording time, nanoseconds.
    pub(super) log_time: u64,
    pub(super) place: MessagePlace,
    pub(super) data: &'a [u8],
}

/// Receiver of a file's records, in order.
pub(super) trait RecordSink {
    /// Called before the records of each file: ids of schemas and channels are those of a file.
    fn start_file(&mut self);
    fn schema(&mut self, id: u16, name: &str) -> Result<(), DatasetError>;
    fn channel(&mut self, channel: mcap::records::Channel) -> Result<(), DatasetError>;
    fn message(&mut self, message: &FoundMessage<'_>) -> Result<(), DatasetError>;
}

/// A recording whose records have been scanned.
#[derive(Debug)]
pub(super) struct McapFile {
    path: PathBuf,
    /// Each with its offset in the recording, increasing.
    files: Vec<(u64, RandomAccessFile)>,
    /// The compressed chunks.
    chunks: Vec<Chunk>,
    /// How rosbag2 has compressed it, in addition to chunks.
    has_packed_files: bool,
    has_packed_messages: bool,
    cache: Mutex<Vec<(u32, Arc<Vec<u8>>)>>,
    /// Damage to the file, one line each.
    damage: Vec<String>,
}

/// Data of a message.
pub(super) struct MessageData {
    bytes: Arc<Vec<u8>>,
    range: Range<usize>,
}

impl Deref for MessageData {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        self.bytes.get(self.range.clone()).unwrap_or_default()
    }
}

impl McapFile {
    /// Reads all records of a recording into `sink`. Skips damaged parts.
    ///
    /// # Errors
    /// If a file cannot be read, is not an MCAP file, or the sink fails.
    pub(super) fn scan(recording: &RecordingParts, sink: &mut impl RecordSink) -> Result<Self, DatasetError> {
        let mut scanned = Self {
            path: recording.path.clone(),
            files: Vec::new(),
            chunks: Vec::new(),
            has_packed_files: false,
            has_packed_messages: false,
            cache: Mutex::default(),
            damage: Vec::new(),
        };
        if !recording.missing.is_empty() {
            let numbers = listed(recording.missing.iter().map(u64::to_string).collect());
            let path = recording.path.display();
            scanned.damage.push(format!("{path}: the files with these numbers are missing: {numbers}"));
        }
        let mut start = 0;
        for path in &recording.files {
            sink.start_file();
            let part = OpenPart::new(path)?;
            scanned.has_packed_files |= part.was_packed;
            scanned.damage.extend(part.damage);
            let mut scan = Scan {
                path,
                reader: BufReader::with_capacity(READ_BUFFER_BYTES, part.file),
                bytes: part.bytes,
                start,
                position: 0,
                sink,
                recording: &mut scanned,
                damaged_chunks: 0,
                damaged_messages: None,
                unpacked_bytes: 0,
                has_all_messages: false,
            };
            scan.read_all()?;
            scan.report_all();
            let file = RandomAccessFile::new(scan.reader.into_inner());
            scanned.files.push((start, file));
            start = start.saturating_add(part.bytes);
        }
        Ok(scanned)
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// Returns the damage to the files, one line each.
    pub(super) fn damage(&self) -> &[String] {
        &self.damage
    }

    /// Returns how rosbag2 has compressed it; `None` if it has not.
    pub(super) fn compression(&self) -> Option<&'static str> {
        match (self.has_packed_files, self.has_packed_messages) {
            (false, false) => None,
            (true, false) => Some("zstd, each file"),
            (false, true) => Some("zstd, each message"),
            (true, true) => Some("zstd, each file and each message"),
        }
    }

    /// Reads bytes at an offset in the recording.
    fn read_at(&self, offset: u64, len: u64) -> std::io::Result<Vec<u8>> {
        let index = self.files.partition_point(|(start, _)| *start <= offset);
        let part = index.checked_sub(1).and_then(|index| self.files.get(index));
        let (start, file) = part.ok_or(std::io::ErrorKind::UnexpectedEof)?;
        file.read(offset - start, len)
    }

    /// Reads the data of a message.
    ///
    /// # Errors
    /// If the file cannot be read, or has changed since it was opened.
    pub(super) fn read(&self, place: MessagePlace) -> Result<MessageData, DatasetError> {
        let io_error = |source| DatasetError::Io { path: self.path.clone(), source };
        let stored = match place.chunk {
            None => {
                let bytes = self.read_at(place.offset, place.len).map_err(io_error)?;
                MessageData { range: 0..bytes.len(), bytes: Arc::new(bytes) }
            }
            Some(chunk) => {
                let start = place.offset as usize;
                MessageData { bytes: self.unpacked(chunk)?, range: start..start + place.len as usize }
            }
        };
        if !stored.starts_with(zstd::MAGIC) {
            return Ok(stored);
        }
        let bytes = zstd::unpack_message(&stored, max_record_bytes()).map_err(|found| DatasetError::Field {
            path: self.path.clone(),
            field: "compressed message".to_owned(),
            found,
            expected: "the same content as when the recording was opened".to_owned(),
        })?;
        Ok(MessageData { range: 0..bytes.len(), bytes: Arc::new(bytes) })
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

/// State while scanning all records.
struct Scan<'a, S> {
    path: &'a Path,
    reader: BufReader<File>,
    /// Size of the file.
    bytes: u64,
    /// Offset of the file in the recording.
    start: u64,
    /// Offset of the next record in the file.
    position: u64,
    sink: &'a mut S,
    /// The recording, to which chunks and damage are added.
    recording: &'a mut McapFile,
    damaged_chunks: usize,
    /// Number of compressed messages that cannot be unpacked, and why the first cannot.
    damaged_messages: Option<(u64, String)>,
    /// Size of all messages that were unpacked one by one.
    unpacked_bytes: u64,
    has_all_messages: bool,
}

impl<S: RecordSink> Scan<'_, S> {
    /// Adds lines about what is damaged more than once.
    fn report_all(&mut self) {
        let path = self.path.display();
        if self.damaged_chunks > 1 {
            self.recording.damage.push(format!("{path}: {} more chunks are damaged", self.damaged_chunks - 1));
        }
        if let Some((count, first)) = &self.damaged_messages {
            let what = if *count == 1 { "message is" } else { "messages are" };
            self.recording.damage.push(format!("{path}: {count} compressed {what} damaged and left out: {first}"));
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
        let start = self.read_bytes(self.bytes.min(MAGIC.len() as u64))?;
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
        let left = self.bytes - self.position;
        if left < RECORD_HEADER_BYTES {
            self.report_truncation(self.position + RECORD_HEADER_BYTES);
            return Ok(false);
        }
        let header = self.read_bytes(RECORD_HEADER_BYTES)?;
        let (code, len) = record_header(&header).unwrap_or_default();
        let end = self.position.saturating_add(RECORD_HEADER_BYTES).saturating_add(len);
        if end > self.bytes {
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
            let content = self.start.saturating_add(self.position).saturating_add(RECORD_HEADER_BYTES);
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
        let fits = len <= max_record_bytes();
        if !fits {
            let (path, position) = (self.path.display(), self.position);
            let line = format!("{path}: the record at byte {position} of {len} bytes is too long to be read");
            self.recording.damage.push(line);
        }
        fits
    }

    /// Records that the file ends before the messages do.
    fn report_truncation(&mut self, end: u64) {
        if self.has_all_messages {
            return;
        }
        self.recording.damage.push(format!(
            "{}: the recording was not finished: the record at byte {} would end at byte {end}, but the file has {} bytes; \
             reading stops there",
            self.path.display(),
            self.position,
            self.bytes
        ));
    }

    fn report_damaged_chunk(&mut self, what: &str) {
        if self.damaged_chunks == 0 {
            let (path, position) = (self.path.display(), self.position);
            self.recording.damage.push(format!("{path}: the chunk at byte {position} is damaged and left out: {what}"));
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
                let index = u32::try_from(self.recording.chunks.len()).ok();
                self.recording.chunks.push(chunk);
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

    /// Returns a message as it was before rosbag2 compressed it; `None` if it is damaged.
    ///
    /// # Errors
    /// If all messages together would unpack to far more than those of recordings do.
    fn unpacked_message<'m>(&mut self, stored: Cow<'m, [u8]>) -> Result<Option<Cow<'m, [u8]>>, DatasetError> {
        if !stored.starts_with(zstd::MAGIC) {
            return Ok(Some(stored));
        }
        match zstd::unpack_message(&stored, max_record_bytes()) {
            Ok(data) => {
                self.unpacked_bytes = self.unpacked_bytes.saturating_add(data.len() as u64);
                self.recording.has_packed_messages = true;
                let limit = self.bytes.saturating_mul(MAX_RATIO).saturating_add(ALWAYS_UNPACKED_BYTES);
                if self.unpacked_bytes > limit {
                    return Err(DatasetError::Field {
                        path: self.path.to_owned(),
                        field: "compressed messages".to_owned(),
                        found: format!("more than {} in a file of {}", display_bytes(limit), display_bytes(self.bytes)),
                        expected: "a recording, which no compression makes that small".to_owned(),
                    });
                }
                Ok(Some(Cow::Owned(data)))
            }
            Err(what) => {
                let (count, _) = self.damaged_messages.get_or_insert((0, what));
                *count += 1;
                Ok(None)
            }
        }
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
        match mcap::parse_record(code, body) {
            Ok(Record::Schema { header, .. }) => self.sink.schema(header.id, &header.name),
            Ok(Record::Channel(channel)) => self.sink.channel(channel),
            Ok(Record::Message { header, data }) => {
                let len = data.len() as u64;
                let place = MessagePlace { offset: place.offset + (place.len - len), len, ..place };
                let (channel, log_time) = (header.channel_id, header.log_time);
                let Some(data) = self.unpacked_message(data)? else { return Ok(()) };
                self.sink.message(&FoundMessage { channel, log_time, place, data: &data })
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
    match mcap::parse_record(op::CHUNK, record) {
        Ok(Record::Chunk { header, data: Cow::Borrowed(stored) }) => {
            let header_bytes = CHUNK_HEADER_BYTES.saturating_add(header.compression.len() as u64);
            Ok((Chunk::new(&header, content.saturating_add(header_bytes))?, stored))
        }
        Ok(_) => Err("its header is damaged".to_owned()),
        Err(error) => Err(format!("its header is damaged: {error}")),
    }
}
