//! The topics in a file: its schemas and channels, and the messages of each.

use super::container::{FoundMessage, RecordSink};
use crate::DatasetError;
use crate::ros_topics::contents::{Contents, TOPIC_BYTES};
use mcap::records::Channel;
use std::collections::BTreeMap;
use std::path::Path;

/// Receiver of all records of a file.
#[derive(Debug)]
pub(super) struct RecordedTopics {
    pub(super) contents: Contents,
    /// Message type of each schema.
    schemas: BTreeMap<u16, String>,
    /// Index of each channel's topic.
    channels: BTreeMap<u16, usize>,
    /// Number of messages of undeclared channels.
    pub(super) without_channel: u64,
}

impl RecordedTopics {
    pub(super) fn new(path: &Path) -> Self {
        Self { contents: Contents::new(path), schemas: BTreeMap::new(), channels: BTreeMap::new(), without_channel: 0 }
    }
}

impl RecordSink for RecordedTopics {
    fn start_file(&mut self) {
        self.schemas.clear();
        self.channels.clear();
    }

    fn schema(&mut self, id: u16, name: &str) -> Result<(), DatasetError> {
        if !self.schemas.contains_key(&id) {
            self.contents.add_memory(name.len() as u64 + TOPIC_BYTES)?;
            self.schemas.insert(id, name.to_owned());
        }
        Ok(())
    }

    fn channel(&mut self, channel: Channel) -> Result<(), DatasetError> {
        if !self.channels.contains_key(&channel.id) {
            let type_name = self.schemas.get(&channel.schema_id).map_or("", String::as_str);
            let topic = self.contents.topic(&channel.topic, type_name, &channel.message_encoding)?;
            self.channels.insert(channel.id, topic);
        }
        Ok(())
    }

    fn message(&mut self, message: &FoundMessage<'_>) -> Result<(), DatasetError> {
        let Some(topic) = self.channels.get(&message.channel) else {
            self.without_channel += 1;
            return Ok(());
        };
        self.contents.message(*topic, (message.log_time, message.place), message.data)
    }
}
