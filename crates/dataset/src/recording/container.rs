//! Containers of recordings: names of their files, and the parts that all readers share.

use super::zstd;
use crate::ros_topics::contents::MessagePlace;
use crate::{DatasetError, Format};
use splatseg_files::{MemoryLimit, display_bytes};
use std::borrow::Cow;
use std::path::Path;

/// Maximum length of a message; longer ones are skipped. The largest image has 256 MB.
const MAX_MESSAGE_BYTES: u64 = 272 << 20;
/// The messages and chunks of a file may unpack to this many times its size, and always to the second number of bytes.
const MAX_RATIO: u64 = 256;
const ALWAYS_UNPACKED_BYTES: u64 = 4 << 30;

/// Returns the maximum size of a message, stored or unpacked, bytes.
pub(super) fn max_message_bytes() -> u64 {
    MAX_MESSAGE_BYTES.min(MemoryLimit::in_force() / 2)
}

/// A kind of file with messages.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Container {
    Mcap,
    /// SQLite, as rosbag2 and RealSense's SDK write it.
    Db3,
    /// A bag of ROS 1, version 2.0.
    Bag,
    /// Matroska, as the recorder of Azure Kinect writes it.
    Mkv,
}

impl Container {
    /// In the order in which they are looked for.
    pub(crate) const ALL: [Self; 4] = [Self::Mcap, Self::Db3, Self::Bag, Self::Mkv];

    /// Endings of the names of its files, the usual one first.
    pub(crate) fn endings(self) -> &'static [&'static str] {
        match self {
            Self::Mcap => &[".mcap"],
            Self::Db3 => &[".db3"],
            // rosbag names a bag so until it is closed.
            Self::Bag => &[".bag", ".bag.active"],
            Self::Mkv => &[".mkv"],
        }
    }

    /// Expected content of a folder, for messages.
    pub(crate) fn expected(self) -> &'static str {
        match self {
            Self::Mcap => "a file <recording>.mcap, or <recording>.mcap.zstd",
            Self::Db3 => "a file <recording>.db3, or <recording>.db3.zstd",
            Self::Bag => "a file <recording>.bag",
            Self::Mkv => "a file <recording>.mkv of Azure Kinect or Orbbec Femto",
        }
    }

    /// Layout of a recording, for messages.
    pub(crate) const fn layout(self) -> &'static str {
        match self {
            Self::Mcap => {
                "a file recording.mcap with ROS 2 messages: colour and depth images, camera infos, and transforms (/tf) or \
                 poses; or a folder with one, as rosbag2 writes it, also compressed with zstd"
            }
            Self::Db3 => {
                "the same in SQLite: a file recording.db3, or a folder with one, as rosbag2 and RealSense's SDK write it"
            }
            Self::Bag => {
                "the same of ROS 1: a file recording.bag, also with chunks in lz4 or bz2, or a folder with one"
            }
            Self::Mkv => {
                "a recording of Azure Kinect or Orbbec Femto: a file recording.mkv with the tracks COLOR and DEPTH and the \
                 device's calibration, as k4arecorder writes it, or a folder with one"
            }
        }
    }

    /// Its name for people.
    pub(crate) fn title(self) -> &'static str {
        match self {
            Self::Mcap => "MCAP",
            Self::Db3 => "SQLite of rosbag2",
            Self::Bag => "bag of ROS 1",
            Self::Mkv => "Matroska of Azure Kinect or Orbbec Femto",
        }
    }

    pub(crate) fn format(self) -> Format {
        match self {
            Self::Mcap => Format::Mcap,
            Self::Db3 => Format::Db3,
            Self::Bag => Format::Bag,
            Self::Mkv => Format::Mkv,
        }
    }
}

/// A topic as a file declares it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Channel<'a> {
    /// Its number in the file.
    pub(super) id: u64,
    pub(super) topic: &'a str,
    /// Message type, e.g. `sensor_msgs/msg/Image`; empty if the file does not state it.
    pub(super) type_name: &'a str,
    /// Message encoding: `cdr` for messages that can be read.
    pub(super) encoding: &'a str,
}

/// A message found while scanning.
#[derive(Clone, Copy, Debug)]
pub(super) struct FoundMessage<'a> {
    pub(super) channel: u64,
    /// Recording time, nanoseconds.
    pub(super) log_time: u64,
    pub(super) place: MessagePlace,
    /// Its content in CDR, or why it cannot be converted to that.
    pub(super) data: Result<&'a [u8], &'a str>,
}

/// Receiver of the topics and messages of a file, in order.
pub(super) trait RecordSink {
    /// Called before each file: numbers of channels are those of a file.
    fn start_file(&mut self);
    /// Called before a reader keeps `bytes` in memory, e.g. for the name of a type.
    ///
    /// # Errors
    /// If that is too much.
    fn hold(&mut self, bytes: u64) -> Result<(), DatasetError>;
    /// A topic. Of several with one number, the first counts.
    fn channel(&mut self, channel: &Channel<'_>) -> Result<(), DatasetError>;
    fn message(&mut self, message: &FoundMessage<'_>) -> Result<(), DatasetError>;
    /// Returns false if the headers of images and their first bytes are enough.
    fn needs_images(&self) -> bool {
        true
    }
}

/// Unpacks messages that rosbag2 has compressed one by one, and counts what a file unpacks to.
#[derive(Debug)]
pub(super) struct Unpacking<'a> {
    path: &'a Path,
    /// Size of the file.
    bytes: u64,
    unpacked_bytes: u64,
    /// True if a message was compressed.
    pub(super) has_packed_messages: bool,
    /// Number of compressed messages that cannot be unpacked, and why the first cannot.
    damaged: Option<(u64, String)>,
}

impl<'a> Unpacking<'a> {
    pub(super) fn new(path: &'a Path, bytes: u64) -> Self {
        Self { path, bytes, unpacked_bytes: 0, has_packed_messages: false, damaged: None }
    }

    /// Counts bytes that were unpacked.
    ///
    /// # Errors
    /// If they all are far more than recordings unpack to.
    pub(super) fn count(&mut self, bytes: u64) -> Result<(), DatasetError> {
        self.unpacked_bytes = self.unpacked_bytes.saturating_add(bytes);
        let limit = self.bytes.saturating_mul(MAX_RATIO).saturating_add(ALWAYS_UNPACKED_BYTES);
        if self.unpacked_bytes <= limit {
            return Ok(());
        }
        Err(DatasetError::Field {
            path: self.path.to_owned(),
            field: "compressed messages".to_owned(),
            found: format!("more than {} in a file of {}", display_bytes(limit), display_bytes(self.bytes)),
            expected: "a recording, which no compression makes that small".to_owned(),
        })
    }

    /// Returns a message as it was before rosbag2 compressed it; `None` if it is damaged.
    ///
    /// # Errors
    /// If all messages together would unpack to far more than those of recordings do.
    pub(super) fn message<'m>(&mut self, stored: Cow<'m, [u8]>) -> Result<Option<Cow<'m, [u8]>>, DatasetError> {
        if !stored.starts_with(zstd::MAGIC) {
            return Ok(Some(stored));
        }
        match zstd::unpack_message(&stored, max_message_bytes()) {
            Ok(data) => {
                self.has_packed_messages = true;
                self.count(data.len() as u64)?;
                Ok(Some(Cow::Owned(data)))
            }
            Err(what) => {
                let (count, _) = self.damaged.get_or_insert((0, what));
                *count += 1;
                Ok(None)
            }
        }
    }

    /// Describes the compressed messages that are damaged; `None` if none is.
    pub(super) fn damage(&self) -> Option<String> {
        let (count, first) = self.damaged.as_ref()?;
        let what = if *count == 1 { "message is" } else { "messages are" };
        Some(format!("{}: {count} compressed {what} damaged and left out: {first}", self.path.display()))
    }
}
