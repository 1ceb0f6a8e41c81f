//! Files that are not read, told by their first bytes or name: recordings of other programs, and the rest.

use crate::DatasetError;
use crate::files::open_file;
use crate::formats::FILES;
use std::io::Read;
use std::path::Path;

/// So much of a file is read.
const HEAD_BYTES: u64 = 64;
/// So many bytes of an unknown file are shown.
const SHOWN_BYTES: usize = 16;

/// Files of other programs: first bytes, ending of the name, either of which may be empty; what they are, and what to do.
const FOREIGN: [(&[u8], &str, &str, &str); 10] = [
    (b"#ROSBAG V", "", "a bag of ROS 1 with another name", "a file whose name ends with .bag"),
    (b"\x89MCAP", "", "an MCAP recording with another name", "a file whose name ends with .mcap"),
    (b"SQLite format 3\0", "", "an SQLite file with another name", "a recording of rosbag2, whose name ends with .db3"),
    (b"NI10", ".oni", "a recording of OpenNI", "its frames, extracted with NiViewer or OpenNI's samples, as a folder"),
    (b"", ".svo", "a recording of a ZED camera", "an MCAP recording of its ROS 2 wrapper, which plays the file"),
    (b"", ".svo2", "a recording of a ZED camera", "an MCAP recording of its ROS 2 wrapper, which plays the file"),
    (b"\x89HDF\r\n", "", "an HDF5 file", "its images as a folder: HDF5 has no layout of its own for RGB-D video"),
    (b"", ".klg", "a log of Kintinuous or ElasticFusion", "its frames as a folder"),
    (b"PK\x03\x04", "", "a zip file", "the folder that it unpacks to"),
    (
        b"ply\n",
        "",
        "a PLY file, a point cloud or a saved map",
        "the recording it was made of; --load-memory continues a map",
    ),
];

/// Returns the error for a file that no format reads; `None` for a folder.
pub(crate) fn file_error(path: &Path) -> Option<DatasetError> {
    let mut head = Vec::new();
    if !path.is_file() || open_file(path).ok()?.take(HEAD_BYTES).read_to_end(&mut head).is_err() {
        return None;
    }
    Some(unknown_file(path, &head))
}

/// The error for a file of an unknown kind.
fn unknown_file(path: &Path, head: &[u8]) -> DatasetError {
    let name = path.to_string_lossy().to_ascii_lowercase();
    let is_it = |(start, ending, ..): &&(&[u8], &str, &str, &str)| {
        (!start.is_empty() && head.starts_with(start)) || (!ending.is_empty() && name.ends_with(ending))
    };
    let (found, expected) = match FOREIGN.iter().find(is_it) {
        Some((.., what, instead)) => ((*what).to_owned(), format!("{instead} (docs/FORMATS.md)")),
        None => {
            let shown = &head[..head.len().min(SHOWN_BYTES)];
            let start = if shown.is_empty() { "nothing".to_owned() } else { format!("\"{}\"", shown.escape_ascii()) };
            (format!("a file that begins with {start}"), format!("a recording: {FILES}; or a folder"))
        }
    };
    DatasetError::UnknownFile { path: path.to_owned(), found, expected }
}
