//! A scene as a recording of a camera.

use super::FRAME_INTERVAL;
use super::compression::Compression;
use super::recording::{Profile, Recording};
use crate::ros_messages::{self, CameraPose};
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};
use splatseg_geometry::{CameraFrame, CowImage, Pose};
use splatseg_ros::Time;
use std::io;
use std::path::Path;

/// Topic of the colour images.
const COLOR: &str = "/camera/color/image_raw/compressed";
/// Topic of the camera infos, beside the colour images, so that readers connect them.
const CAMERA_INFO: &str = "/camera/color/camera_info";
/// Topic of the depth images, with the name that camera drivers give to depth in the pixels of colour.
const DEPTH: &str = "/camera/aligned_depth_to_color/image_raw";
/// Topic of the camera's poses, beside `/tf`. A camera that does not move in `/tf` is taken for one without poses.
const POSE: &str = "/camera/pose";

/// Writes frames to an MCAP file as a camera would: what is read back equals what was written.
///
/// | topic | type | contents |
/// | --- | --- | --- |
/// | `/camera/color/image_raw/compressed` | `sensor_msgs/msg/CompressedImage` | colour, PNG |
/// | `/camera/color/camera_info` | `sensor_msgs/msg/CameraInfo` | the intrinsics of each frame |
/// | `/camera/aligned_depth_to_color/image_raw` | `sensor_msgs/msg/Image` | depth: `16UC1`, millimetres, if that is exact for all pixels of the frame, otherwise `32FC1`, metres |
/// | `/tf` | `tf2_msgs/msg/TFMessage` | `camera`, an optical frame, in `world`, if the frame has a pose |
/// | `/camera/pose` | `geometry_msgs/msg/TransformStamped` | the same |
///
/// The same frames and compression give the same bytes. One frame is in memory at a time.
pub struct SceneRecording {
    recording: Recording,
    counts: SceneCounts,
    /// Time of the latest frame, nanoseconds.
    latest: Option<i64>,
}

/// State of the recording of a scene.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SceneCounts {
    /// Number of frames.
    pub frames: usize,
    /// Number of frames with a pose.
    pub posed: usize,
    /// Number of frames whose depth is not whole millimetres.
    pub fractional_depth: usize,
    /// Number of frames that got another time, because theirs was not after that of the frame before.
    pub moved_in_time: usize,
}

impl SceneRecording {
    /// Starts a file; it appears at `path` only after [`Self::finish`].
    ///
    /// # Errors
    /// If no file can be written there.
    pub fn create(path: &Path, compression: Compression) -> io::Result<Self> {
        Ok(Self {
            recording: Recording::create(path, Profile::Ros2, compression)?,
            counts: SceneCounts::default(),
            latest: None,
        })
    }

    /// Writes the next frame and the pose of its camera, if it has one. A frame without a time, or with one that is not
    /// after the frame before, comes 1/30 s after that one, as readers sort by time; the first frame comes 1/30 s after time 0.
    ///
    /// # Errors
    /// If it cannot be written. [`io::ErrorKind::InvalidInput`] if its time is after 2038, where times in ROS 2 end.
    pub fn write(&mut self, frame: &CameraFrame<'_>, world_from_camera: Option<&Pose>) -> io::Result<()> {
        let time = self.next_time(frame)?;
        let stamp = Time::from_nanoseconds(time);
        if let Some(pose) = world_from_camera {
            let message = ros_messages::camera_pose(stamp, CameraPose::new(pose));
            self.recording.write("/tf", time, &message)?;
            for transform in &message.transforms {
                self.recording.write(POSE, time, transform)?;
            }
        }
        self.recording.write(CAMERA_INFO, time, &ros_messages::camera_info(stamp, frame.intrinsics())?)?;
        let png = encode_png(frame.color())?;
        self.recording.write(COLOR, time, &ros_messages::color_png(stamp, &png))?;
        let depth = ros_messages::DepthPixels::new(frame.depth().pixels());
        self.recording.write(DEPTH, time, &ros_messages::depth_image(stamp, frame.depth().size(), &depth)?)?;
        self.latest = Some(time);
        self.counts.frames += 1;
        self.counts.posed += usize::from(world_from_camera.is_some());
        self.counts.fractional_depth += usize::from(!depth.is_whole_millimetres());
        Ok(())
    }

    /// Returns the time of the next frame, nanoseconds.
    fn next_time(&mut self, frame: &CameraFrame<'_>) -> io::Result<i64> {
        let after_latest = self.latest.unwrap_or(0).saturating_add(FRAME_INTERVAL);
        let own = frame.timestamp().map(|time| i64::try_from(time.as_nanos()).unwrap_or(i64::MAX));
        let time = match own {
            Some(own) if self.latest.is_some_and(|latest| own <= latest) => {
                self.counts.moved_in_time += 1;
                after_latest
            }
            Some(own) => own,
            None => after_latest,
        };
        if Time::from_nanoseconds(time).nanoseconds() != time {
            let reason = format!("frame {}: its time is after 2038, where times in ROS 2 end", frame.name());
            return Err(io::Error::new(io::ErrorKind::InvalidInput, reason));
        }
        Ok(time)
    }

    /// Returns what was written so far.
    pub fn counts(&self) -> SceneCounts {
        self.counts
    }

    /// Writes the index and moves the file to its path.
    ///
    /// # Errors
    /// If that fails.
    pub fn finish(self) -> io::Result<()> {
        self.recording.finish()
    }
}

/// Encodes a colour image without loss. Its size is at most that of a frame, which PNG has room for.
fn encode_png(color: &CowImage<'_, [u8; 3]>) -> io::Result<Vec<u8>> {
    let (width, height) = color.size();
    let mut png = Vec::new();
    let encoder = PngEncoder::new_with_quality(&mut png, CompressionType::Fast, FilterType::Adaptive);
    let (width, height) = (ros_messages::number(width)?, ros_messages::number(height)?);
    let bytes = color.pixels().as_flattened();
    encoder.write_image(bytes, width, height, ExtendedColorType::Rgb8).map_err(io::Error::other)?;
    Ok(png)
}
