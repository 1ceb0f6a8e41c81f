//! A recording of what was used of a stream.

use super::compression::Compression;
use super::recording::{Profile, Recording};
use std::io;
use std::path::Path;
use std::time::Duration;

/// Writes the messages of a camera as they are, in CDR, to an MCAP file. They are not compressed, as that
/// would take time from the session.
pub struct StreamRecording(Recording);

impl StreamRecording {
    /// Starts a file; it appears at `path` only after [`Self::finish`].
    ///
    /// # Errors
    /// If no file can be written there.
    pub fn create(path: &Path) -> io::Result<Self> {
        Recording::create(path, Profile::Ros2, Compression::None).map(Self)
    }

    /// Writes a message: its topic, type (e.g. `sensor_msgs/msg/Image`), time of receipt and content in CDR. Those of
    /// types that have nothing to do with a camera or its pose are left out.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn write(&mut self, (topic, type_name): (&str, &str), received: Duration, data: &[u8]) -> io::Result<()> {
        self.0.write_cdr(topic, type_name, i64::try_from(received.as_nanos()).unwrap_or(i64::MAX), data)
    }

    /// Writes the index and moves the file to its path.
    ///
    /// # Errors
    /// If that fails.
    pub fn finish(self) -> io::Result<()> {
        self.0.finish()
    }
}
