//! The topics in a file, and the messages of each.

use super::container::{Channel, FoundMessage, RecordSink};
use crate::DatasetError;
use crate::ros_topics::contents::Contents;
use std::collections::BTreeMap;
use std::path::Path;

/// Receiver of all topics and messages of a file.
#[derive(Debug)]
pub(super) struct RecordedTopics {
    pub(super) contents: Contents,
    /// Index of each channel's topic.
    channels: BTreeMap<u64, usize>,
    /// Number of messages of undeclared channels.
    pub(super) without_channel: u64,
}

impl RecordedTopics {
    pub(super) fn new(path: &Path) -> Self {
        Self { contents: Contents::new(path), channels: BTreeMap::new(), without_channel: 0 }
    }
}

impl RecordSink for RecordedTopics {
    fn start_file(&mut self) {
        self.channels.clear();
    }

    fn hold(&mut self, bytes: u64) -> Result<(), DatasetError> {
        self.contents.add_memory(bytes)
    }

    fn needs_images(&self) -> bool {
        false
    }

    fn channel(&mut self, channel: &Channel<'_>) -> Result<(), DatasetError> {
        if !self.channels.contains_key(&channel.id) {
            let topic = self.contents.topic(channel.topic, channel.type_name, channel.encoding)?;
            self.channels.insert(channel.id, topic);
        }
        Ok(())
    }

    fn message(&mut self, message: &FoundMessage<'_>) -> Result<(), DatasetError> {
        let Some(topic) = self.channels.get(&message.channel) else {
            self.without_channel += 1;
            return Ok(());
        };
        match message.data {
            Ok(data) => self.contents.message(*topic, (message.log_time, message.place), data),
            Err(error) => {
                self.contents.unreadable_message(*topic, message.log_time, error);
                Ok(())
            }
        }
    }
}
