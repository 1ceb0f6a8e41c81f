//! Recordings of an Azure Kinect or an Orbbec Femto in Matroska (`.mkv`), as `k4arecorder`, `k4aviewer` and Open3D write them
//! (<https://learn.microsoft.com/azure/kinect-dk/record-file-format>).
//!
//! The tracks COLOR, DEPTH, IR and IMU become topics of the same names, and their blocks images of ROS (`track.rs`). The
//! attached calibration becomes camera infos and a transform (`calibration.rs`). So the rest is as for recordings of ROS.
//!
//! Elements are read one after the other, not by the index, which a file that was not closed has not. Of images only the
//! first bytes are read.

mod calibration;
mod ebml;
mod head;
mod scan;
mod track;

pub(super) use scan::scan;

use super::chunked_files::{ChunkedFiles, MessageData};
use crate::files::open_file;
use crate::ros_topics::contents::MessagePlace;
use crate::{DatasetError, DatasetSettings};
use ebml::{FileWindow, Header, id};
use head::{Head, Role};
use std::path::Path;
use track::Track;

/// So much of the head is read to recognise a file.
const RECOGNITION_BYTES: u64 = 1 << 20;
/// A recording, for reading its images again.
#[derive(Debug)]
pub(super) struct Recording {
    files: ChunkedFiles,
    tracks: Vec<Track>,
    /// Model and modes of the camera, if the file has them.
    pub(super) camera: Option<String>,
    /// Why there is no calibration.
    no_calibration: Option<String>,
}

impl Recording {
    /// Creates a recording without tracks. `path` is named in errors.
    pub(super) fn new(path: &Path) -> Self {
        let no_calibration = Some("none".to_owned());
        Self { files: ChunkedFiles::new(path), tracks: Vec::new(), camera: None, no_calibration }
    }

    /// Reads an image.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub(super) fn read(&self, place: MessagePlace) -> Result<MessageData, DatasetError> {
        let stored = self.files.read(MessagePlace { chunk: None, ..place })?;
        let track = place.chunk.and_then(|index| self.tracks.get(index as usize));
        // Its time is known already.
        let message = track.and_then(|track| track.message(0, &stored).ok());
        Ok(message.unwrap_or_default().into())
    }

    /// Checks that there are colour, depth, and the calibration, as far as the settings do not replace them.
    ///
    /// # Errors
    /// [`DatasetError::Field`] says what is missing.
    pub(super) fn require_images(&self, path: &Path, settings: &DatasetSettings) -> Result<(), DatasetError> {
        let error = |field: &str, found: String, expected: &str| {
            Err(DatasetError::Field {
                path: path.to_owned(),
                field: field.to_owned(),
                found,
                expected: expected.to_owned(),
            })
        };
        let has = |role: Role| self.tracks.iter().any(|track| track.role == role && track.is_read());
        let tracks: Vec<String> = self.tracks.iter().map(Track::text).collect();
        let found = if tracks.is_empty() { "none".to_owned() } else { tracks.join(", ") };
        if settings.depth.is_none() && !has(Role::Depth) {
            return error("tracks", found, "DEPTH with 16 bits (b16g): PASSIVE_IR and OFF are no modes with depth");
        }
        if settings.color.is_none() && !has(Role::Color) {
            return error("tracks", found, "COLOR as MJPG, NV12, YUY2 or BGRA");
        }
        match &self.no_calibration {
            Some(found) if settings.fx.is_none() => error(
                "attachment calibration.json",
                found.clone(),
                "the calibration that k4arecorder attaches; --fx with --register-depth false reads depth that is registered \
                 to colour already",
            ),
            _ => Ok(()),
        }
    }
}

/// Returns true if a file is such a recording, by its content.
pub(crate) fn is_recording(path: &Path) -> bool {
    let Ok(file) = open_file(path) else { return false };
    let Ok(bytes) = file.metadata().map(|metadata| metadata.len()) else { return false };
    let mut window = FileWindow::new(file, bytes);
    if !matches!(window.header(0), Ok(Some(Header { id: id::EBML, .. }))) {
        return false;
    }
    let mut head = Head::default();
    let read = window.read(0, RECOGNITION_BYTES).unwrap_or_default();
    add_parts(&read, &mut head);
    head.is_kinect()
}

/// Adds the parts of the head that are whole in the first bytes of a file.
fn add_parts(mut bytes: &[u8], head: &mut Head) {
    while let Some(header) = Header::parse(bytes).filter(|header| header.id != id::CLUSTER) {
        bytes = bytes.get(header.length..).unwrap_or_default();
        if header.id == id::SEGMENT {
            continue;
        }
        let size = header.size.and_then(|size| usize::try_from(size).ok());
        let Some((data, rest)) = size.and_then(|size| bytes.split_at_checked(size)) else { return };
        head.add(header.id, data);
        bytes = rest;
    }
}
