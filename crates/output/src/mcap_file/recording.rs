//! Writing of an MCAP file.

use super::scene_update::{SceneUpdate, schema};
use mcap::records::MessageHeader;
use mcap::write::NoSeek;
use mcap::{McapError, WriteOptions, Writer};
use serde::Serialize;
use splatseg_files::AtomicFile;
use splatseg_ros::{Interface, Message, to_cdr};
use std::collections::BTreeMap;
use std::io;
use std::path::Path;

/// Name of the writing library in the file's header.
const LIBRARY: &str = "splatseg";
/// First bytes of a file: the magic, and the header (code 1, 16 bytes) with an empty profile and [`LIBRARY`], each with
/// its length.
pub(super) const START: &[u8] = b"\x89MCAP0\r\n\x01\x10\0\0\0\0\0\0\0\0\0\0\0\x08\0\0\0splatseg";

/// The file. Messages may be written in any order of time.
pub(super) struct Recording {
    writer: Writer<NoSeek<AtomicFile>>,
    /// Channel id of each topic that has messages.
    channels: BTreeMap<String, u16>,
}

/// Description of a message type.
struct Schema<'a> {
    name: &'a str,
    encoding: &'a str,
    text: String,
    message_encoding: &'a str,
}

impl Recording {
    /// Starts a file; it appears at `path` only after [`Self::finish`].
    pub(super) fn create(path: &Path) -> io::Result<Self> {
        let file = NoSeek::new(AtomicFile::create(path)?);
        let options = WriteOptions::new().compression(None).disable_seeking(true).library(LIBRARY);
        Ok(Self { writer: options.create(file).map_err(io_error)?, channels: BTreeMap::new() })
    }

    /// Writes a ROS 2 message with a time in nanoseconds.
    pub(super) fn write<M: Message + Serialize>(
        &mut self,
        topic: &'static str,
        time: i64,
        message: &M,
    ) -> io::Result<()> {
        let data = to_cdr(message).map_err(io::Error::other)?;
        let schema = || Schema {
            name: M::INTERFACE.name,
            encoding: "ros2msg",
            text: M::INTERFACE.schema(),
            message_encoding: "cdr",
        };
        self.write_bytes(topic, schema, time, &data)
    }

    /// Writes a Foxglove message with a time in nanoseconds.
    pub(super) fn write_scene_update(
        &mut self,
        topic: &'static str,
        time: i64,
        message: &SceneUpdate,
    ) -> io::Result<()> {
        let data = serde_json::to_vec(message)?;
        let schema = || Schema {
            name: SceneUpdate::NAME,
            encoding: "jsonschema",
            text: schema().to_string(),
            message_encoding: "json",
        };
        self.write_bytes(topic, schema, time, &data)
    }

    /// Writes a message of a camera that is in CDR already. Messages of other types are left out.
    pub(super) fn write_cdr(&mut self, topic: &str, type_name: &str, time: i64, data: &[u8]) -> io::Result<()> {
        let Some(interface) = Interface::of_camera(type_name) else { return Ok(()) };
        let schema =
            || Schema { name: interface.name, encoding: "ros2msg", text: interface.schema(), message_encoding: "cdr" };
        self.write_bytes(topic, schema, time, data)
    }

    fn write_bytes<'a>(
        &mut self,
        topic: &str,
        schema: impl FnOnce() -> Schema<'a>,
        time: i64,
        data: &[u8],
    ) -> io::Result<()> {
        let channel_id = match self.channels.get(topic) {
            Some(id) => *id,
            None => {
                let schema = schema();
                let id = self.writer.add_schema(schema.name, schema.encoding, schema.text.as_bytes());
                let metadata = BTreeMap::new();
                let id = id.and_then(|id| self.writer.add_channel(id, topic, schema.message_encoding, &metadata));
                let id = id.map_err(io_error)?;
                self.channels.insert(topic.to_owned(), id);
                id
            }
        };
        let time = u64::try_from(time).unwrap_or(0);
        let header = MessageHeader { channel_id, sequence: 0, log_time: time, publish_time: time };
        self.writer.write_to_known_channel(&header, data).map_err(io_error)
    }

    /// Writes the index and moves the file to its path.
    pub(super) fn finish(mut self) -> io::Result<()> {
        self.writer.finish().map_err(io_error)?;
        self.writer.into_inner().into_inner().commit()
    }
}

fn io_error(error: McapError) -> io::Error {
    match error {
        McapError::Io(error) => error,
        other => io::Error::other(other),
    }
}
