//! A writer for ROS 2 recordings.

use super::recording::{depth_units, jpeg_bytes};
use glam::{DQuat, DVec3};
use mcap::records::MessageHeader;
use serde::Serialize;
use splatseg_geometry::{Intrinsics, RgbdFrame};
use splatseg_ros::{
    CameraInfo, CompressedImage, Header, Image, Message, Quaternion, TfMessage, Time, Transform, TransformStamped,
    Vector3, to_cdr,
};
use std::collections::BTreeMap;
use std::io::Cursor;

pub const OPTICAL: &str = "camera_color_optical_frame";
/// The stamp of the first frame, nanoseconds.
pub const START: i64 = 1_700_000_000_000_000_000;
pub const FRAME_NS: i64 = 100_000_000;

/// An uncompressed recording.
pub struct McapWriter {
    writer: mcap::Writer<Cursor<Vec<u8>>>,
    channels: BTreeMap<String, u16>,
}

impl McapWriter {
    pub fn new() -> Self {
        let options = mcap::WriteOptions::new().compression(None).chunk_size(Some(2_000)).profile("ros2");
        Self { writer: options.create(Cursor::new(Vec::new())).unwrap(), channels: BTreeMap::new() }
    }

    pub fn write<M: Message + Serialize>(&mut self, topic: &str, message: &M, log_time: i64) {
        self.write_bytes::<M>(topic, &to_cdr(message).unwrap(), log_time);
    }

    pub fn write_bytes<M: Message>(&mut self, topic: &str, bytes: &[u8], log_time: i64) {
        let writer = &mut self.writer;
        let channel_id = *self.channels.entry(topic.to_owned()).or_insert_with(|| {
            let schema = M::INTERFACE.schema();
            let schema = writer.add_schema(M::INTERFACE.name, "ros2msg", schema.as_bytes()).unwrap();
            writer.add_channel(schema, topic, "cdr", &BTreeMap::new()).unwrap()
        });
        let (log_time, publish_time) = (log_time as u64, log_time as u64);
        let header = MessageHeader { channel_id, sequence: 0, log_time, publish_time };
        writer.write_to_known_channel(&header, bytes).unwrap();
    }

    /// Writes a message of a type without its definition.
    pub fn write_as(&mut self, topic: &str, type_name: &str, bytes: &[u8], log_time: i64) {
        let writer = &mut self.writer;
        let channel_id = *self.channels.entry(topic.to_owned()).or_insert_with(|| {
            let schema = writer.add_schema(type_name, "ros2msg", b"").unwrap();
            writer.add_channel(schema, topic, "cdr", &BTreeMap::new()).unwrap()
        });
        let (log_time, publish_time) = (log_time as u64, log_time as u64);
        let header = MessageHeader { channel_id, sequence: 0, log_time, publish_time };
        writer.write_to_known_channel(&header, bytes).unwrap();
    }

    pub fn finish(mut self) -> Vec<u8> {
        self.writer.finish().unwrap();
        self.writer.into_inner().into_inner()
    }
}

pub fn header(stamp: i64, frame: &str) -> Header {
    Header { stamp: Time::from_nanoseconds(stamp), frame_id: frame.to_owned() }
}

pub fn info(stamp: i64, frame: &str, camera: &Intrinsics) -> CameraInfo {
    let Intrinsics { fx, fy, cx, cy, width, height } = *camera;
    let [fx, fy, cx, cy] = [fx, fy, cx, cy].map(f64::from);
    CameraInfo {
        header: header(stamp, frame),
        width: width as u32,
        height: height as u32,
        distortion_model: "plumb_bob".to_owned(),
        d: vec![0.0; 5],
        k: [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0],
        p: [fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
        ..CameraInfo::default()
    }
}

pub fn transform(stamp: i64, parent: &str, child: &str, shift: DVec3, turn: DQuat) -> TfMessage {
    let [x, y, z, w] = turn.to_array();
    let rotation = Quaternion { x, y, z, w };
    let transform = Transform { translation: Vector3 { x: shift.x, y: shift.y, z: shift.z }, rotation };
    let child_frame_id = child.to_owned();
    TfMessage { transforms: vec![TransformStamped { header: header(stamp, parent), child_frame_id, transform }] }
}

/// Returns the pose of a frame's camera as a transform.
pub fn camera_transform(stamp: i64, parent: &str, child: &str, frame: &RgbdFrame) -> TfMessage {
    let pose = frame.world_from_camera();
    let turn = DQuat::from_mat3(&pose.rotation());
    transform(stamp, parent, child, pose.translation(), turn)
}

pub fn depth_bytes(frame: &RgbdFrame) -> Vec<u8> {
    depth_units(frame.depth(), 1000.0).iter().flat_map(|unit| unit.to_le_bytes()).collect()
}

pub fn raw<'a>(stamp: i64, frame_id: &str, encoding: &'a str, size: (usize, usize), data: &'a [u8]) -> Image<'a> {
    let step = (data.len() / size.1) as u32;
    let (width, height) = (size.0 as u32, size.1 as u32);
    Image { header: header(stamp, frame_id), height, width, encoding, is_bigendian: 0, step, data }
}

/// Parts of a recording to write.
#[derive(Clone, Copy)]
pub struct Parts {
    pub info: bool,
    pub depth: bool,
    pub poses: bool,
}

pub const ALL: Parts = Parts { info: true, depth: true, poses: true };

/// Writes frames as recorded by a camera, with its pose in `world`: JPEG, depth in millimetres, registered.
pub fn write_frames(writer: &mut McapWriter, frames: &[&RgbdFrame], parts: Parts) {
    for (frame, index) in frames.iter().zip(0i64..) {
        let stamp = START + index * FRAME_NS;
        if parts.poses {
            writer.write("/tf", &camera_transform(stamp, "world", OPTICAL, frame), stamp);
        }
        if parts.info {
            writer.write("/camera/camera_info", &info(stamp, OPTICAL, frame.intrinsics()), stamp);
        }
        let jpeg = jpeg_bytes(frame.color());
        let color = CompressedImage { header: header(stamp, OPTICAL), format: "jpeg", data: &jpeg };
        writer.write("/camera/image_raw/compressed", &color, stamp);
        if parts.depth {
            let data = depth_bytes(frame);
            writer.write("/camera/depth", &raw(stamp, OPTICAL, "16UC1", frame.depth().size(), &data), stamp);
        }
    }
}

/// Returns a complete recording of frames.
pub fn recording_of(frames: &[&RgbdFrame]) -> Vec<u8> {
    let mut writer = McapWriter::new();
    write_frames(&mut writer, frames, ALL);
    writer.finish()
}

/// Sets the CRC of every chunk in a recording to 0, which means none.
pub fn without_checksums(mut bytes: Vec<u8>) -> Vec<u8> {
    let mut at = 8;
    while at + 9 < bytes.len() - 8 {
        let len = u64::from_le_bytes(bytes[at + 1..at + 9].try_into().unwrap()) as usize;
        if bytes[at] == 6 {
            bytes[at + 33..at + 37].fill(0);
        }
        at += 9 + len;
    }
    bytes
}
