//! The records of an MCAP file, read in order once, and its messages, read again one by one.
//!
//! The format is that of <https://mcap.dev/spec>. The summary at the end is not used: a recording that was cut off has
//! none, and images must be found by the stamp in them, which no index has.

use super::chunks::Chunk;
use super::text_lengths;
use crate::DatasetError;
use crate::files::{RandomAccessFile, open_file};
use mcap::records::{Record, op};
use splatseg_input::MemoryLimit;
use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::ops::{Deref, Range};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

/// What every MCAP file begins with.
const MAGIC: &[u8] = mcap::MAGIC;
/// A record's code, and its length.
const RECORD_HEADER_BYTES: u64 = 9;
/// A chunk's header without the name of its compression.
const CHUNK_HEADER_BYTES: u64 = 40;
/// No name of a compression is longer.
const MAX_COMPRESSION_NAME: u64 = 64;
/// Longer records outside chunks are skipped. The largest image has 256 MB.
const MAX_RECORD_BYTES: u64 = 272 << 20;
const READ_BUFFER_BYTES: usize = 1 << 20;
/// How many unpacked chunks are kept: images of two topics may be in two chunks, and a second thread in two others.
const CACHED_CHUNKS: usize = 4;

/// Where the data of a message are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct MessagePlace {
    /// The compressed chunk that they are in; `None` for data that are in the file as they are.
    chunk: Option<u32>,
    /// Where they begin, in the chunk or in the file.
    offset: u64,
    len: u64,
}

/// A message as it is found.
pub(super) struct FoundMessage<'a> {
    pub(super) channel: u16,
    /// When it was recorded, nanoseconds.
    pub(super) log_time: u64,
    pub(super) place: MessagePlace,
    pub(super) data: &'a [u8],
}

/// Takes the records of a file, in order.
pub(super) trait RecordSink {
    fn schema(&mut self, id: u16, name: &str) -> Result<(), DatasetError>;
    fn channel(&mut self, channel: mcap::records::Channel) -> Result<(), DatasetError>;
    fn message(&mut self, message: &FoundMessage<'_>) -> Result<(), DatasetError>;
}

/// A file whose records have been read once.
#[derive(Debug)]
pub(super) struct McapFile {
    path: PathBuf,
    file: RandomAccessFile,
    /// The compressed chunks.
    chunks: Vec<Chunk>,
    cache: Mutex<Vec<(u32, Arc<Vec<u8>>)>>,
    /// What is wrong with the file, one line each.
    damage: Vec<String>,
}

/// The data of a message.
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
    /// Reads all records of a file into `sink`. What is damaged is left out.
    ///
    /// # Errors
    /// If the file cannot be read, is no MCAP file, or if the sink fails.
    pub(super) fn scan(path: &Path, sink: &mut impl RecordSink) -> Result<Self, DatasetError> {
        let mut scan = Scan::new(path, sink)?;
        scan.read_all()?;
        let (chunks, mut damage) = (scan.chunks, scan.damage);
        if scan.damaged_chunks > 1 {
            damage.push(format!("{}: {} more chunks are damaged", path.display(), scan.damaged_chunks - 1));
        }
        let file = RandomAccessFile::new(open_file(path)?);
        Ok(Self { path: path.to_owned(), file, chunks, cache: Mutex::default(), damage })
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// What is wrong with the file, one line each.
    pub(super) fn damage(&self) -> &[String] {
        &self.damage
    }

    /// The data of a message.
    ///
    /// # Errors
    /// If the file cannot be read, or is no longer what it was.
    pub(super) fn read(&self, place: MessagePlace) -> Result<MessageData, DatasetError> {
        let io_error = |source| DatasetError::Io { path: self.path.clone(), source };
        let Some(chunk) = place.chunk else {
            let bytes = self.file.read(place.offset, place.len).map_err(io_error)?;
            return Ok(MessageData { range: 0..bytes.len(), bytes: Arc::new(bytes) });
        };
        let start = place.offset as usize;
        Ok(MessageData { bytes: self.unpacked(chunk)?, range: start..start + place.len as usize })
    }

    /// The content of a chunk. While it is unpacked, others wait, as they most likely want the same one.
    fn unpacked(&self, index: u32) -> Result<Arc<Vec<u8>>, DatasetError> {
        let changed = |found: String| DatasetError::Field {
            path: self.path.clone(),
            field: format!("chunk {index}"),
            found,
            expected: "what it held when the recording was opened".to_owned(),
        };
        let mut cache = self.cache.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(at) = cache.iter().position(|(known, _)| *known == index) {
            let entry = cache.remove(at);
            cache.push(entry);
        } else {
            let chunk = self.chunks.get(index as usize).ok_or_else(|| changed("no such chunk".to_owned()))?;
            let stored = self.file.read(chunk.offset, chunk.stored);
            let stored = stored.map_err(|source| DatasetError::Io { path: self.path.clone(), source })?;
            let content = Arc::new(chunk.unpack(stored).map_err(changed)?);
            if cache.len() >= CACHED_CHUNKS {
                cache.remove(0);
            }
            cache.push((index, content));
        }
        cache.last().map(|(_, content)| Arc::clone(content)).ok_or_else(|| changed("nothing".to_owned()))
    }
}

/// The reading of all records.
struct Scan<'a, S> {
    path: &'a Path,
    reader: BufReader<File>,
    /// Size of the file.
    bytes: u64,
    /// Where the next record begins.
    position: u64,
    sink: &'a mut S,
    chunks: Vec<Chunk>,
    damage: Vec<String>,
    damaged_chunks: usize,
    has_all_messages: bool,
}

impl<'a, S: RecordSink> Scan<'a, S> {
    fn new(path: &'a Path, sink: &'a mut S) -> Result<Self, DatasetError> {
        let file = open_file(path)?;
        let bytes = file.metadata().map_err(|source| DatasetError::Io { path: path.to_owned(), source })?.len();
        let reader = BufReader::with_capacity(READ_BUFFER_BYTES, file);
        Ok(Self {
            path,
            reader,
            bytes,
            position: 0,
            sink,
            chunks: Vec::new(),
            damage: Vec::new(),
            damaged_chunks: 0,
            has_all_messages: false,
        })
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
                expected: format!("{:?}, with which MCAP files begin", MAGIC.escape_ascii().to_string()),
            });
        }
        self.position = MAGIC.len() as u64;
        while self.read_record()? {}
        Ok(())
    }

    /// Reads the next record outside chunks; `false` at the end of the messages.
    fn read_record(&mut self) -> Result<bool, DatasetError> {
        let left = self.bytes - self.position;
        if left < RECORD_HEADER_BYTES {
            self.note_end(self.position + RECORD_HEADER_BYTES);
            return Ok(false);
        }
        let header = self.read_bytes(RECORD_HEADER_BYTES)?;
        let (code, len) = record_header(&header).unwrap_or_default();
        let end = self.position.saturating_add(RECORD_HEADER_BYTES).saturating_add(len);
        if end > self.bytes {
            self.note_end(end);
            return Ok(false);
        }
        let content = self.position + RECORD_HEADER_BYTES;
        match code {
            op::FOOTER => return Ok(false),
            // The summary follows. It repeats topics, and has those without messages.
            op::DATA_END => self.has_all_messages = true,
            op::CHUNK => self.read_chunk(content, len)?,
            op::SCHEMA | op::CHANNEL | op::MESSAGE if len <= MAX_RECORD_BYTES.min(MemoryLimit::in_force() / 2) => {
                let bytes = self.read_bytes(len)?;
                self.take_record(code, &bytes, (None, content))?;
            }
            op::SCHEMA | op::CHANNEL | op::MESSAGE => {
                self.damage.push(format!(
                    "{}: the record at byte {} of {len} bytes is too long to be read",
                    self.path.display(),
                    self.position
                ));
            }
            _ => {}
        }
        self.position = end;
        // Wherever reading has ended.
        self.reader.seek(SeekFrom::Start(end)).map_err(|source| self.io_error(source))?;
        Ok(true)
    }

    /// Notes that the file ends before the messages do.
    fn note_end(&mut self, end: u64) {
        if self.has_all_messages {
            return;
        }
        self.damage.push(format!(
            "{}: the recording was not finished: the record at byte {} would end at byte {end}, but the file has {} bytes; \
             it is read up to there",
            self.path.display(),
            self.position,
            self.bytes
        ));
    }

    fn note_damaged_chunk(&mut self, what: &str) {
        if self.damaged_chunks == 0 {
            let (path, position) = (self.path.display(), self.position);
            self.damage.push(format!("{path}: the chunk at byte {position} is damaged and left out: {what}"));
        }
        self.damaged_chunks += 1;
    }

    /// Reads a chunk whose record has `len` bytes from `content` on.
    fn read_chunk(&mut self, content: u64, len: u64) -> Result<(), DatasetError> {
        let header = self.read_bytes(len.min(CHUNK_HEADER_BYTES + MAX_COMPRESSION_NAME))?;
        let chunk = chunk_header(&header, content).and_then(|(header_bytes, chunk)| {
            if chunk.stored <= len - header_bytes { Ok(chunk) } else { Err("it is longer than its record".to_owned()) }
        });
        let chunk = match chunk {
            Ok(chunk) => chunk,
            Err(what) => {
                self.note_damaged_chunk(&what);
                return Ok(());
            }
        };
        self.reader.seek(SeekFrom::Start(chunk.offset)).map_err(|source| self.io_error(source))?;
        let stored = self.read_bytes(chunk.stored)?;
        let content = match chunk.unpack(stored) {
            Ok(content) => content,
            Err(what) => {
                self.note_damaged_chunk(&what);
                return Ok(());
            }
        };
        let base = if chunk.is_plain() {
            (None, chunk.offset)
        } else {
            self.chunks.push(chunk);
            (u32::try_from(self.chunks.len() - 1).ok(), 0)
        };
        self.take_records(&content, base)
    }

    /// Takes the records in the content of a chunk, which begins at `base`.
    fn take_records(&mut self, content: &[u8], (chunk, start): (Option<u32>, u64)) -> Result<(), DatasetError> {
        let mut rest = content;
        while !rest.is_empty() {
            let record = record_header(rest).and_then(|(code, len)| {
                let body = rest.get(RECORD_HEADER_BYTES as usize..)?;
                Some((code, body.split_at_checked(usize::try_from(len).ok()?)?))
            });
            let Some((code, (body, after))) = record else {
                self.note_damaged_chunk("a record in it is longer than the chunk");
                return Ok(());
            };
            let offset = start + (content.len() - after.len() - body.len()) as u64;
            self.take_record(code, body, (chunk, offset))?;
            rest = after;
        }
        Ok(())
    }

    /// Takes a record whose content begins at the place.
    fn take_record(&mut self, code: u8, body: &[u8], place: (Option<u32>, u64)) -> Result<(), DatasetError> {
        if !matches!(code, op::SCHEMA | op::CHANNEL | op::MESSAGE) {
            return Ok(());
        }
        if !text_lengths::fit(code, body) {
            self.note_damaged_chunk("a text in it is longer than its record");
            return Ok(());
        }
        match mcap::parse_record(code, body) {
            Ok(Record::Schema { header, .. }) => self.sink.schema(header.id, &header.name),
            Ok(Record::Channel(channel)) => self.sink.channel(channel),
            Ok(Record::Message { header, data }) => {
                let skipped = (body.len() - data.len()) as u64;
                let place = MessagePlace { chunk: place.0, offset: place.1 + skipped, len: data.len() as u64 };
                let (channel, log_time) = (header.channel_id, header.log_time);
                self.sink.message(&FoundMessage { channel, log_time, place, data: &data })
            }
            Ok(_) => Ok(()),
            Err(error) => {
                self.note_damaged_chunk(&format!("a record in it cannot be read: {error}"));
                Ok(())
            }
        }
    }
}

/// The code and the length of a record.
fn record_header(bytes: &[u8]) -> Option<(u8, u64)> {
    let (code, rest) = bytes.split_first()?;
    Some((*code, u64::from_le_bytes(*rest.first_chunk()?)))
}

/// The chunk whose record's content begins with `bytes`, at `content` in the file, and the bytes of its header.
fn chunk_header(bytes: &[u8], content: u64) -> Result<(u64, Chunk), String> {
    let name = bytes.get(28..32).and_then(|len| Some(u64::from(u32::from_le_bytes(*len.first_chunk()?))));
    let name = name.filter(|len| *len <= MAX_COMPRESSION_NAME).ok_or("its header is cut off or damaged")?;
    let header_bytes = CHUNK_HEADER_BYTES + name;
    // `parse_record` wants the stored bytes, too: a header that says that there are none does without.
    let mut header = bytes.get(..header_bytes as usize).ok_or("its header is cut off")?.to_vec();
    let stored = header.len().checked_sub(8).and_then(|at| header.get_mut(at..)).ok_or("its header is cut off")?;
    let compressed_size = u64::from_le_bytes(*stored.first_chunk().ok_or("its header is cut off")?);
    stored.fill(0);
    match mcap::parse_record(op::CHUNK, &header) {
        Ok(Record::Chunk { mut header, .. }) => {
            header.compressed_size = compressed_size;
            Ok((header_bytes, Chunk::new(&header, content + header_bytes)?))
        }
        Ok(_) => Err("its header is damaged".to_owned()),
        Err(error) => Err(format!("its header is damaged: {error}")),
    }
}
