//! Access to the image files of a video.

use crate::DatasetError;
use crate::archive::UnpackedMembers;
use crate::decode::read_image_file;
use std::path::PathBuf;

/// Location of a video's images. [`member`] gives their names.
#[derive(Debug)]
pub(super) enum VideoFiles {
    /// Folder that contains `imagesRGB/` and the others.
    Folder(PathBuf),
    /// Members of a scene's archive.
    Archive {
        members: UnpackedMembers,
        /// Prefix of the names in the archive.
        prefix: String,
    },
}

/// Returns the name of a video's image, `<folder>/<video>/<file>`.
pub(super) fn member(folder: &str, video: &str, file: &str) -> String {
    format!("{folder}/{video}/{file}")
}

impl VideoFiles {
    /// Returns the path of an image, for messages.
    pub(super) fn path_of(&self, name: &str) -> PathBuf {
        match self {
            Self::Folder(folder) => folder.join(name),
            Self::Archive { members, prefix } => members.path_of(&format!("{prefix}{name}")),
        }
    }

    pub(super) fn contains(&self, name: &str) -> bool {
        match self {
            Self::Folder(folder) => folder.join(name).is_file(),
            Self::Archive { members, prefix } => members.contains(&format!("{prefix}{name}")),
        }
    }

    /// Reads an image file. `what` names its content in errors.
    pub(super) fn read(&self, name: &str, what: &'static str) -> Result<Vec<u8>, DatasetError> {
        match self {
            Self::Folder(folder) => read_image_file(&folder.join(name), what),
            Self::Archive { members, prefix } => members.read(&format!("{prefix}{name}"), what),
        }
    }
}
