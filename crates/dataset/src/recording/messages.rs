//! The messages of a recording one after the other, to play it like a stream.

use super::container::{Channel, FoundMessage, RecordSink};
use super::recorded_file::RecordedFile;
use super::recording_parts::RecordingParts;
use crate::DatasetError;
use crate::plausibility::warn_once;
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
/// If there is no recording or there are several, a file is not of the kind that its name says, or `receive` returns an error. Damaged
/// parts are left out, with a warning.
pub fn read_messages(
    path: &Path,
    receive: &mut dyn FnMut(&RecordedMessage<'_>) -> Result<(), DatasetError>,
) -> Result<(), DatasetError> {
    let recording = RecordingParts::find_any(path)?;
    let mut player = Player { receive, channels: BTreeMap::new() };
    let file = RecordedFile::scan(&recording, &mut player)?;
    for text in file.damage() {
        warn_once(text.clone());
    }
    Ok(())
}

/// Passes on the messages of a file.
struct Player<'a> {
    receive: &'a mut dyn FnMut(&RecordedMessage<'_>) -> Result<(), DatasetError>,
    /// Topic and type of each channel with messages in CDR.
    channels: BTreeMap<u64, (String, String)>,
}

impl RecordSink for Player<'_> {
    fn start_file(&mut self) {
        self.channels.clear();
    }

    fn hold(&mut self, _bytes: u64) -> Result<(), DatasetError> {
        Ok(())
    }

    fn channel(&mut self, channel: &Channel<'_>) -> Result<(), DatasetError> {
        if channel.encoding == "cdr" {
            let names = || (channel.topic.to_owned(), channel.type_name.to_owned());
            self.channels.entry(channel.id).or_insert_with(names);
        }
        Ok(())
    }

    fn message(&mut self, message: &FoundMessage<'_>) -> Result<(), DatasetError> {
        // What cannot be converted to CDR is damaged.
        let (Some((topic, type_name)), Ok(data)) = (self.channels.get(&message.channel), message.data) else {
            return Ok(());
        };
        let recorded = Duration::from_nanos(message.log_time);
        (self.receive)(&RecordedMessage { topic, type_name, data, recorded })
    }
}
