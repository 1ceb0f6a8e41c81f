//! A chunk of an MCAP file: messages that are compressed together, and where each is.

use super::compression::Compression;
use super::records::{Fields, code};
use std::collections::BTreeMap;
use std::io;

/// The chunk that is being filled.
#[derive(Debug, Default)]
pub(super) struct Chunk {
    content: Vec<u8>,
    times: Times,
    /// Time and place in the content of each channel's messages, in the order in which they were written.
    messages: BTreeMap<u16, Vec<(u64, u64)>>,
}

/// The first and last time of messages, nanoseconds.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Times(Option<(u64, u64)>);

/// A chunk as it is stored.
pub(super) struct StoredChunk {
    /// The chunk's record and those of its index.
    pub(super) bytes: Vec<u8>,
    /// The record for the summary.
    pub(super) index: Vec<u8>,
}

impl Times {
    pub(super) fn add(&mut self, time: u64) {
        let (first, last) = self.0.unwrap_or((time, time));
        self.0 = Some((first.min(time), last.max(time)));
    }

    /// First and last time; 0 if there are none.
    pub(super) fn range(self) -> (u64, u64) {
        self.0.unwrap_or_default()
    }
}

impl Chunk {
    pub(super) fn is_empty(&self) -> bool {
        self.content.is_empty()
    }

    /// Number of bytes before compression.
    pub(super) fn len(&self) -> usize {
        self.content.len()
    }

    /// Adds a schema or a channel.
    pub(super) fn add_record(&mut self, record: &[u8]) {
        self.content.extend(record);
    }

    /// Adds a message with its time, nanoseconds.
    pub(super) fn add_message(&mut self, channel: u16, time: u64, data: &[u8]) {
        self.times.add(time);
        self.messages.entry(channel).or_default().push((time, self.content.len() as u64));
        let sequence = 0;
        let fields = Fields::default().u16(channel).u32(sequence).u64(time).u64(time);
        self.content.extend(fields.start_of_record(code::MESSAGE, data.len()));
        self.content.extend(data);
    }

    /// Returns the chunk for a place in the file, and leaves an empty one.
    pub(super) fn store(&mut self, compression: Compression, offset: u64) -> io::Result<StoredChunk> {
        let (first, last) = self.times.range();
        let data = compression.compress(&self.content)?;
        let fields = Fields::default().u64(first).u64(last).u64(self.content.len() as u64);
        let fields = fields.u32(crc32fast::hash(&self.content)).bytes(compression.name().as_bytes())?;
        let mut bytes = fields.u64(data.len() as u64).start_of_record(code::CHUNK, data.len());
        bytes.extend(data.iter());
        let chunk_length = bytes.len() as u64;
        let mut places = BTreeMap::new();
        for (channel, messages) in &self.messages {
            places.insert(*channel, offset + bytes.len() as u64);
            let entries: Vec<u8> =
                messages.iter().flat_map(|(time, place)| [time.to_le_bytes(), place.to_le_bytes()]).flatten().collect();
            bytes.extend(Fields::default().u16(*channel).bytes(&entries)?.record(code::MESSAGE_INDEX));
        }
        let index = Fields::default().u64(first).u64(last).u64(offset).u64(chunk_length).map(&places)?;
        let index = index.u64(bytes.len() as u64 - chunk_length).bytes(compression.name().as_bytes())?;
        let index = index.u64(data.len() as u64).u64(self.content.len() as u64).record(code::CHUNK_INDEX);
        self.content.clear();
        (self.times, self.messages) = (Times::default(), BTreeMap::new());
        Ok(StoredChunk { bytes, index })
    }
}
