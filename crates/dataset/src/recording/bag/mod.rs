//! Bags of ROS 1, version 2.0 (<https://wiki.ros.org/Bags/Format/2.0>).
//!
//! Records are read one after the other, not by the index, which a bag that was not closed has not. An uncompressed chunk
//! is read like records outside chunks, so that one that was cut off is read as far as it goes. Messages are converted to
//! CDR (`transcoder.rs`), by the definition of their type that the bag carries (`definitions.rs`); those of Orbbec's SDK have
//! a converter of their own (`orbbec.rs`).

mod definitions;
mod orbbec;
mod records;
mod transcoder;

use super::chunked_files::ChunkedFiles;
use super::chunks::{Chunk, Compression, too_large};
use super::container::{Channel, FoundMessage, RecordSink, max_message_bytes};
use super::recorded_file::ScannedFile;
use crate::DatasetError;
use crate::ros_topics::contents::MessagePlace;
use records::{Fields, Header, LENGTH_BYTES, op, split_record};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufReader, Read};
use transcoder::Transcoder;

/// First bytes of every bag.
const MAGIC: &[u8] = b"#ROSBAG V2.0\n";
const READ_BUFFER_BYTES: usize = 1 << 20;
/// Maximum length of a record's header, and of the data of a connection, which hold the definition of a type.
const MAX_HEADER_BYTES: u64 = 1 << 16;
const MAX_CONNECTION_BYTES: u64 = 1 << 20;
/// Memory per connection, in addition to its data.
const CONNECTION_BYTES: u64 = 4096;

/// The connections of a recording, with what converts their messages.
#[derive(Debug, Default)]
pub(super) struct Connections {
    /// By number. `None` for those whose messages are not converted.
    by_number: BTreeMap<u32, Option<Conversion>>,
    orbbec: orbbec::Recorded,
}

/// How the messages of a connection are converted.
#[derive(Debug)]
enum Conversion {
    ByDefinition(Transcoder),
    OfOrbbec(orbbec::Content),
}

impl Connections {
    /// Converts a message, given its whole record.
    ///
    /// # Errors
    /// Description of the damage.
    pub(super) fn transcoded(&self, record: &[u8]) -> Result<Vec<u8>, String> {
        let (header, data, _) = split_record(record).ok_or("a record that is cut off")?;
        let number = Header::parse(header).and_then(|header| header.connection);
        let conversion = number.and_then(|number| self.by_number.get(&number)?.as_ref());
        match conversion.ok_or("a message of another topic")? {
            Conversion::ByDefinition(transcoder) => transcoder.transcode(data),
            Conversion::OfOrbbec(content) => {
                let messages = content.convert(data, &mut self.orbbec.clone())?;
                messages.into_iter().next().map(|(_, data)| data).ok_or_else(|| "no message".to_owned())
            }
        }
    }
}

/// Reads all records of a file into `sink`, adds its compressed chunks to `files` and its connections to `connections`.
/// Skips damaged parts.
///
/// # Errors
/// If the file cannot be read, is not a bag, or the sink fails.
pub(super) fn scan(
    file: &mut ScannedFile<'_>,
    (files, connections): (&mut ChunkedFiles, &mut Connections),
    sink: &mut dyn RecordSink,
) -> Result<(), DatasetError> {
    let reader = BufReader::with_capacity(READ_BUFFER_BYTES, file.reader()?);
    let mut scan = Scan { file, reader, position: 0, sink, files, connections, chunk_end: 0, damaged: 0 };
    scan.read_all()?;
    if scan.damaged > 1 {
        let line = format!("{}: {} more chunks or records are damaged", scan.file.path.display(), scan.damaged - 1);
        scan.file.damage.push(line);
    }
    Ok(())
}

/// State while scanning all records.
struct Scan<'a, 'f> {
    file: &'a mut ScannedFile<'f>,
    reader: BufReader<File>,
    /// Offset of the next byte in the file.
    position: u64,
    sink: &'a mut dyn RecordSink,
    files: &'a mut ChunkedFiles,
    connections: &'a mut Connections,
    /// End of the uncompressed chunk whose records are read.
    chunk_end: u64,
    damaged: usize,
}

impl Scan<'_, '_> {
    fn io_error(&self, source: std::io::Error) -> DatasetError {
        DatasetError::Io { path: self.file.path.to_owned(), source }
    }

    /// Reads the next bytes, which are in the file.
    fn read_bytes(&mut self, count: u64) -> Result<Vec<u8>, DatasetError> {
        let mut bytes = Vec::new();
        let read = (&mut self.reader).take(count).read_to_end(&mut bytes).map_err(|source| self.io_error(source))?;
        self.position += read as u64;
        if read as u64 == count { Ok(bytes) } else { Err(self.io_error(std::io::ErrorKind::UnexpectedEof.into())) }
    }

    /// Goes on at an offset.
    fn skip_to(&mut self, position: u64) -> Result<(), DatasetError> {
        let distance = position as i64 - self.position as i64;
        self.reader.seek_relative(distance).map_err(|source| self.io_error(source))?;
        self.position = position;
        Ok(())
    }

    fn left(&self) -> u64 {
        self.file.bytes.saturating_sub(self.position)
    }

    /// Notes a damaged chunk or record.
    fn report(&mut self, what: &str) {
        if self.damaged == 0 {
            self.file.damage.push(format!("{}: {what}", self.file.path.display()));
        }
        self.damaged += 1;
    }

    fn read_all(&mut self) -> Result<(), DatasetError> {
        let start = self.read_bytes(self.file.bytes.min(MAGIC.len() as u64))?;
        if start != MAGIC {
            let found = match start.as_slice() {
                [] => "an empty file".to_owned(),
                start => format!("{:?}", start.escape_ascii().to_string()),
            };
            return Err(DatasetError::Field {
                path: self.file.path.to_owned(),
                field: "first bytes".to_owned(),
                found,
                expected: format!("{:?}, the start of every bag of ROS 1", MAGIC.escape_ascii().to_string()),
            });
        }
        while self.left() > 0 {
            let start = self.position;
            if self.read_record(start)? {
                continue;
            }
            // A chunk is skipped; outside chunks nothing says where the next record begins.
            if self.chunk_end <= start || self.chunk_end > self.file.bytes {
                break;
            }
            self.skip_to(self.chunk_end)?;
        }
        Ok(())
    }

    /// Reads the length of a part of a record that begins at `start`; `None` if the part is not whole, which is reported.
    fn read_length(&mut self, start: u64) -> Result<Option<u64>, DatasetError> {
        let length = if self.left() < LENGTH_BYTES {
            LENGTH_BYTES
        } else {
            let bytes = self.read_bytes(LENGTH_BYTES)?;
            u64::from(bytes.first_chunk().map_or(0, |bytes| u32::from_le_bytes(*bytes)))
        };
        if length <= self.left() {
            return Ok(Some(length));
        }
        let (path, end, bytes) = (self.file.path.display(), self.position + length, self.file.bytes);
        self.file.damage.push(format!(
            "{path}: the recording was not finished: the record at byte {start} would end at byte {end} or later, but the \
             file has {bytes} bytes; reading stops there"
        ));
        Ok(None)
    }

    /// Reads the record at `start`. Returns `false` if it is damaged.
    fn read_record(&mut self, start: u64) -> Result<bool, DatasetError> {
        let Some(header_bytes) = self.read_length(start)? else { return Ok(false) };
        if header_bytes > MAX_HEADER_BYTES {
            self.report(&format!("the record at byte {start} has a header of {header_bytes} bytes: it is damaged"));
            return Ok(false);
        }
        let header = self.read_bytes(header_bytes)?;
        let Some(header) = Header::parse(&header) else {
            self.report(&format!("the header of the record at byte {start} is damaged"));
            return Ok(false);
        };
        let is_plain_chunk = header.op == op::CHUNK && header.compression.is_none_or(|name| name == b"none");
        if is_plain_chunk {
            return self.enter_chunk(start);
        }
        let Some(bytes) = self.read_length(start)? else { return Ok(false) };
        let end = self.position + bytes;
        let limit = match header.op {
            op::CONNECTION => MAX_CONNECTION_BYTES,
            op::MESSAGE => max_message_bytes(),
            _ => u64::MAX,
        };
        if bytes > limit {
            self.report(&format!("the record at byte {start} of {bytes} bytes is too long to be read"));
        } else {
            self.process_record(start, &header, bytes)?;
        }
        if self.position != end {
            self.skip_to(end)?;
        }
        Ok(true)
    }

    /// Goes on with the records of an uncompressed chunk.
    fn enter_chunk(&mut self, start: u64) -> Result<bool, DatasetError> {
        if self.left() < LENGTH_BYTES {
            return self.read_length(start).map(|length| length.is_some());
        }
        let bytes = self.read_bytes(LENGTH_BYTES)?;
        let bytes = u64::from(bytes.first_chunk().map_or(0, |bytes| u32::from_le_bytes(*bytes)));
        // A chunk that was not finished states no length; its records follow nonetheless.
        self.chunk_end = self.position + bytes;
        Ok(true)
    }

    /// Processes a record of the file, whose data of `bytes` bytes follow.
    fn process_record(&mut self, start: u64, header: &Header<'_>, bytes: u64) -> Result<(), DatasetError> {
        match header.op {
            op::BAG_HEADER => {
                self.skip_to(self.position + bytes)?;
                self.read_index(header.index.unwrap_or_default())
            }
            op::CONNECTION => {
                let data = self.read_bytes(bytes)?;
                self.process_connection(header, &data)
            }
            op::MESSAGE => {
                let data = self.read_bytes(bytes)?;
                let offset = self.file.start.saturating_add(start);
                let place = MessagePlace { chunk: None, offset, len: self.position - start };
                self.process_message(header, &data, place)
            }
            op::CHUNK => self.process_chunk(start, header, bytes),
            _ => Ok(()),
        }
    }

    /// Reads the connections at `index`, which repeat those in chunks: these may be damaged. Damage to them is not told.
    fn read_index(&mut self, index: u64) -> Result<(), DatasetError> {
        if index == 0 {
            let path = self.file.path.display();
            self.file.damage.push(format!("{path}: the recording was not closed: it is read without an index"));
        }
        if index <= self.position {
            return Ok(());
        }
        let back = self.position;
        self.skip_to(index.min(self.file.bytes))?;
        while let Some(header) = self.read_part(MAX_HEADER_BYTES)? {
            let Some(header) = Header::parse(&header).filter(|header| header.op == op::CONNECTION) else { break };
            let Some(data) = self.read_part(MAX_CONNECTION_BYTES)? else { break };
            self.process_connection(&header, &data)?;
        }
        self.skip_to(back)
    }

    /// Reads a length and as many bytes; `None` if they are not all there, or more than `limit`.
    fn read_part(&mut self, limit: u64) -> Result<Option<Vec<u8>>, DatasetError> {
        if self.left() < LENGTH_BYTES {
            return Ok(None);
        }
        let bytes = self.read_bytes(LENGTH_BYTES)?;
        let length = u64::from(bytes.first_chunk().map_or(0, |bytes| u32::from_le_bytes(*bytes)));
        if length > limit.min(self.left()) { Ok(None) } else { self.read_bytes(length).map(Some) }
    }

    /// Processes a compressed chunk, whose stored bytes follow.
    fn process_chunk(&mut self, start: u64, header: &Header<'_>, bytes: u64) -> Result<(), DatasetError> {
        let damaged = |what: &str| format!("the chunk at byte {start} is damaged and left out: {what}");
        let compression = match header.compression {
            Some(b"lz4") => Compression::Lz4,
            Some(b"bz2") => Compression::Bz2,
            other => {
                let name = other.unwrap_or_default().escape_ascii().to_string();
                let what = format!("the compression {name:?} is not supported, only lz4 and bz2 are");
                self.report(&damaged(&what));
                return Ok(());
            }
        };
        let offset = self.file.start.saturating_add(self.position);
        let unpacked = header.size.unwrap_or_default().into();
        let chunk = Chunk { offset, stored: bytes, unpacked, crc: 0, compression };
        if let Some(what) = too_large(bytes).or_else(|| too_large(unpacked)) {
            self.report(&damaged(&what));
            return Ok(());
        }
        let stored = self.read_bytes(bytes)?;
        match chunk.unpack(&stored) {
            Ok(content) => {
                self.file.unpacking.count(content.len() as u64)?;
                let number = self.files.add(chunk);
                self.process_records(&content, number, start)
            }
            Err(what) => {
                self.report(&damaged(&what));
                Ok(())
            }
        }
    }

    /// Processes the records in an unpacked chunk. `start` is its place in the file, for messages.
    fn process_records(&mut self, content: &[u8], chunk: Option<u32>, start: u64) -> Result<(), DatasetError> {
        let mut rest = content;
        while !rest.is_empty() {
            let record =
                split_record(rest).and_then(|(header, data, after)| Some((Header::parse(header)?, data, after)));
            let Some((header, data, after)) = record else {
                self.report(&format!("the chunk at byte {start} is damaged: a record in it cannot be read"));
                return Ok(());
            };
            let offset = (content.len() - rest.len()) as u64;
            let place = MessagePlace { chunk, offset, len: (rest.len() - after.len()) as u64 };
            match header.op {
                op::CONNECTION => self.process_connection(&header, data)?,
                op::MESSAGE => self.process_message(&header, data, place)?,
                _ => {}
            }
            rest = after;
        }
        Ok(())
    }

    fn process_connection(&mut self, header: &Header<'_>, data: &[u8]) -> Result<(), DatasetError> {
        let (Some(number), Some(topic)) = (header.connection, header.topic) else {
            self.report("a connection without a number or topic is damaged");
            return Ok(());
        };
        if self.connections.by_number.contains_key(&number) {
            return Ok(());
        }
        self.sink.hold(data.len() as u64 + CONNECTION_BYTES)?;
        let value = |wanted: &[u8]| {
            let found = Fields(data).flatten().find(|(name, _)| *name == wanted);
            found.map(|(_, value)| String::from_utf8_lossy(value).into_owned()).unwrap_or_default()
        };
        let (type_name, definition) = (value(b"type"), value(b"message_definition"));
        let topic = String::from_utf8_lossy(topic);
        if let Some(content) = orbbec::Content::of(&topic, &type_name, &definition) {
            self.connections.by_number.insert(number, Some(Conversion::OfOrbbec(content)));
            for (added, topic, type_name) in content.channels(&topic) {
                let id = u64::from(number) + added;
                self.sink.channel(&Channel { id, topic: &topic, type_name, encoding: "cdr" })?;
            }
            return Ok(());
        }
        let transcoder = Transcoder::new(&type_name, &definition);
        let (type_name, encoding) = match &transcoder {
            Some(Ok(transcoder)) => (transcoder.type_name().to_owned(), "cdr".to_owned()),
            Some(Err(what)) => (type_name, format!("ros1, {what}")),
            None => (type_name, "ros1".to_owned()),
        };
        let conversion = transcoder.and_then(Result::ok).map(Conversion::ByDefinition);
        self.connections.by_number.insert(number, conversion);
        self.sink.channel(&Channel { id: number.into(), topic: &topic, type_name: &type_name, encoding: &encoding })
    }

    /// Processes a message, whose record is at `place`.
    fn process_message(&mut self, header: &Header<'_>, data: &[u8], place: MessagePlace) -> Result<(), DatasetError> {
        let (Some(number), Some(log_time)) = (header.connection, header.time) else {
            self.report("a message without a number or time is damaged");
            return Ok(());
        };
        let converted = match self.connections.by_number.get(&number).and_then(Option::as_ref) {
            // Nothing is kept of messages that are not converted.
            None => Ok(vec![(0, Vec::new())]),
            Some(Conversion::ByDefinition(transcoder)) => transcoder.transcode(data).map(|data| vec![(0, data)]),
            Some(Conversion::OfOrbbec(content)) => content.convert(data, &mut self.connections.orbbec),
        };
        let mut pass = |added: u64, data: Result<&[u8], &str>| {
            self.sink.message(&FoundMessage { channel: u64::from(number) + added, log_time, place, data })
        };
        match converted {
            Ok(messages) => messages.iter().try_for_each(|(added, data)| pass(*added, Ok(data))),
            Err(error) => pass(0, Err(&error)),
        }
    }
}
