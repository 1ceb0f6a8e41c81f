//! What the synthetic room is like, and how that is written on a command line.

use super::Noise;
use crate::DatasetError;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::path::Path;
use std::str::FromStr;

/// How the synthetic room is asked for, for messages.
pub(crate) const LAYOUT: &str = "the word synthetic, or synthetic:frames=60,seed=0,width=320,height=240,objects=20,noise=none \
                                 with any of these settings (noise: none or kinect)";

const PREFIX: &str = "synthetic";
const SIDE: std::ops::RangeInclusive<usize> = 8..=4096;
const OBJECTS: std::ops::RangeInclusive<usize> = 0..=60;
const FRAMES: std::ops::RangeInclusive<usize> = 1..=1_000_000;

/// What the synthetic room is like. Written `synthetic:frames=60,seed=3,width=320,height=240,objects=20,noise=kinect`,
/// where everything has a default.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SyntheticSettings {
    /// Image width, pixels, 8 to 4096. Default: 320.
    pub width: usize,
    /// Image height, pixels, 8 to 4096. Default: 240.
    pub height: usize,
    /// Number of frames, 1 to 1,000,000; a round of the camera takes 48. Default: 60.
    pub frames: usize,
    /// Decides what stands where and how it looks. Default: 0.
    pub seed: u64,
    /// Number of things in the room, 0 to 60, besides floor, ceiling and four walls. Default: 20.
    pub objects: usize,
    /// How frames are disturbed. Default: not at all.
    pub noise: Noise,
}

impl Default for SyntheticSettings {
    fn default() -> Self {
        Self { width: 320, height: 240, frames: 60, seed: 0, objects: 20, noise: Noise::None }
    }
}

/// Whether a path asks for the synthetic room.
pub(crate) fn looks_like(path: &Path) -> bool {
    path.to_str()
        .and_then(|text| text.strip_prefix(PREFIX))
        .is_some_and(|rest| rest.is_empty() || rest.starts_with(':'))
}

impl SyntheticSettings {
    /// Checks that every setting is in its range.
    ///
    /// # Errors
    /// [`DatasetError::Synthetic`] names the setting, what was found and what was expected.
    pub fn validate(&self) -> Result<(), DatasetError> {
        let checks = [
            ("width", self.width, SIDE, "8 to 4096"),
            ("height", self.height, SIDE, "8 to 4096"),
            ("frames", self.frames, FRAMES, "1 to 1000000"),
            ("objects", self.objects, OBJECTS, "0 to 60"),
        ];
        for (field, found, range, expected) in checks {
            if !range.contains(&found) {
                let (text, found) = (self.to_string(), found.to_string());
                return Err(DatasetError::Synthetic { text, field: field.to_owned(), found, expected });
            }
        }
        Ok(())
    }
}

impl fmt::Display for SyntheticSettings {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let noise = match self.noise {
            Noise::None => "none",
            Noise::Kinect => "kinect",
        };
        let Self { width, height, frames, seed, objects, .. } = self;
        write!(
            formatter,
            "{PREFIX}:frames={frames},seed={seed},width={width},height={height},objects={objects},noise={noise}"
        )
    }
}

impl FromStr for SyntheticSettings {
    type Err = DatasetError;

    fn from_str(text: &str) -> Result<Self, DatasetError> {
        let wrong = |field: &str, found: &str, expected| DatasetError::Synthetic {
            text: text.to_owned(),
            field: field.to_owned(),
            found: found.to_owned(),
            expected,
        };
        let rest = text.strip_prefix(PREFIX).ok_or_else(|| wrong("scene", text, LAYOUT))?;
        let list = match rest.strip_prefix(':') {
            Some(list) => list,
            None if rest.is_empty() => "",
            None => return Err(wrong("scene", text, LAYOUT)),
        };
        let mut settings = Self::default();
        for item in list.split(',').filter(|item| !item.is_empty()) {
            let (key, value) = item.split_once('=').ok_or_else(|| wrong("setting", item, "key=value"))?;
            let number = || value.parse::<usize>().map_err(|_| wrong(key, value, "a whole number"));
            match key {
                "width" => settings.width = number()?,
                "height" => settings.height = number()?,
                "frames" => settings.frames = number()?,
                "objects" => settings.objects = number()?,
                "seed" => settings.seed = value.parse().map_err(|_| wrong(key, value, "a whole number"))?,
                "noise" => {
                    settings.noise = match value {
                        "none" => Noise::None,
                        "kinect" => Noise::Kinect,
                        _ => return Err(wrong(key, value, "none or kinect")),
                    }
                }
                _ => return Err(wrong("setting", key, "width, height, frames, seed, objects or noise")),
            }
        }
        settings.validate()?;
        Ok(settings)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_and_settings_agree() {
        assert_eq!("synthetic".parse::<SyntheticSettings>().unwrap(), SyntheticSettings::default());
        let text = "synthetic:frames=7,seed=3,width=64,height=48,objects=5,noise=kinect";
        assert_eq!(text.parse::<SyntheticSettings>().unwrap().to_string(), text);
        assert!(looks_like(Path::new(text)) && looks_like(Path::new("synthetic")));
        assert!(!looks_like(Path::new("./synthetic")) && !looks_like(Path::new("synthetic-rooms")));
    }

    #[test]
    fn mistakes_are_named() {
        let error = |text: &str| text.parse::<SyntheticSettings>().unwrap_err().to_string();
        assert!(error("synthetic:frames=x").contains("frames: found \"x\", expected a whole number"));
        assert!(error("synthetic:frames=0").contains("expected 1 to 1000000"));
        assert!(error("synthetic:colour=1").contains("found \"colour\""));
        assert!(error("synthetic:noise=loud").contains("none or kinect"));
        assert!(error("synthetic:noise").contains("key=value"));
    }
}
