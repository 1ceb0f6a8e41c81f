//! The messages of a frame.

use super::{CAMERA, MAP, WORLD};
use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};
use splatseg_geometry::{Intrinsics, MAX_16_BIT_ID, Pose, SegmentMap};
use splatseg_ros::{
    CameraInfo, CompressedImage, Header, Image, Quaternion, RegionOfInterest, TfMessage, Time, Transform,
    TransformStamped, Vector3,
};
use std::io;

pub(super) fn in_camera(stamp: Time) -> Header {
    Header { stamp, frame_id: CAMERA.to_owned() }
}

/// Converts to the 32-bit number of a message.
pub(crate) fn number(value: usize) -> io::Result<u32> {
    u32::try_from(value).map_err(io::Error::other)
}

/// Pose of the camera, world from camera.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct CameraPose {
    at: DVec3,
    turn: DQuat,
}

impl CameraPose {
    /// Converts a pose.
    pub fn new(world_from_camera: &Pose) -> Self {
        let turn = DQuat::from_mat3(&world_from_camera.rotation()).normalize();
        Self { at: world_from_camera.translation(), turn }
    }

    /// The pose after a correction: new world coordinates from old ones, `None` if there is none.
    #[must_use]
    pub fn corrected(self, new_from_old: Option<&Pose>) -> Self {
        let Some(motion) = new_from_old else { return self };
        let turn = DQuat::from_mat3(&motion.rotation()) * self.turn;
        Self { at: motion.rotation() * self.at + motion.translation(), turn: turn.normalize() }
    }
}

/// The message of a camera's pose.
pub fn camera_pose(stamp: Time, CameraPose { at, turn }: CameraPose) -> TfMessage {
    let transform = Transform {
        translation: Vector3 { x: at.x, y: at.y, z: at.z },
        rotation: Quaternion { x: turn.x, y: turn.y, z: turn.z, w: turn.w },
    };
    let header = Header { stamp, frame_id: WORLD.to_owned() };
    TfMessage { transforms: vec![TransformStamped { header, child_frame_id: CAMERA.to_owned(), transform }] }
}

/// The message of the map's origin in the world.
pub fn map_origin(stamp: Time, origin: DVec3) -> TfMessage {
    let TfMessage { mut transforms } = camera_pose(stamp, CameraPose { at: origin, turn: DQuat::IDENTITY });
    transforms.iter_mut().for_each(|transform| MAP.clone_into(&mut transform.child_frame_id));
    TfMessage { transforms }
}

/// The message of the camera's intrinsics, without distortion.
///
/// # Errors
/// If a size does not fit into 32 bits.
pub fn camera_info(stamp: Time, camera: &Intrinsics) -> io::Result<CameraInfo> {
    let [fx, fy, cx, cy] = [camera.fx, camera.fy, camera.cx, camera.cy].map(f64::from);
    Ok(CameraInfo {
        header: in_camera(stamp),
        height: number(camera.height)?,
        width: number(camera.width)?,
        distortion_model: "plumb_bob".to_owned(),
        d: vec![0.0; 5],
        k: [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0],
        r: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        p: [fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
        binning_x: 0,
        binning_y: 0,
        roi: RegionOfInterest::default(),
    })
}

/// The message of an overlay; `jpeg` is a JPEG file.
pub fn overlay(stamp: Time, jpeg: &[u8]) -> CompressedImage<'_> {
    CompressedImage { header: in_camera(stamp), format: "jpeg", data: jpeg }
}

/// The message of a colour image; `png` is a PNG file of it.
pub fn color_png(stamp: Time, png: &[u8]) -> CompressedImage<'_> {
    CompressedImage { header: in_camera(stamp), format: "rgb8; png compressed rgb8", data: png }
}

/// The pixels of an id image, little-endian.
pub struct IdPixels {
    /// ROS name of the pixel format.
    encoding: &'static str,
    bytes_per_pixel: usize,
    bytes: Vec<u8>,
}

impl IdPixels {
    /// Pixels of 16 bits if all ids fit, otherwise of 32.
    pub fn new(segments: &SegmentMap) -> Self {
        let pixels = segments.pixels().iter();
        if pixels.clone().all(|id| *id <= MAX_16_BIT_ID) {
            let bytes = pixels.flat_map(|id| (*id as u16).to_le_bytes()).collect();
            return Self { encoding: "16UC1", bytes_per_pixel: 2, bytes };
        }
        // ROS has no unsigned 32-bit pixels; ids have fewer than 31 bits.
        Self { encoding: "32SC1", bytes_per_pixel: 4, bytes: pixels.flat_map(|id| id.to_le_bytes()).collect() }
    }
}

/// The message of an id image of `(width, height)` pixels.
///
/// # Errors
/// If a size does not fit into 32 bits.
pub fn id_image(stamp: Time, (width, height): (usize, usize), pixels: &IdPixels) -> io::Result<Image<'_>> {
    Ok(Image {
        header: in_camera(stamp),
        height: number(height)?,
        width: number(width)?,
        encoding: pixels.encoding,
        is_bigendian: 0,
        step: number(pixels.bytes_per_pixel * width)?,
        data: &pixels.bytes,
    })
}
