//! Videos, which are not scenes, told by their first bytes.

use crate::DatasetError;
use crate::files::open_file;
use std::io::Read;
use std::path::Path;

/// Azure Kinect's tags and attachments come before the images.
const HEAD_BYTES: u64 = 1 << 20;
/// Start of the names of Azure Kinect's tags.
const KINECT_TAG: &[u8] = b"K4A_";

/// Returns the error for a video in a usual container: MP4 and QuickTime, Matroska and WebM, or AVI; `None` for other files.
pub(crate) fn video_error(path: &Path) -> Option<DatasetError> {
    let mut head = Vec::new();
    if !path.is_file() || open_file(path).ok()?.take(HEAD_BYTES).read_to_end(&mut head).is_err() {
        return None;
    }
    let is_mp4 = head.get(4..8) == Some(b"ftyp");
    let is_matroska = head.starts_with(&[0x1A, 0x45, 0xDF, 0xA3]);
    let is_avi = head.starts_with(b"RIFF") && head.get(8..12) == Some(b"AVI ");
    if is_matroska && head.windows(KINECT_TAG.len()).any(|window| window == KINECT_TAG) {
        return Some(DatasetError::Field {
            path: path.to_owned(),
            field: "format".to_owned(),
            found: "a recording of Azure Kinect, which is not read yet".to_owned(),
            expected: "its colour and depth, registered, as a folder (docs/FOLDER_FORMAT.md), or a recording of its ROS driver"
                .to_owned(),
        });
    }
    (is_mp4 || is_matroska || is_avi).then(|| DatasetError::PlainVideo { path: path.to_owned() })
}
