//! A recording of what was used of a stream.

use super::compression::Compression;
use super::recording::{Profile, Recording};
use super::writer::EndedEarly;
use std::io;
use std::path::{Path, PathBuf};
use std::time::Duration;
use thiserror::Error;

/// Writes the messages of a camera as they are, in CDR, to an MCAP file. They are not compressed, as that
/// would take time from the session.
pub struct StreamRecording {
    recording: Recording,
    path: PathBuf,
}

/// Why a recording lacks messages, and what is left of it.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum StreamRecordingError {
    /// The file has the messages before the error, without the last few megabytes of them.
    #[error(
        "{}: the recording ends early, with {messages} messages{}: {source}",
        path.display(),
        if *has_index { "" } else { " and without an index" }
    )]
    EndsEarly {
        /// The file.
        path: PathBuf,
        /// Number of messages in it.
        messages: u64,
        /// True if it has an index at its end. Without one, some programs cannot open it; splatseg can.
        has_index: bool,
        /// The error.
        source: io::Error,
    },
    /// There is no file.
    #[error("{}: the recording is lost: {source}", path.display())]
    Lost {
        /// The file that there is not.
        path: PathBuf,
        /// The error.
        source: io::Error,
    },
}

impl StreamRecording {
    /// Starts a file; it appears at `path` only after [`Self::finish`] or [`Self::end_early`].
    ///
    /// # Errors
    /// If no file can be written there.
    pub fn create(path: &Path) -> io::Result<Self> {
        let recording = Recording::create(path, Profile::Ros2, Compression::None)?;
        Ok(Self { recording, path: path.to_owned() })
    }

    /// Writes a message: its topic, type (e.g. `sensor_msgs/msg/Image`), time of receipt and content in CDR. Those of
    /// types that have nothing to do with a camera or its pose are left out.
    ///
    /// # Errors
    /// If it, or messages before it, cannot be written. Then call [`Self::end_early`].
    pub fn write(&mut self, (topic, type_name): (&str, &str), received: Duration, data: &[u8]) -> io::Result<()> {
        let time = i64::try_from(received.as_nanos()).unwrap_or(i64::MAX);
        self.recording.write_cdr(topic, type_name, time, data)
    }

    /// Writes the index and moves the file to its path.
    ///
    /// # Errors
    /// If that fails: what could be kept is in the error.
    pub fn finish(mut self) -> Result<(), StreamRecordingError> {
        if let Err(error) = self.recording.write_end() {
            return Err(self.end_early(error));
        }
        let Self { recording, path } = self;
        recording.commit().map_err(|source| StreamRecordingError::Lost { path, source })
    }

    /// Ends the recording after an error of [`Self::write`], e.g. because the disk is full: the messages
    /// before it become the file, without the last few megabytes. Returns the error with what was kept.
    pub fn end_early(self, source: io::Error) -> StreamRecordingError {
        let Self { recording, path } = self;
        match recording.end_early() {
            Ok(EndedEarly { messages, has_summary: has_index, .. }) => {
                StreamRecordingError::EndsEarly { path, messages, has_index, source }
            }
            // The first error is the reason for those after it.
            Err(_) => StreamRecordingError::Lost { path, source },
        }
    }
}
