//! The formats by name.

use splatseg_settings::{Choice, choices};
use std::str::FromStr;
use thiserror::Error;

choices! {
    /// The format of a scene.
    pub enum Format, default Auto {
        /// Detected from the scene's files.
        Auto = "auto",
        /// A 7-Scenes sequence.
        SevenScenes = "7scenes",
        /// A ScanNet scene exported to folders.
        Scannet = "scannet",
        /// A ScanNet recording in its published container, `<scene>.sens`, or a folder containing one.
        Sens = "sens",
        /// A TUM RGB-D sequence.
        Tum = "tum",
        /// A Replica scene in the layout of NICE-SLAM.
        Replica = "replica",
        /// An MVPd video, in a split's folder or a scene's `.tar.gz`. Choose one of several videos by name, as
        /// `FOLDER:VIDEO`, `FOLDER/imagesRGB/VIDEO` or `SCENE.tar.gz:VIDEO`.
        Mvpd = "mvpd",
        /// A plain folder with `color/` and `depth/`, and `camera.json` and `poses.txt` if there are any, described in
        /// FOLDER_FORMAT.md.
        Folder = "folder",
        /// A ROS 2 recording in an MCAP file, or a folder containing one, as written by rosbag2.
        Mcap = "mcap",
        /// A ROS 2 recording in a SQLite file, or a folder containing one, as written by rosbag2 and RealSense's SDK.
        Db3 = "db3",
        /// A recording of ROS 1, or a folder containing one.
        Bag = "bag",
        /// A recording of Azure Kinect or Orbbec Femto, as `k4arecorder` writes it, or a folder containing one.
        Mkv = "mkv",
        /// A Record3D recording, `.r3d`, or the folder it was unpacked to.
        R3d = "r3d",
        /// nerfstudio's `transforms.json` whose frames have `depth_file_path`, or a folder with it.
        Nerfstudio = "nerfstudio",
        /// Polycam's raw data: a folder with `keyframes/`.
        Polycam = "polycam",
        /// A Stray Scanner recording, with its video (needs `ffmpeg`) or extracted images.
        Stray = "stray",
        /// An ARKitScenes video, raw or of the 3DOD subset.
        ArkitScenes = "arkitscenes",
        /// A video without depth (needs `ffmpeg` and a depth predictor).
        Video = "video",
        /// A folder of images without depth (needs a depth predictor).
        Images = "images",
        /// The built-in synthetic room.
        Synthetic = "synthetic",
    }
}

impl Format {
    /// Returns true if its scenes are recordings of topics, which settings choose.
    pub const fn has_topics(self) -> bool {
        matches!(self, Self::Mcap | Self::Db3 | Self::Bag | Self::Mkv)
    }

    /// Returns true if its scenes may have depth that is not registered to colour.
    pub const fn registers_depth(self) -> bool {
        self.has_topics() || matches!(self, Self::SevenScenes)
    }

    /// Returns false if its scenes have no depth, so that it must be predicted.
    pub const fn has_depth(self) -> bool {
        !matches!(self, Self::Video | Self::Images)
    }

    /// Lists the formats with a property, for messages: `7scenes, mcap and bag`.
    pub(crate) fn listed(has: impl Fn(Self) -> bool) -> String {
        let names: Vec<&str> = Self::ALL.iter().filter(|format| has(**format)).map(|format| format.name()).collect();
        match names.split_last() {
            Some((last, others)) if !others.is_empty() => format!("{} and {last}", others.join(", ")),
            _ => names.concat(),
        }
    }
}

/// Error parsing the name of a format.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[error("format: found {found:?}, expected one of {expected}")]
pub struct FormatNameError {
    /// The text.
    pub found: String,
    /// Names of the formats.
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
        let names = "auto, 7scenes, scannet, sens, tum, replica, mvpd, folder, mcap, db3, bag, mkv, r3d, nerfstudio, polycam, stray, arkitscenes, video, images, synthetic";
        assert_eq!(error.to_string(), format!("format: found \"kitti\", expected one of {names}"));
    }
}
