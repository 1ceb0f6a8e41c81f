//! Which frames of a scene are used, and how they are framed.

use crate::{Format, Framing, ImageSize};
use splatseg_settings::{Allowed, Choice, SettingError, settings};

settings! {
    /// How a scene is read. Frames are resized first, then cropped.
    pub struct DatasetSettings in "dataset" {
        /// The format of the scene; `auto` recognises it by its files.
        format: Format = Format::Auto, Allowed::Names(Format::NAMES);
        /// Position of the first frame used, in the sorted list of the scene's frames, counted from 0.
        start: usize = 0, Allowed::between(0.0, 1e9);
        /// Every how many frames one is used.
        stride: usize = 1, Allowed::between(1.0, 1e9);
        /// The most frames used; all if left out.
        max_frames: Option<usize> = None, Allowed::between(1.0, 1e9);
        /// The size that frames are resized to before cropping; their own if left out.
        resize: Option<ImageSize> = None, Allowed::Text("WIDTHxHEIGHT, sides of 1 to 4096 pixels");
        /// Without `resize`: frames of more pixels than this are made smaller, with the same aspect ratio. More detail
        /// takes memory and time, and no segmenter uses it.
        max_pixels: usize = 2_100_000, Allowed::between(1024.0, 67_108_864.0);
        /// Pixels cropped on each side, after resizing. The paper: 5.
        crop_border: usize = 0, Allowed::between(0.0, 8192.0);
        /// 7-Scenes as published: warp the depth, which its own camera took, into the colour camera, and move the poses,
        /// which are the depth camera's, there too. Otherwise the depth is registered already.
        register_depth: bool = false, Allowed::Switch;
        /// With `register_depth`: how far the colour camera stands to the right of the depth camera, metres. The default
        /// is that of the Kinect that recorded 7-Scenes.
        depth_offset_m: f32 = 0.025, Allowed::between(-1.0, 1.0), only "dataset.register_depth = true";
        /// MCAP: topic of the colour images; if left out, the only one that fits.
        color: Option<String> = None, Allowed::Text("a topic");
        /// MCAP: topic of the depth images; if left out, the only one that fits, or the only one in the colour camera's
        /// frame.
        depth: Option<String> = None, Allowed::Text("a topic");
        /// MCAP: topic of the colour camera's info; if left out, the one beside the images, or the only one of their frame.
        camera_info: Option<String> = None, Allowed::Text("a topic");
        /// MCAP: topic of the depth camera's info; found as that of colour is.
        depth_camera_info: Option<String> = None, Allowed::Text("a topic");
        /// MCAP: where poses come from: `/tf`, `/tf_static` for a camera that stands still, or a topic with odometry or
        /// poses. If left out, /tf if the camera moves in it, otherwise the only such topic.
        pose: Option<String> = None, Allowed::Text("a topic");
        /// MCAP: the frame of /tf in which poses are; if left out, the uppermost one above the camera's.
        world_frame: Option<String> = None, Allowed::Text("the name of a frame");
        /// MCAP: the frame whose poses a topic has, which /tf_static connects to the camera; if left out, the one that its
        /// messages name, otherwise the colour camera's.
        pose_frame: Option<String> = None, Allowed::Text("the name of a frame");
        /// MCAP: how far apart in time a colour and a depth image may be, and an image and a pose that has no pose on its
        /// other side, milliseconds.
        max_time_difference_ms: f64 = 20.0, Allowed::between(0.0, 60_000.0);
        /// MCAP: between two poses further apart in time than this nothing is interpolated, milliseconds.
        max_pose_gap_ms: f64 = 500.0, Allowed::between(0.0, 600_000.0);
    }
}

impl DatasetSettings {
    /// The indices of the frames used, of a scene with `frame_count` frames, increasing.
    ///
    /// # Errors
    /// If a setting is out of range or the first frame is past the end.
    pub fn selected_frames(&self, frame_count: usize) -> Result<Vec<usize>, SettingError> {
        self.validate()?;
        if let Some(size) = self.resize {
            self.framing().check((size.width, size.height))?;
        }
        if self.start >= frame_count {
            let expected = format!("less than {frame_count}, the scene's number of frames");
            return Err(SettingError { key: "dataset.start".to_owned(), found: self.start.to_string(), expected });
        }
        let most = self.max_frames.unwrap_or(usize::MAX);
        Ok((self.start..frame_count).step_by(self.stride).take(most).collect())
    }

    /// The first setting for recordings with topics that is given: its name and value.
    pub(crate) fn of_recordings(&self) -> Option<(&'static str, &str)> {
        let given = [
            ("color", &self.color),
            ("depth", &self.depth),
            ("camera_info", &self.camera_info),
            ("depth_camera_info", &self.depth_camera_info),
            ("pose", &self.pose),
            ("world_frame", &self.world_frame),
            ("pose_frame", &self.pose_frame),
        ];
        given.into_iter().find_map(|(name, value)| Some((name, value.as_deref()?)))
    }

    /// How every frame is resized and cropped.
    pub fn framing(&self) -> Framing {
        Framing { resize: self.resize, max_pixels: Some(self.max_pixels), crop_border: self.crop_border }
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
        let error = settings.selected_frames(2).unwrap_err();
        assert_eq!(error.to_string(), "dataset.start is 2, expected less than 2, the scene's number of frames");
    }

    #[test]
    fn impossible_settings_are_named() {
        let check = |settings: DatasetSettings| settings.selected_frames(9).unwrap_err().to_string();
        assert_eq!(
            check(DatasetSettings { stride: 0, ..Default::default() }),
            "dataset.stride is 0, expected 1 to 1000000000"
        );
        let resize = Some("0x0".parse().unwrap());
        assert_eq!(
            check(DatasetSettings { resize, ..Default::default() }),
            "dataset.resize is \"0x0\", expected WIDTHxHEIGHT, sides of 1 to 4096 pixels"
        );
        let resize = Some("20x10".parse().unwrap());
        assert_eq!(
            check(DatasetSettings { resize, crop_border: 5, ..Default::default() }),
            "dataset.crop_border is 5, expected less than half of 20x10 pixels, the frame's size"
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
