//! Settings of published benchmarks, by name.

use crate::{DatasetSettings, ImageSize};
use std::fmt;
use std::str::FromStr;
use thiserror::Error;

/// Settings for reading the scenes of a published benchmark. Start from them and change what you need:
///
/// ```
/// use splatseg_dataset::Preset;
/// let settings = Preset::ScannetMv.settings().with(|settings| settings.max_frames = Some(10));
/// assert_eq!((settings.stride, settings.crop_border), (20, 5));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Preset {
    /// `scannet-mv`, the paper's ScanNet-MV: every 20th frame, resized to 320x240 (width x height; the paper writes
    /// 240x320, height first), 5 pixels cropped on each side: 310x230.
    ScannetMv,
    /// `mvpd`, MVPd as the paper runs the splat methods on it: every frame, resized to 320x240. The benchmark also
    /// drops true segments under 0.1 % of the image from a frame. Set that when scoring, with `--min-truth-area 0.001`.
    Mvpd,
}

impl Preset {
    /// Every preset.
    pub const ALL: [Self; 2] = [Self::ScannetMv, Self::Mvpd];

    /// Returns the name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::ScannetMv => "scannet-mv",
            Self::Mvpd => "mvpd",
        }
    }

    /// Settings of the benchmark, with defaults for those it does not fix.
    pub fn settings(self) -> DatasetSettings {
        match self {
            Self::ScannetMv => DatasetSettings {
                stride: 20,
                resize: Some(ImageSize { width: 320, height: 240 }),
                crop_border: 5,
                ..DatasetSettings::default()
            },
            Self::Mvpd => {
                DatasetSettings { resize: Some(ImageSize { width: 320, height: 240 }), ..DatasetSettings::default() }
            }
        }
    }
}

/// Error parsing the name of a preset.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[error("preset: found {found:?}, expected {expected}")]
pub struct PresetNameError {
    /// The text.
    pub found: String,
    /// Names of the presets.
    pub expected: String,
}

impl fmt::Display for Preset {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.pad(self.name())
    }
}

impl FromStr for Preset {
    type Err = PresetNameError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Self::ALL
            .into_iter()
            .find(|preset| preset.name() == text)
            .ok_or_else(|| PresetNameError { found: text.to_owned(), expected: Self::ALL.map(Self::name).join(", ") })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_read_back_and_settings_are_the_papers() {
        for preset in Preset::ALL {
            assert_eq!(preset.to_string().parse(), Ok(preset));
            preset.settings().validate().unwrap();
        }
        let settings = Preset::ScannetMv.settings();
        assert_eq!(settings.selected_frames(50).unwrap(), [0, 20, 40]);
        assert_eq!(settings.framing().check((640, 480)).unwrap(), (310, 230));
        let settings = Preset::Mvpd.settings();
        assert_eq!(settings.selected_frames(3).unwrap(), [0, 1, 2]);
        assert_eq!(settings.framing().check((640, 480)).unwrap(), (320, 240));
        let error = "scannet".parse::<Preset>().unwrap_err();
        assert_eq!(error.to_string(), "preset: found \"scannet\", expected scannet-mv, mvpd");
    }
}
