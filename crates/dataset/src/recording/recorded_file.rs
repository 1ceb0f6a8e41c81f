//! A recording of any container: all messages once in order, then single ones again.
//!
//! A recording is one file, or several into which it was split. What rosbag2 has compressed, files or messages, is
//! unpacked here.

use super::bag::{self, Connections};
use super::chunked_files::{ChunkedFiles, MessageData};
use super::container::{Container, RecordSink, Unpacking, max_message_bytes};
use super::recording_parts::{OpenPart, RecordingParts};
use super::sqlite::{self, Database};
use super::{mcap, mkv, realsense, zstd};
use crate::files::RandomAccessFile;
use crate::ros_topics::contents::MessagePlace;
use crate::ros_topics::frame_names::listed;
use crate::{DatasetError, DatasetSettings};
use std::fs::File;
use std::path::{Path, PathBuf};

/// A recording whose messages have been scanned.
#[derive(Debug)]
pub(super) struct RecordedFile {
    path: PathBuf,
    container: Container,
    content: StoredMessages,
    /// How rosbag2 has compressed it, in addition to chunks.
    has_packed_files: bool,
    has_packed_messages: bool,
    /// Damage to the file, one line each.
    damage: Vec<String>,
}

/// Where the messages are read again.
#[derive(Debug)]
enum StoredMessages {
    Mcap(ChunkedFiles),
    Db3(Vec<Database>),
    Bag(ChunkedFiles, Connections),
    Mkv(mkv::Recording),
}

/// A file of a recording while it is scanned.
#[derive(Debug)]
pub(super) struct ScannedFile<'a> {
    pub(super) path: &'a Path,
    pub(super) file: File,
    /// Its size.
    pub(super) bytes: u64,
    /// Its offset in the recording.
    pub(super) start: u64,
    pub(super) unpacking: Unpacking<'a>,
    /// Damage to it, one line each.
    pub(super) damage: Vec<String>,
}

impl ScannedFile<'_> {
    /// Returns the file for reading from its start.
    pub(super) fn reader(&self) -> Result<File, DatasetError> {
        self.file.try_clone().map_err(|source| DatasetError::Io { path: self.path.to_owned(), source })
    }
}

impl RecordedFile {
    /// Reads all messages of a recording into `sink`. Skips damaged parts.
    ///
    /// # Errors
    /// If a file cannot be read, is not of its container, or the sink fails.
    pub(super) fn scan(recording: &RecordingParts, sink: &mut dyn RecordSink) -> Result<Self, DatasetError> {
        let path = &recording.path;
        let content = match recording.container {
            Container::Mcap => StoredMessages::Mcap(ChunkedFiles::new(path)),
            Container::Db3 => StoredMessages::Db3(Vec::new()),
            Container::Bag => StoredMessages::Bag(ChunkedFiles::new(path), Connections::default()),
            Container::Mkv => StoredMessages::Mkv(mkv::Recording::new(path)),
        };
        let mut scanned = Self {
            path: path.clone(),
            container: recording.container,
            content,
            has_packed_files: false,
            has_packed_messages: false,
            damage: Vec::new(),
        };
        if !recording.missing.is_empty() {
            let numbers = listed(recording.missing.iter().map(u64::to_string).collect());
            scanned.damage.push(format!("{}: the files with these numbers are missing: {numbers}", path.display()));
        }
        let mut sink = realsense::Translator::new(sink);
        let mut start = 0;
        for path in &recording.files {
            start = scanned.scan_file(path, start, &mut sink)?;
        }
        Ok(scanned)
    }

    /// Scans a file that begins at an offset in the recording. Returns where it ends.
    fn scan_file(&mut self, path: &Path, start: u64, sink: &mut dyn RecordSink) -> Result<u64, DatasetError> {
        sink.start_file();
        let part = OpenPart::new(path)?;
        self.has_packed_files |= part.was_packed;
        self.damage.extend(part.damage);
        let unpacking = Unpacking::new(path, part.bytes);
        let mut file = ScannedFile { path, file: part.file, bytes: part.bytes, start, unpacking, damage: Vec::new() };
        match &mut self.content {
            StoredMessages::Mcap(files) => {
                mcap::scan(&mut file, files, sink)?;
                files.add_file(start, RandomAccessFile::new(file.reader()?));
            }
            StoredMessages::Db3(databases) => {
                let database = sqlite::scan(&mut file, databases.len(), sink)?;
                databases.push(database);
            }
            StoredMessages::Bag(files, connections) => {
                bag::scan(&mut file, (files, connections), sink)?;
                files.add_file(start, RandomAccessFile::new(file.reader()?));
            }
            StoredMessages::Mkv(recording) => mkv::scan(&mut file, recording, sink)?,
        }
        self.has_packed_messages |= file.unpacking.has_packed_messages;
        self.damage.extend(file.damage);
        self.damage.extend(file.unpacking.damage());
        Ok(start.saturating_add(file.bytes))
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    pub(super) fn container(&self) -> Container {
        self.container
    }

    /// Returns the damage to the files, one line each.
    pub(super) fn damage(&self) -> &[String] {
        &self.damage
    }

    /// Returns what the file says about the camera, for people; `None` if it says nothing.
    pub(super) fn camera(&self) -> Option<&str> {
        match &self.content {
            StoredMessages::Mkv(recording) => recording.camera.as_deref(),
            _ => None,
        }
    }

    /// Checks that what the settings do not name is there, if the container says what that is.
    ///
    /// # Errors
    /// [`DatasetError::Field`] says what is missing.
    pub(super) fn require_images(&self, settings: &DatasetSettings) -> Result<(), DatasetError> {
        match &self.content {
            StoredMessages::Mkv(recording) => recording.require_images(&self.path, settings),
            _ => Ok(()),
        }
    }

    /// Returns how rosbag2 has compressed it; `None` if it has not.
    pub(super) fn compression(&self) -> Option<&'static str> {
        match (self.has_packed_files, self.has_packed_messages) {
            (false, false) => None,
            (true, false) => Some("zstd, each file"),
            (false, true) => Some("zstd, each message"),
            (true, true) => Some("zstd, each file and each message"),
        }
    }

    /// Reads the data of a message, in CDR.
    ///
    /// # Errors
    /// If the file cannot be read, or has changed since it was opened.
    pub(super) fn read(&self, place: MessagePlace) -> Result<MessageData, DatasetError> {
        let changed = |field: &str, found: String| DatasetError::Field {
            path: self.path.clone(),
            field: field.to_owned(),
            found,
            expected: "the same content as when the recording was opened".to_owned(),
        };
        let stored = match &self.content {
            StoredMessages::Mcap(files) => files.read(place)?,
            StoredMessages::Db3(databases) => {
                let number = place.chunk.and_then(|number| databases.get(number as usize));
                let database = number.ok_or_else(|| changed("file of the recording", "none".to_owned()))?;
                database.read(place)?.into()
            }
            StoredMessages::Mkv(recording) => return recording.read(place),
            StoredMessages::Bag(files, connections) => {
                let record = files.read(place)?;
                return match connections.transcoded(&record) {
                    Ok(data) => Ok(data.into()),
                    Err(found) => Err(changed("message", found)),
                };
            }
        };
        if !stored.starts_with(zstd::MAGIC) {
            return Ok(stored);
        }
        let unpacked = zstd::unpack_message(&stored, max_message_bytes());
        unpacked.map(MessageData::from).map_err(|found| changed("compressed message", found))
    }
}
