//! The names of the formats.

use splatseg_settings::{Choice, choices};
use std::str::FromStr;
use thiserror::Error;

choices! {
    /// The format of a scene.
    pub enum Format, default Auto {
        /// Recognised by the scene's files.
        Auto = "auto",
        /// A sequence of 7-Scenes.
        SevenScenes = "7scenes",
        /// A ScanNet scene exported to folders.
        Scannet = "scannet",
        /// A ScanNet recording in its published container, `<scene>.sens`, or a folder with one.
        Sens = "sens",
        /// A sequence of TUM RGB-D.
        Tum = "tum",
        /// A Replica scene in the layout of NICE-SLAM.
        Replica = "replica",
        /// A video of MVPd, in a split's folder or a scene's `.tar.gz`. Of several videos one is chosen by its name, as
        /// `FOLDER:VIDEO`, `FOLDER/imagesRGB/VIDEO` or `SCENE.tar.gz:VIDEO`.
        Mvpd = "mvpd",
        /// A folder that anyone can make: `color/`, `depth/`, `camera.json` and `poses.txt`, as FOLDER_FORMAT.md describes it.
        Folder = "folder",
        /// A recording of ROS 2 messages in an MCAP file, or a folder with one, as rosbag2 writes it.
        Mcap = "mcap",
        /// The built-in synthetic room.
        Synthetic = "synthetic",
    }
}

/// Text that is not the name of a format.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[error("format: found {found:?}, expected one of {expected}")]
pub struct FormatNameError {
    /// The text.
    pub found: String,
    /// The names of the formats.
    pub expected: String,
}

impl FromStr for Format {
    type Err = FormatNameError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Self::from_name(text)
            .ok_or_else(|| FormatNameError { found: text.to_owned(), expected: Self::NAMES.join(", ") })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_the_same_in_text_and_serde() {
        for format in Format::ALL.iter().copied() {
            assert_eq!(format.to_string().parse(), Ok(format));
            assert_eq!(serde_json::to_string(&format).unwrap(), format!("\"{format}\""));
        }
        let error = "kitti".parse::<Format>().unwrap_err();
        let names = "auto, 7scenes, scannet, sens, tum, replica, mvpd, folder, mcap, synthetic";
        assert_eq!(error.to_string(), format!("format: found \"kitti\", expected one of {names}"));
    }
}
