//! Writing of an MCAP file.

use super::compression::Compression;
use super::scene_update::{SceneUpdate, schema};
use super::writer::{EndedEarly, McapWriter, Schema};
use serde::Serialize;
use splatseg_files::AtomicFile;
use splatseg_ros::{Interface, Message, to_cdr};
use std::collections::BTreeMap;
use std::io;
use std::path::Path;

/// Name of the writing library in the file's header.
const LIBRARY: &str = "splatseg";
/// First bytes of files: the magic, and the header (code 1) with a profile and [`LIBRARY`], each with its length.
pub(super) const STARTS: &[&[u8]] = &[
    b"\x89MCAP0\r\n\x01\x10\0\0\0\0\0\0\0\0\0\0\0\x08\0\0\0splatseg",
    b"\x89MCAP0\r\n\x01\x14\0\0\0\0\0\0\0\x04\0\0\0ros2\x08\0\0\0splatseg",
];

/// The file. Messages may be written in any order of time.
pub(super) struct Recording {
    writer: McapWriter<AtomicFile>,
    /// Channel id of each topic that has messages.
    channels: BTreeMap<String, u16>,
}

/// The description of messages in the header of a file.
#[derive(Clone, Copy, Debug)]
pub(super) enum Profile {
    /// All are of ROS 2.
    Ros2,
    Mixed,
}

impl Recording {
    /// Starts a file; it appears at `path` only after [`Self::finish`].
    pub(super) fn create(path: &Path, profile: Profile, compression: Compression) -> io::Result<Self> {
        let profile = match profile {
            Profile::Ros2 => "ros2",
            Profile::Mixed => "",
        };
        let writer = McapWriter::new(AtomicFile::create(path)?, (profile, LIBRARY), compression)?;
        Ok(Self { writer, channels: BTreeMap::new() })
    }

    /// Writes a ROS 2 message with a time in nanoseconds.
    pub(super) fn write<M: Message + Serialize>(
        &mut self,
        topic: &'static str,
        time: i64,
        message: &M,
    ) -> io::Result<()> {
        let data = to_cdr(message).map_err(io::Error::other)?;
        self.write_ros(topic, &M::INTERFACE, time, &data)
    }

    /// Writes a Foxglove message with a time in nanoseconds.
    pub(super) fn write_scene_update(
        &mut self,
        topic: &'static str,
        time: i64,
        message: &SceneUpdate,
    ) -> io::Result<()> {
        let data = serde_json::to_vec(message)?;
        let channel = self.channel(topic, |writer| {
            let text = schema().to_string();
            let schema = Schema { name: SceneUpdate::NAME, encoding: "jsonschema", text: &text };
            writer.add_channel(topic, schema, "json")
        })?;
        self.write_bytes(channel, time, &data)
    }

    /// Writes a message of a camera that is in CDR already. Messages of other types are left out.
    pub(super) fn write_cdr(&mut self, topic: &str, type_name: &str, time: i64, data: &[u8]) -> io::Result<()> {
        match Interface::of_camera(type_name) {
            Some(interface) => self.write_ros(topic, &interface, time, data),
            None => Ok(()),
        }
    }

    fn write_ros(&mut self, topic: &str, interface: &Interface, time: i64, data: &[u8]) -> io::Result<()> {
        let channel = self.channel(topic, |writer| {
            let text = interface.schema();
            let schema = Schema { name: interface.name, encoding: "ros2msg", text: &text };
            writer.add_channel(topic, schema, "cdr")
        })?;
        self.write_bytes(channel, time, data)
    }

    /// Returns the channel of a topic, which is added before its first message.
    fn channel(
        &mut self,
        topic: &str,
        add: impl FnOnce(&mut McapWriter<AtomicFile>) -> io::Result<u16>,
    ) -> io::Result<u16> {
        if let Some(id) = self.channels.get(topic) {
            return Ok(*id);
        }
        let id = add(&mut self.writer)?;
        self.channels.insert(topic.to_owned(), id);
        Ok(id)
    }

    fn write_bytes(&mut self, channel: u16, time: i64, data: &[u8]) -> io::Result<()> {
        self.writer.write_message(channel, u64::try_from(time).unwrap_or(0), data)
    }

    /// Writes the index and moves the file to its path.
    pub(super) fn finish(mut self) -> io::Result<()> {
        self.write_end()?;
        self.commit()
    }

    /// Writes the last messages and the index.
    pub(super) fn write_end(&mut self) -> io::Result<()> {
        self.writer.finish()
    }

    /// Moves the file to its path after [`Self::write_end`].
    pub(super) fn commit(self) -> io::Result<()> {
        self.writer.into_file().commit()
    }

    /// Moves the part of the file that is whole to its path, after an error of writing: see [`McapWriter::end_early`].
    pub(super) fn end_early(self) -> io::Result<EndedEarly<()>> {
        let EndedEarly { out, messages, has_summary } = self.writer.end_early()?;
        out.commit()?;
        Ok(EndedEarly { out: (), messages, has_summary })
    }
}
