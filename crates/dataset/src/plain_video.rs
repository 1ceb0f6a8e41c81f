//! Videos of colour alone, which are not scenes, told by their first bytes.

use crate::files::open_file;
use std::io::Read;
use std::path::Path;

/// Returns true if a file is a video in a usual container: MP4 and QuickTime, Matroska and WebM, or AVI.
pub(crate) fn is_video(path: &Path) -> bool {
    let mut start = [0; 12];
    let is_read = path.is_file() && open_file(path).is_ok_and(|mut file| file.read_exact(&mut start).is_ok());
    let is_mp4 = start[4..8] == *b"ftyp";
    let is_matroska = start[..4] == [0x1A, 0x45, 0xDF, 0xA3];
    let is_avi = start[..4] == *b"RIFF" && start[8..] == *b"AVI ";
    is_read && (is_mp4 || is_matroska || is_avi)
}
