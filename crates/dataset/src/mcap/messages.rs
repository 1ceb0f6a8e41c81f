//! The messages of a recording one after the other, to play it like a stream.

use super::container::{FoundMessage, McapFile, RecordSink};
use super::recording_parts::RecordingParts;
use crate::DatasetError;
use crate::plausibility::warn_once;
use mcap::records::Channel;
use std::collections::BTreeMap;
use std::path::Path;
use std::time::Duration;

/// A message of a recording.
#[derive(Clone, Copy, Debug)]
pub struct RecordedMessage<'a> {
    /// Its topic, e.g. `/camera/color/image_raw`.
    pub topic: &'a str,
    /// Its type, e.g. `sensor_msgs/msg/Image`.
    pub type_name: &'a str,
    /// Its content in CDR.
    pub data: &'a [u8],
    /// When it was recorded, since the Unix epoch.
    pub recorded: Duration,
}

/// Reads a recording, or the only one in a folder, and calls `receive` with each message in CDR, in the order of the file.
/// Reading stops at the first error of `receive`.
///
/// # Errors
/// If there is no recording or there are several, the file is not an MCAP file, or `receive` returns an error. Damaged
/// parts are left out, with a warning.
pub fn read_messages(
    path: &Path,
    receive: &mut dyn FnMut(&RecordedMessage<'_>) -> Result<(), DatasetError>,
) -> Result<(), DatasetError> {
    let recording = RecordingParts::find(path)?;
    let mut player = Player { receive, schemas: BTreeMap::new(), channels: BTreeMap::new() };
    let file = McapFile::scan(&recording, &mut player)?;
    for text in file.damage() {
        warn_once(text.clone());
    }
    Ok(())
}

/// Passes on the messages of a file.
struct Player<'a> {
    receive: &'a mut dyn FnMut(&RecordedMessage<'_>) -> Result<(), DatasetError>,
    /// Message type of each schema.
    schemas: BTreeMap<u16, String>,
    /// Topic and type of each channel with messages in CDR.
    channels: BTreeMap<u16, (String, String)>,
}

impl RecordSink for Player<'_> {
    fn start_file(&mut self) {
        self.schemas.clear();
        self.channels.clear();
    }

    fn schema(&mut self, id: u16, name: &str) -> Result<(), DatasetError> {
        self.schemas.entry(id).or_insert_with(|| name.to_owned());
        Ok(())
    }

    fn channel(&mut self, channel: Channel) -> Result<(), DatasetError> {
        if channel.message_encoding == "cdr" {
            let type_name = self.schemas.get(&channel.schema_id).cloned().unwrap_or_default();
            self.channels.entry(channel.id).or_insert((channel.topic, type_name));
        }
        Ok(())
    }

    fn message(&mut self, message: &FoundMessage<'_>) -> Result<(), DatasetError> {
        let Some((topic, type_name)) = self.channels.get(&message.channel) else { return Ok(()) };
        let recorded = Duration::from_nanos(message.log_time);
        (self.receive)(&RecordedMessage { topic, type_name, data: message.data, recorded })
    }
}
