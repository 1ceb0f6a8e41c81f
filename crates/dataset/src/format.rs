//! The names of the formats.

use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;
use thiserror::Error;

/// The format of a scene.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Format {
    /// Recognised by the scene's files.
    #[default]
    #[serde(rename = "auto")]
    Auto,
    /// A sequence of 7-Scenes.
    #[serde(rename = "7scenes")]
    SevenScenes,
    /// A ScanNet scene exported to folders.
    #[serde(rename = "scannet")]
    Scannet,
    /// A ScanNet recording in its published container, `<scene>.sens`, or a folder with one.
    #[serde(rename = "sens")]
    Sens,
    /// A sequence of TUM RGB-D.
    #[serde(rename = "tum")]
    Tum,
    /// A Replica scene in the layout of NICE-SLAM.
    #[serde(rename = "replica")]
    Replica,
    /// A video of MVPd, in a split's folder or a scene's `.tar.gz`. Of several videos one is chosen by its name, as
    /// `FOLDER:VIDEO`, `FOLDER/imagesRGB/VIDEO` or `SCENE.tar.gz:VIDEO`.
    #[serde(rename = "mvpd")]
    Mvpd,
    /// The built-in synthetic room.
    #[serde(rename = "synthetic")]
    Synthetic,
}

impl Format {
    /// Every format, [`Format::Auto`] first, in the order in which they are tried.
    pub const ALL: [Self; 8] = [
        Self::Auto,
        Self::SevenScenes,
        Self::Scannet,
        Self::Sens,
        Self::Tum,
        Self::Replica,
        Self::Mvpd,
        Self::Synthetic,
    ];

    /// The name in settings and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::SevenScenes => "7scenes",
            Self::Scannet => "scannet",
            Self::Sens => "sens",
            Self::Tum => "tum",
            Self::Replica => "replica",
            Self::Mvpd => "mvpd",
            Self::Synthetic => "synthetic",
        }
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

impl fmt::Display for Format {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.pad(self.name())
    }
}

impl FromStr for Format {
    type Err = FormatNameError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Self::ALL
            .into_iter()
            .find(|format| format.name() == text)
            .ok_or_else(|| FormatNameError { found: text.to_owned(), expected: Self::ALL.map(Self::name).join(", ") })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_the_same_in_text_and_serde() {
        for format in Format::ALL {
            assert_eq!(format.to_string().parse(), Ok(format));
            assert_eq!(serde_json::to_string(&format).unwrap(), format!("\"{format}\""));
        }
        let error = "kitti".parse::<Format>().unwrap_err();
        let names = "auto, 7scenes, scannet, sens, tum, replica, mvpd, synthetic";
        assert_eq!(error.to_string(), format!("format: found \"kitti\", expected one of {names}"));
    }
}
