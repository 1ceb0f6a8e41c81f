//! Selection and framing of a scene's frames.

use crate::pose_convention::{PoseConvention, QuaternionOrder};
use crate::{DepthRegistration, Format, Framing, ImageSize};
use splatseg_geometry::PoseFormat;
use splatseg_settings::{Allowed, Choice, SettingError, settings};

settings! {
    /// Settings for reading a scene. Frames are resized first, then cropped.
    pub struct DatasetSettings in "dataset" {
        /// Format of the scene; `auto` detects it from its files.
        format: Format = Format::Auto, Allowed::Names(Format::NAMES);
        /// Index of the first frame used, in the sorted list of the scene's frames, counted from 0.
        start: usize = 0, Allowed::between(0.0, 1e9);
        /// Use every Nth frame.
        stride: usize = 1, Allowed::between(1.0, 1e9);
        /// Maximum number of frames used; all if left out.
        max_frames: Option<usize> = None, Allowed::between(1.0, 1e9);
        /// Size that frames are resized to before cropping; their original size if left out.
        resize: Option<ImageSize> = None, Allowed::Text("WIDTHxHEIGHT, sides of 1 to 4096 pixels");
        /// Without `resize`: frames of more pixels than this are downscaled, keeping the aspect ratio. More detail
        /// takes memory and time, and no segmenter uses it.
        max_pixels: usize = 2_100_000, Allowed::between(1024.0, 67_108_864.0);
        /// Pixels cropped on each side, after resizing. The paper: 5.
        crop_border: usize = 0, Allowed::between(0.0, 8192.0);
        /// Focal length of the stored colour images along x, pixels, before they are resized and cropped. Needed for
        /// recordings without a calibration file. Where there is one, its focal lengths and principal point are
        /// replaced (ScanNet: those of both cameras).
        fx: Option<f64> = None, Allowed::above_up_to(0.0, 1e6);
        /// With `fx`: focal length along y, pixels; the same as `fx` if left out.
        fy: Option<f64> = None, Allowed::above_up_to(0.0, 1e6);
        /// With `fx`: column of the principal point, pixels, where the centre of the first pixel is 0; the image centre
        /// if left out.
        cx: Option<f64> = None, Allowed::between(-1e6, 1e6);
        /// With `fx`: row of the principal point, pixels; the image centre if left out.
        cy: Option<f64> = None, Allowed::between(-1e6, 1e6);
        /// Stored units of depth per metre, as in Open3D: 1000 for millimetres, 5000 for TUM RGB-D. If left out, that of the
        /// recording or its format: millimetres, if nothing else is known. Depth stored as numbers with a fraction is in
        /// metres, and is divided by this value, too.
        depth_scale: Option<f64> = None, DatasetSettings::DEPTH_SCALES;
        /// Depth from here on is missing, metres: where a renderer or driver writes its far plane instead of 0, or a sensor
        /// measures only noise.
        max_depth_m: Option<f64> = None, Allowed::above_up_to(0.0, 1e5);
        /// Register depth to colour. `true`, for 7-Scenes as published: warp the depth from its own camera into the colour
        /// camera, and convert the poses, which are those of the depth camera. `true`, for recordings: undistort each image by
        /// its own camera info, and warp depth from its frame and camera into those of colour. `false`: the pixels of depth
        /// are those of colour already. `auto`: for recordings as the camera infos say, with a warning where they are ambiguous;
        /// otherwise `false`.
        register_depth: DepthRegistration = DepthRegistration::Auto, Allowed::Names(DepthRegistration::NAMES);
        /// For 7-Scenes with `register_depth`: offset of the colour camera to the right of the depth camera, metres. The default is
        /// that of the Kinect that recorded 7-Scenes.
        depth_offset_m: f32 = 0.025, Allowed::between(-1.0, 1.0), only "dataset.register_depth = true";
        /// Convention of the recorded poses, in every format: a run warns if the images fit another choice.
        pose_convention: PoseConvention = PoseConvention::CameraToWorld, Allowed::Names(PoseConvention::NAMES);
        /// Order of the numbers in the quaternions of recorded poses.
        quaternion_order: QuaternionOrder = QuaternionOrder::Xyzw, Allowed::Names(QuaternionOrder::NAMES);
        /// Unit of the positions in recorded poses, metres: 0.01 for centimetres, 0.001 for millimetres.
        pose_scale: f64 = 1.0, Allowed::between(1e-6, 1e6);
        /// Recordings: topic of the colour images; if left out, the only suitable one.
        color: Option<String> = None, Allowed::Text("a topic");
        /// Recordings: topic of the depth images; if left out, the only suitable one, or the only one in the colour camera's
        /// frame. `none`: there is none, or it is not used; a depth predictor then predicts all depth.
        depth: Option<String> = None, Allowed::Text("a topic");
        /// Recordings: topic of the colour camera's info; if left out, the one next to the images, or the only one with their
        /// frame.
        camera_info: Option<String> = None, Allowed::Text("a topic");
        /// Recordings: topic of the depth camera's info; if left out, chosen like that of the colour camera.
        depth_camera_info: Option<String> = None, Allowed::Text("a topic");
        /// Recordings: source of the poses: `/tf`, `/tf_static` for a stationary camera, a topic with odometry or poses, or
        /// `none`. If left out, /tf if it moves the camera, otherwise the only such topic, otherwise none.
        pose: Option<String> = None, Allowed::Text("a topic");
        /// Recordings: the world frame in /tf; if left out, the topmost ancestor of the camera's frame, or a world below a camera
        /// that is on top.
        world_frame: Option<String> = None, Allowed::Text("the name of a frame");
        /// Recordings: the frame whose poses the topic gives, connected to the camera by /tf_static; if left out, the one
        /// named in its messages, otherwise the colour camera's. With /tf, whose frames nothing connects to the camera: the
        /// frame whose poses are taken for the camera's.
        pose_frame: Option<String> = None, Allowed::Text("the name of a frame");
        /// Recordings: topic with corrected paths (`nav_msgs/msg/Path`), of the same frame as the poses, or `none`; if left out,
        /// the only such topic.
        corrections: Option<String> = None, Allowed::Text("a topic");
        /// Recordings: maximum time between a colour and a depth image, and between an image and the nearest pose if it has
        /// poses on one side only, milliseconds.
        max_time_difference_ms: f64 = 20.0, Allowed::between(0.0, 60_000.0);
        /// Recordings: maximum time between two poses for interpolating between them, milliseconds.
        max_pose_gap_ms: f64 = 500.0, Allowed::between(0.0, 600_000.0);
    }
}

impl DatasetSettings {
    /// Values of [`depth_scale`](Self::depth_scale). Others are mistakes: all 16-bit depth would be below 7 cm, or all above
    /// a kilometre.
    pub const DEPTH_SCALES: Allowed = Allowed::between(0.001, 1e6);

    /// Value of [`depth`](Self::depth) if the depth of recordings and streams is not read.
    pub const NO_DEPTH: &str = "none";

    /// Returns the indices of the frames used from a scene with `frame_count` frames, in increasing order.
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

    /// Returns the name and value of the first given setting that only applies to recordings with topics.
    pub(crate) fn first_topic_setting(&self) -> Option<(&'static str, &str)> {
        let given = [
            ("color", &self.color),
            ("depth", &self.depth),
            ("camera_info", &self.camera_info),
            ("depth_camera_info", &self.depth_camera_info),
            ("pose", &self.pose),
            ("world_frame", &self.world_frame),
            ("pose_frame", &self.pose_frame),
            ("corrections", &self.corrections),
        ];
        given.into_iter().find_map(|(name, value)| Some((name, value.as_deref()?)))
    }

    /// Returns false if the depth of recordings and streams is not read.
    pub(crate) fn reads_depth_topic(&self) -> bool {
        self.depth.as_deref() != Some(Self::NO_DEPTH)
    }

    /// Returns how recorded poses are stated.
    pub fn pose_format(&self) -> PoseFormat {
        let (is_inverse, axes) = self.pose_convention.parts();
        let w_first = self.quaternion_order == QuaternionOrder::Wxyz;
        PoseFormat { w_first, scale: self.pose_scale, is_inverse, axes }
    }

    /// Returns what of every frame is used.
    pub fn framing(&self) -> Framing {
        let max_depth = self.max_depth_m.map(|metres| metres as f32);
        Framing { max_depth, resize: self.resize, max_pixels: Some(self.max_pixels), crop_border: self.crop_border }
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
