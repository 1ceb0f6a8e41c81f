//! Which frames of a scene are used, and how they are framed.

use crate::error::MAX_SIDE;
use crate::{Format, Framing, ImageSize, SettingsError};
use serde::{Deserialize, Serialize};

/// How a scene is read. Frames are resized first, then cropped.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DatasetSettings {
    /// The format of the scene. Default: [`Format::Auto`], recognised by its files.
    pub format: Format,
    /// Position of the first frame used, in the sorted list of the scene's frames. Default: 0.
    pub start: usize,
    /// Every how many frames one is used. Default: 1.
    pub stride: usize,
    /// The most frames used. Default: all.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_frames: Option<usize>,
    /// The size, `"WIDTHxHEIGHT"` in pixels, that frames are resized to before cropping. Default: their own.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub resize: Option<ImageSize>,
    /// Pixels removed on each side, after resizing. Default: 0. (The paper: 5.)
    pub crop_border: usize,
    /// 7-Scenes as published: warp the depth, which its own camera took, into the colour camera, and move the poses,
    /// which are the depth camera's, there too. Default: false, the depth is registered already.
    pub register_depth: bool,
    /// With `register_depth`: how far the colour camera stands to the right of the depth camera, metres.
    /// Default: 0.025, as in the Kinect that recorded 7-Scenes.
    pub depth_offset_m: f32,
}

impl Default for DatasetSettings {
    fn default() -> Self {
        Self {
            format: Format::Auto,
            start: 0,
            stride: 1,
            max_frames: None,
            resize: None,
            crop_border: 0,
            register_depth: false,
            depth_offset_m: 0.025,
        }
    }
}

impl DatasetSettings {
    /// Checks what can be checked without a scene.
    ///
    /// # Errors
    /// [`SettingsError`] names the setting, what was found and what was expected.
    pub fn validate(&self) -> Result<(), SettingsError> {
        if self.stride == 0 {
            return Err(SettingsError::ZeroStride);
        }
        if self.max_frames == Some(0) {
            return Err(SettingsError::NoFrames);
        }
        if let Some(size) = self.resize {
            if !(1..=MAX_SIDE).contains(&size.width) || !(1..=MAX_SIDE).contains(&size.height) {
                return Err(SettingsError::Resize { width: size.width, height: size.height });
            }
            self.framing().check((size.width, size.height))?;
        }
        if self.depth_offset_m.is_nan() || self.depth_offset_m.abs() > 1.0 {
            return Err(SettingsError::DepthOffset(self.depth_offset_m));
        }
        Ok(())
    }

    /// The indices of the frames used, of a scene with `frame_count` frames, increasing.
    ///
    /// # Errors
    /// [`SettingsError`] if the settings are invalid or the first frame is past the end.
    pub fn selected_frames(&self, frame_count: usize) -> Result<Vec<usize>, SettingsError> {
        self.validate()?;
        if self.start >= frame_count {
            return Err(SettingsError::StartPastEnd { start: self.start, frames: frame_count });
        }
        let most = self.max_frames.unwrap_or(usize::MAX);
        Ok((self.start..frame_count).step_by(self.stride).take(most).collect())
    }

    /// How every frame is resized and cropped.
    pub fn framing(&self) -> Framing {
        Framing { resize: self.resize, crop_border: self.crop_border }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_selected_by_position() {
        let settings = DatasetSettings { start: 2, stride: 3, max_frames: Some(2), ..Default::default() };
        assert_eq!(settings.selected_frames(100).unwrap(), [2, 5]);
        assert_eq!(settings.selected_frames(4).unwrap(), [2]);
        assert_eq!(settings.selected_frames(2), Err(SettingsError::StartPastEnd { start: 2, frames: 2 }));
    }

    #[test]
    fn impossible_settings_are_named() {
        let check = |settings: DatasetSettings| settings.validate().unwrap_err().to_string();
        assert_eq!(check(DatasetSettings { stride: 0, ..Default::default() }), "stride: found 0, expected 1 or more");
        let resize = Some("0x0".parse().unwrap());
        assert_eq!(
            check(DatasetSettings { resize, ..Default::default() }),
            "resize: found 0x0, expected sides of 1 to 16384 pixels"
        );
        let resize = Some("20x10".parse().unwrap());
        assert_eq!(
            check(DatasetSettings { resize, crop_border: 5, ..Default::default() }),
            "crop_border: cutting 5 pixels on each side leaves nothing of 20x10"
        );
        assert!("320".parse::<ImageSize>().is_err() && "-1x4".parse::<ImageSize>().is_err());
    }

    #[test]
    fn settings_are_the_same_after_json() {
        let settings =
            DatasetSettings { resize: Some("320x240".parse().unwrap()), crop_border: 5, ..Default::default() };
        let text = serde_json::to_string(&settings).unwrap();
        assert!(text.contains("\"resize\":\"320x240\"") && text.contains("\"format\":\"auto\""), "{text}");
        assert_eq!(serde_json::from_str::<DatasetSettings>(&text).unwrap(), settings);
        assert_eq!(serde_json::from_str::<DatasetSettings>("{}").unwrap(), DatasetSettings::default());
        assert!(serde_json::from_str::<DatasetSettings>("{\"strides\": 2}").is_err());
    }
}
