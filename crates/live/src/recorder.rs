//! Recording of what a session uses of its stream.

use splatseg_dataset::UndecodedFrame;
use splatseg_output::{StreamRecording, StreamRecordingError};
use std::collections::BTreeMap;
use std::io;
use std::path::Path;
use std::time::Duration;

/// Writes the images of the frames that are used, and all messages with poses and calibrations, as they were received. Fed
/// with them, a session without drops uses the same frames.
pub(crate) struct Recorder {
    /// `None` after an error: the file has ended.
    file: Option<StreamRecording>,
    /// Type of each topic with images.
    images: BTreeMap<String, String>,
    /// Why it has ended before the stream.
    error: Option<StreamRecordingError>,
}

impl Recorder {
    pub(crate) fn create(path: &Path) -> io::Result<Self> {
        Ok(Self { file: Some(StreamRecording::create(path)?), images: BTreeMap::new(), error: None })
    }

    /// Takes in a message that may be used.
    pub(crate) fn receive(&mut self, (topic, type_name): (&str, &str), data: &[u8], received: Duration) {
        if !type_name.ends_with("Image") {
            self.write((topic, type_name), data, received);
        } else if !self.images.contains_key(topic) {
            self.images.insert(topic.to_owned(), type_name.to_owned());
        }
    }

    /// Takes in a frame that is used.
    pub(crate) fn use_frame(&mut self, frame: &UndecodedFrame) {
        for (topic, data) in frame.images() {
            if let Some(type_name) = self.images.get(topic).cloned() {
                self.write((topic, &type_name), data, frame.received());
            }
        }
    }

    fn write(&mut self, topic: (&str, &str), data: &[u8], received: Duration) {
        let written = self.file.as_mut().map_or(Ok(()), |file| file.write(topic, received, data));
        if let Err(error) = written {
            // At once, while there is room for the index: nobody knows what comes until the end.
            self.error = self.file.take().map(|file| file.end_early(error));
        }
    }

    /// Why the recording has ended before the stream, in a sentence.
    pub(crate) fn problem(&self) -> Option<String> {
        self.error.as_ref().map(ToString::to_string)
    }

    pub(crate) fn finish(self) -> Result<(), StreamRecordingError> {
        match (self.file, self.error) {
            (_, Some(error)) => Err(error),
            (file, None) => file.map_or(Ok(()), StreamRecording::finish),
        }
    }
}
