//! Writing of MCAP files with compressed chunks, in one pass: <https://mcap.dev/spec>.
//!
//! The crate `mcap`, which reads them, compresses only with libraries in C.

use super::chunk::{Chunk, Times};
use super::compression::Compression;
use super::records::{Fields, code};
use crc32fast::Hasher;
use splatseg_files::AtomicFile;
use std::collections::BTreeMap;
use std::io::{self, Write};

/// First and last bytes of a file.
const MAGIC: &[u8] = b"\x89MCAP0\r\n";
/// A message starts a new chunk if the current one has more bytes before compression.
const CHUNK_BYTES: usize = 1 << 20;
/// The summary of a file that cannot grow takes the place of this many chunks at most, and one for each 1,000 chunks: the
/// summary has about 150 bytes for each.
const CHUNKS_FOR_SUMMARY: usize = 2;

/// A file: messages in chunks, each with an index, and a summary at the end that has all channels and places of chunks.
pub(super) struct McapWriter<W> {
    out: W,
    compression: Compression,
    /// Number of bytes written.
    offset: u64,
    /// CRC of the bytes written.
    crc: Hasher,
    chunk: Chunk,
    summary: Summary,
    /// The file at its beginning, and after each chunk.
    whole: Vec<WholeChunks>,
}

/// A file up to the end of a chunk: all bytes before are written.
struct WholeChunks {
    /// Number of bytes.
    offset: u64,
    /// CRC of these.
    crc: Hasher,
    /// Number of schemas and channels.
    schemas: usize,
    channels: usize,
    times: Times,
    messages: BTreeMap<u16, u64>,
}

/// A file that can be made shorter.
pub(super) trait Truncate: Write {
    /// Drops everything behind the first `bytes` bytes, which were flushed. What is written next follows them.
    fn truncate(&mut self, bytes: u64) -> io::Result<()>;
}

impl Truncate for AtomicFile {
    fn truncate(&mut self, bytes: u64) -> io::Result<()> {
        AtomicFile::truncate(self, bytes)
    }
}

/// A file that has ended before all messages were written.
#[derive(Debug)]
pub(super) struct EndedEarly<W> {
    pub(super) out: W,
    /// Number of messages in it.
    pub(super) messages: u64,
    /// True if it has its summary and its end.
    pub(super) has_summary: bool,
}

/// The summary of a file.
#[derive(Default)]
struct Summary {
    /// Schema records.
    schemas: Vec<Vec<u8>>,
    /// Channel records.
    channels: Vec<Vec<u8>>,
    /// Chunk index records.
    chunks: Vec<Vec<u8>>,
    times: Times,
    /// Number of messages of each channel.
    messages: BTreeMap<u16, u64>,
}

/// Description of a message type.
#[derive(Clone, Copy, Debug)]
pub(super) struct Schema<'a> {
    pub(super) name: &'a str,
    pub(super) encoding: &'a str,
    pub(super) text: &'a str,
}

impl<W: Write> McapWriter<W> {
    /// Starts a file with its profile, the name of the writing program, and the compression of its chunks.
    pub(super) fn new(out: W, (profile, library): (&str, &str), compression: Compression) -> io::Result<Self> {
        let (chunk, summary) = Default::default();
        let mut writer = Self { out, compression, offset: 0, crc: Hasher::new(), chunk, summary, whole: Vec::new() };
        writer.write_all(MAGIC)?;
        writer
            .write_all(&Fields::default().bytes(profile.as_bytes())?.bytes(library.as_bytes())?.record(code::HEADER))?;
        writer.note_whole()?;
        Ok(writer)
    }

    /// Adds a channel with messages of one type, and returns its id.
    ///
    /// # Errors
    /// If a file has no more ids.
    pub(super) fn add_channel(&mut self, topic: &str, schema: Schema<'_>, message_encoding: &str) -> io::Result<u16> {
        let schema_id = self.add_schema(schema)?;
        let id = new_id(&self.summary.channels)?;
        let fields = Fields::default().u16(id).u16(schema_id).bytes(topic.as_bytes())?;
        let no_metadata = b"";
        let record = fields.bytes(message_encoding.as_bytes())?.bytes(no_metadata)?.record(code::CHANNEL);
        self.chunk.add_record(&record);
        self.summary.channels.push(record);
        Ok(id)
    }

    /// Returns the id of a schema, which is written once.
    fn add_schema(&mut self, schema: Schema<'_>) -> io::Result<u16> {
        let record_with = |id: u16| -> io::Result<Vec<u8>> {
            let fields = Fields::default().u16(id).bytes(schema.name.as_bytes())?.bytes(schema.encoding.as_bytes())?;
            Ok(fields.bytes(schema.text.as_bytes())?.record(code::SCHEMA))
        };
        for (id, written) in (1..).zip(&self.summary.schemas) {
            if *written == record_with(id)? {
                return Ok(id);
            }
        }
        let id = new_id(&self.summary.schemas)?;
        let record = record_with(id)?;
        self.chunk.add_record(&record);
        self.summary.schemas.push(record);
        Ok(id)
    }

    /// Writes a message with its time, nanoseconds. The times may be in any order.
    pub(super) fn write_message(&mut self, channel: u16, time: u64, data: &[u8]) -> io::Result<()> {
        if self.chunk.len() > CHUNK_BYTES {
            self.finish_chunk()?;
        }
        self.summary.times.add(time);
        *self.summary.messages.entry(channel).or_default() += 1;
        self.chunk.add_message(channel, time, data);
        Ok(())
    }

    fn finish_chunk(&mut self) -> io::Result<()> {
        if !self.chunk.is_empty() {
            let stored = self.chunk.store(self.compression, self.offset)?;
            self.write_all(&stored.bytes)?;
            self.summary.chunks.push(stored.index);
            self.note_whole()?;
        }
        Ok(())
    }

    /// Notes that a chunk is whole once it is written.
    fn note_whole(&mut self) -> io::Result<()> {
        self.out.flush()?;
        let Summary { schemas, channels, times, messages, .. } = &self.summary;
        self.whole.push(WholeChunks {
            offset: self.offset,
            crc: self.crc.clone(),
            schemas: schemas.len(),
            channels: channels.len(),
            times: *times,
            messages: messages.clone(),
        });
        Ok(())
    }

    /// Writes the last chunk and the summary.
    pub(super) fn finish(&mut self) -> io::Result<()> {
        self.finish_chunk()?;
        self.write_end()
    }

    /// Returns the file.
    pub(super) fn into_file(self) -> W {
        self.out
    }

    /// Writes the end of the data and the summary.
    fn write_end(&mut self) -> io::Result<()> {
        let data_end = Fields::default().u32(self.crc.clone().finalize()).record(code::DATA_END);
        self.write_all(&data_end)?;
        let start = self.offset;
        self.crc = Hasher::new();
        let summary = std::mem::take(&mut self.summary);
        let offsets = self.write_summary(&summary);
        self.summary = summary;
        let (offsets, offsets_start) = (offsets?, self.offset);
        offsets.iter().try_for_each(|offset| self.write_all(offset))?;
        // The CRC of the summary is also that of the footer up to it.
        let crc_bytes = size_of::<u32>();
        let footer = Fields::default().u64(start).u64(offsets_start).start_of_record(code::FOOTER, crc_bytes);
        self.write_all(&footer)?;
        let crc = self.crc.clone().finalize();
        self.write_all(&crc.to_le_bytes())?;
        self.write_all(MAGIC)?;
        self.out.flush()
    }

    /// Writes the records of the summary, and returns those that say where each kind of them is.
    fn write_summary(&mut self, summary: &Summary) -> io::Result<Vec<Vec<u8>>> {
        let statistics = vec![summary.statistics()?];
        let groups = [
            (code::SCHEMA, &summary.schemas),
            (code::CHANNEL, &summary.channels),
            (code::STATISTICS, &statistics),
            (code::CHUNK_INDEX, &summary.chunks),
        ];
        let mut offsets = Vec::new();
        for (code, records) in groups.into_iter().filter(|(_, records)| !records.is_empty()) {
            let group = self.offset;
            records.iter().try_for_each(|record| self.write_all(record))?;
            let place = Fields::default().u8(code).u64(group).u64(self.offset - group);
            offsets.push(place.record(code::SUMMARY_OFFSET));
        }
        Ok(offsets)
    }

    fn write_all(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.out.write_all(bytes)?;
        self.offset += bytes.len() as u64;
        self.crc.update(bytes);
        Ok(())
    }
}

impl<W: Truncate> McapWriter<W> {
    /// Ends a file in which something could not be written, e.g. because the disk is full. It has the chunks that are whole,
    /// and its summary. If there is no room for that, the last chunks give theirs; if that does not help, e.g. because
    /// others write to the disk, there is no summary: readers of recordings that were cut off can read it.
    ///
    /// # Errors
    /// If the file cannot be cut, or no chunk is whole.
    pub(super) fn end_early(mut self) -> io::Result<EndedEarly<W>> {
        let chunks = self.summary.chunks.len();
        let spare = (CHUNKS_FOR_SUMMARY + chunks / 1000).min(chunks.saturating_sub(1));
        for dropped in 0..=spare {
            if dropped > 0 {
                self.whole.pop();
            }
            let messages = self.cut_to_whole_chunks()?;
            if self.write_end().is_ok() {
                return Ok(EndedEarly { out: self.out, messages, has_summary: true });
            }
        }
        let messages = self.cut_to_whole_chunks()?;
        Ok(EndedEarly { out: self.out, messages, has_summary: false })
    }

    /// Drops what was written behind the latest chunk that is whole, and returns the number of messages before.
    fn cut_to_whole_chunks(&mut self) -> io::Result<u64> {
        let chunks = self.whole.len().saturating_sub(1);
        let whole = self.whole.last().filter(|_| chunks > 0);
        let whole = whole.ok_or_else(|| io::Error::other("nothing of it is whole"))?;
        self.out.truncate(whole.offset)?;
        (self.offset, self.crc) = (whole.offset, whole.crc.clone());
        self.summary.schemas.truncate(whole.schemas);
        self.summary.channels.truncate(whole.channels);
        self.summary.chunks.truncate(chunks);
        (self.summary.times, self.summary.messages) = (whole.times, whole.messages.clone());
        Ok(self.summary.messages.values().sum())
    }
}

impl Summary {
    fn statistics(&self) -> io::Result<Vec<u8>> {
        let (first, last) = self.times.range();
        let (no_attachments, no_metadata) = (0, 0);
        let count = |records: &[Vec<u8>]| u32::try_from(records.len()).unwrap_or(u32::MAX);
        let fields = Fields::default().u64(self.messages.values().sum());
        // Ids have 16 bits, so there are no more schemas.
        let fields = fields.u16(u16::try_from(self.schemas.len()).unwrap_or(u16::MAX)).u32(count(&self.channels));
        let fields = fields.u32(no_attachments).u32(no_metadata).u32(count(&self.chunks)).u64(first).u64(last);
        Ok(fields.map(&self.messages)?.record(code::STATISTICS))
    }
}

/// The id of the next of some records. They are counted from 1.
fn new_id(records: &[Vec<u8>]) -> io::Result<u16> {
    let full = |_| io::Error::other(format!("{} types or topics of messages: an MCAP file has no more", records.len()));
    u16::try_from(records.len() + 1).map_err(full)
}

#[cfg(test)]
mod tests {
    use super::*;
    use mcap::records::{MessageHeader, Record};
    use mcap::write::NoSeek;
    use proptest::prelude::*;
    use splatseg_test_scenes::without_chunks;

    /// Topic, time and size of a message.
    type Planned = (usize, u64, usize);

    const LIBRARY: &str = "a program";
    /// Topics and their types. Two have the same one.
    const TOPICS: [(&str, &str); 3] =
        [("/a", "std_msgs/msg/String"), ("/b", "std_msgs/msg/Time"), ("/c", "std_msgs/msg/Time")];

    fn content(&(topic, time, size): &Planned) -> Vec<u8> {
        // Parts of it repeat, others do not.
        (0..size as u64).map(|at| ((at.pow(3) / 1000) ^ time ^ topic as u64) as u8).collect()
    }

    fn written(messages: &[Planned], compression: Compression) -> Vec<u8> {
        let mut writer = McapWriter::new(Vec::new(), ("ros2", LIBRARY), compression).unwrap();
        let mut channels = BTreeMap::new();
        for message in messages {
            let (topic, name) = TOPICS[message.0];
            let schema = Schema { name, encoding: "ros2msg", text: "int32 sec" };
            let channel = *channels.entry(topic).or_insert_with(|| writer.add_channel(topic, schema, "cdr").unwrap());
            writer.write_message(channel, message.1, &content(message)).unwrap();
        }
        writer.finish().unwrap();
        writer.into_file()
    }

    /// The same by the crate `mcap`.
    fn by_peer(messages: &[Planned]) -> Vec<u8> {
        let options =
            mcap::WriteOptions::new().compression(None).disable_seeking(true).profile("ros2").library(LIBRARY);
        let mut writer = options.create(NoSeek::new(Vec::new())).unwrap();
        for message in messages {
            let (topic, name) = TOPICS[message.0];
            let schema = writer.add_schema(name, "ros2msg", b"int32 sec").unwrap();
            let channel_id = writer.add_channel(schema, topic, "cdr", &BTreeMap::new()).unwrap();
            let header = MessageHeader { channel_id, sequence: 0, log_time: message.1, publish_time: message.1 };
            writer.write_to_known_channel(&header, &content(message)).unwrap();
        }
        writer.finish().unwrap();
        writer.into_inner().into_inner()
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 24, ..ProptestConfig::default() })]

        #[test]
        fn files_equal_those_of_another_writer(
            messages in prop::collection::vec((0..TOPICS.len(), 0..5_000_000_000_u64, 0..700_000_usize), 0..12),
        ) {
            let expected = by_peer(&messages);
            prop_assert!(written(&messages, Compression::None) == expected);
            let file = written(&messages, Compression::Lz4);
            prop_assert!(without_chunks(&file) == without_chunks(&expected));
            prop_assert!(written(&messages, Compression::Lz4) == file, "other bytes");
            check_index(&file, &messages);
        }
    }

    /// Asserts that the summary leads to each message.
    fn check_index(file: &[u8], messages: &[Planned]) {
        let summary = mcap::Summary::read(file).unwrap().unwrap();
        assert_eq!(summary.stats.as_ref().unwrap().message_count, messages.len() as u64);
        let record_at = |place: u64| {
            let record = &file[place as usize..];
            let length = u64::from_le_bytes(record[1..9].try_into().unwrap()) as usize;
            mcap::parse_record(record[0], &record[9..9 + length]).unwrap()
        };
        let mut found = Vec::new();
        for chunk in &summary.chunk_indexes {
            let Record::Chunk { header, data } = record_at(chunk.chunk_start_offset) else { panic!("no chunk") };
            assert_eq!((data.len() as u64, header.uncompressed_size), (chunk.compressed_size, chunk.uncompressed_size));
            for (channel, place) in &chunk.message_index_offsets {
                let Record::MessageIndex(index) = record_at(*place) else { panic!("no index") };
                assert_eq!(index.channel_id, *channel);
                let topic = TOPICS.iter().position(|(topic, _)| *topic == summary.channels[channel].topic).unwrap();
                found.extend(index.records.iter().map(|entry| (topic, entry.log_time)));
                assert!(index.records.iter().all(|entry| entry.offset < header.uncompressed_size));
            }
        }
        found.sort_unstable();
        let mut expected: Vec<(usize, u64)> = messages.iter().map(|&(topic, time, _)| (topic, time)).collect();
        expected.sort_unstable();
        assert_eq!(found, expected);
    }
    /// A file on a disk with little room.
    struct SmallDisk {
        file: Vec<u8>,
        room: usize,
    }

    impl Write for SmallDisk {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            let written = bytes.len().min(self.room - self.file.len());
            if written == 0 && !bytes.is_empty() {
                return Err(io::ErrorKind::StorageFull.into());
            }
            self.file.extend(&bytes[..written]);
            Ok(written)
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    impl Truncate for SmallDisk {
        fn truncate(&mut self, bytes: u64) -> io::Result<()> {
            self.file.truncate(bytes as usize);
            Ok(())
        }
    }

    /// Writes messages to a disk with some room, as far as it goes.
    fn written_with_room(messages: &[Planned], room: usize) -> io::Result<EndedEarly<SmallDisk>> {
        let out = SmallDisk { file: Vec::new(), room };
        let mut writer = McapWriter::new(out, ("ros2", LIBRARY), Compression::None)?;
        let mut channels = BTreeMap::new();
        for message in messages {
            let (topic, name) = TOPICS[message.0];
            let schema = Schema { name, encoding: "ros2msg", text: "int32 sec" };
            let channel = *channels.entry(topic).or_insert_with(|| writer.add_channel(topic, schema, "cdr").unwrap());
            if writer.write_message(channel, message.1, &content(message)).is_err() {
                return writer.end_early();
            }
        }
        match writer.finish() {
            Ok(()) => Ok(EndedEarly { out: writer.into_file(), messages: messages.len() as u64, has_summary: true }),
            Err(_) => writer.end_early(),
        }
    }

    #[test]
    fn on_a_full_disk_the_whole_chunks_are_a_file() {
        // Chunks of four messages of two topics; the third topic comes with the last.
        let mut messages: Vec<Planned> = (0..21).map(|at| (at % 2, at as u64 * 1000, 300_000)).collect();
        messages.push((2, 1, 5));
        let whole = written(&messages, Compression::None);
        let mut found = Vec::new();
        let rooms = [whole.len(), whole.len() - 1, whole.len() - 400_000, 4_900_000, 1_300_000];
        // The chunks end at another place in each.
        for room in rooms.into_iter().chain((3_000_000..4_300_000).step_by(99_991)) {
            let ended = written_with_room(&messages, room).unwrap();
            let (count, file) = (ended.messages as usize, ended.out.file);
            assert!(ended.has_summary && file.len() <= room, "{room}");
            check_index(&file, &messages[..count]);
            let read = mcap::MessageStream::new(&file).unwrap().map(|message| message.unwrap().data.to_vec());
            assert!(read.eq(messages[..count].iter().map(content)), "{room}");
            // A chunk of four messages and the summary have 1.2 MB and 1 kB.
            assert!(count + 8 > room * messages.len() / whole.len(), "{room}: {count}");
            found.push(count);
        }
        assert_eq!(found[..2], [22, 20], "all, and all but those of the last chunk");
        // There is nothing to keep before the first chunk ends.
        assert!(written_with_room(&messages, 1_000_000).is_err());
    }

    /// Others fill the disk as soon as something is cut.
    #[test]
    fn without_room_for_a_summary_there_is_none() {
        struct Filling(SmallDisk);
        impl Write for Filling {
            fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
                self.0.write(bytes)
            }

            fn flush(&mut self) -> io::Result<()> {
                Ok(())
            }
        }
        impl Truncate for Filling {
            fn truncate(&mut self, bytes: u64) -> io::Result<()> {
                self.0.room = bytes as usize;
                self.0.truncate(bytes)
            }
        }
        let out = Filling(SmallDisk { file: Vec::new(), room: 8_000_000 });
        let mut writer = McapWriter::new(out, ("ros2", LIBRARY), Compression::None).unwrap();
        let schema = Schema { name: "std_msgs/msg/String", encoding: "ros2msg", text: "string data" };
        let channel = writer.add_channel("/a", schema, "cdr").unwrap();
        let message = |at: u64| content(&(0, at, 300_000));
        assert!((0..40).any(|at| writer.write_message(channel, at, &message(at)).is_err()));
        let ended = writer.end_early().unwrap();
        assert!(!ended.has_summary && ended.messages >= 12, "{}", ended.messages);
        let file = ended.out.0.file;
        let read: Vec<Vec<u8>> =
            mcap::MessageStream::new_with_options(&file, mcap::read::Options::IgnoreEndMagic.into())
                .unwrap()
                .map_while(|message| Some(message.ok()?.data.to_vec()))
                .collect();
        assert!(read == (0..ended.messages).map(message).collect::<Vec<_>>());
    }
}
