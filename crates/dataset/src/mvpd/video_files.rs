//! The image files of a video.

use crate::DatasetError;
use crate::archive::UnpackedMembers;
use crate::decode::read_image_file;
use std::path::PathBuf;

/// Where the images of a video are. They are named as [`member`] says.
#[derive(Debug)]
pub(super) enum VideoFiles {
    /// The folder that holds `imagesRGB/` and the others.
    Folder(PathBuf),
    /// Members of a scene's archive.
    Archive {
        members: UnpackedMembers,
        /// What the archive puts before the names.
        prefix: String,
    },
}

/// The name of a video's image: `<folder>/<video>/<file>`.
pub(super) fn member(folder: &str, video: &str, file: &str) -> String {
    format!("{folder}/{video}/{file}")
}

impl VideoFiles {
    /// The path of an image, for messages.
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

    /// The bytes of an image. `what` names its content in errors.
    pub(super) fn read(&self, name: &str, what: &'static str) -> Result<Vec<u8>, DatasetError> {
        match self {
            Self::Folder(folder) => read_image_file(&folder.join(name), what),
            Self::Archive { members, prefix } => members.read(&format!("{prefix}{name}"), what),
        }
    }
}
