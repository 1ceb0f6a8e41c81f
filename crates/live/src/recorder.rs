//! Recording of what a session uses of its stream.

use splatseg_dataset::UndecodedFrame;
use splatseg_output::StreamRecording;
use std::collections::BTreeMap;
use std::io;
use std::path::Path;
use std::time::Duration;

/// Writes the images of the frames that are used, and all messages with poses and calibrations, as they were received. Fed
/// with them, a session without drops uses the same frames.
pub(crate) struct Recorder {
    file: StreamRecording,
    /// Type of each topic with images.
    images: BTreeMap<String, String>,
    /// The first error: nothing is written after it.
    error: Option<io::Error>,
}

impl Recorder {
    pub(crate) fn create(path: &Path) -> io::Result<Self> {
        Ok(Self { file: StreamRecording::create(path)?, images: BTreeMap::new(), error: None })
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
        if self.error.is_none() {
            self.error = self.file.write(topic, received, data).err();
        }
    }

    pub(crate) fn finish(self) -> io::Result<()> {
        self.error.map_or_else(|| self.file.finish(), Err)
    }
}
