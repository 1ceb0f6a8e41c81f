//! A writer for `.sens` recordings.

use super::recording::{depth_units, jpeg_bytes, png_color_bytes};
use flate2::write::ZlibEncoder;
use splatseg_geometry::{CowImage, Intrinsics, RgbdFrame};
use std::io::Write;

/// Header fields and storage of the frames.
#[derive(Clone)]
pub struct SensWriter {
    pub version: u32,
    pub sensor: &'static str,
    pub color_intrinsics: Intrinsics,
    pub depth_intrinsics: Intrinsics,
    /// 0 raw, 1 PNG, 2 JPEG.
    pub color_compression: i32,
    /// 0 raw, 1 zlib.
    pub depth_compression: i32,
    pub depth_shift: f32,
}

impl SensWriter {
    /// JPEG and zlib, as in ScanNet, with the same camera for both images.
    pub fn new(camera: Intrinsics) -> Self {
        Self {
            version: 4,
            sensor: "StructureSensor",
            color_intrinsics: camera,
            depth_intrinsics: camera,
            color_compression: 2,
            depth_compression: 1,
            depth_shift: 1000.0,
        }
    }

    /// Returns everything before the first frame.
    pub fn header(&self, frames: u64) -> Vec<u8> {
        let mut bytes = self.version.to_le_bytes().to_vec();
        bytes.extend((self.sensor.len() as u64).to_le_bytes());
        bytes.extend(self.sensor.as_bytes());
        let identity = glam::Mat4::IDENTITY.to_cols_array();
        for matrix in [matrix(&self.color_intrinsics), identity, matrix(&self.depth_intrinsics), identity] {
            bytes.extend(matrix.iter().flat_map(|entry| entry.to_le_bytes()));
        }
        bytes.extend(self.color_compression.to_le_bytes());
        bytes.extend(self.depth_compression.to_le_bytes());
        for camera in [&self.color_intrinsics, &self.depth_intrinsics] {
            bytes.extend((camera.width as u32).to_le_bytes());
            bytes.extend((camera.height as u32).to_le_bytes());
        }
        bytes.extend(self.depth_shift.to_le_bytes());
        bytes.extend(frames.to_le_bytes());
        bytes
    }

    pub fn frame(&self, pose: [f32; 16], color: &CowImage<'_, [u8; 3]>, depth: &CowImage<'_, f32>) -> Vec<u8> {
        let color = match self.color_compression {
            0 => color.pixels().iter().flatten().copied().collect(),
            1 => png_color_bytes(color),
            _ => jpeg_bytes(color),
        };
        let units: Vec<u8> = depth_units(depth, self.depth_shift).iter().flat_map(|unit| unit.to_le_bytes()).collect();
        let depth = if self.depth_compression == 0 { units } else { zlib(&units) };
        frame_bytes(pose, &color, &depth)
    }

    /// Returns a complete recording, including the number of accelerometer measurements that ScanNet's writer appends.
    pub fn recording(&self, frames: &[&RgbdFrame]) -> Vec<u8> {
        let mut bytes = self.header(frames.len() as u64);
        for frame in frames {
            bytes.extend(self.frame(
                frame.world_from_camera().to_row_major().map(|number| number as f32),
                frame.color(),
                frame.depth(),
            ));
        }
        bytes.extend(0u64.to_le_bytes());
        bytes
    }
}

fn matrix(camera: &Intrinsics) -> [f32; 16] {
    let Intrinsics { fx, fy, cx, cy, .. } = *camera;
    [fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]
}

pub fn zlib(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = ZlibEncoder::new(Vec::new(), flate2::Compression::fast());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

pub fn frame_bytes(pose: [f32; 16], color: &[u8], depth: &[u8]) -> Vec<u8> {
    let mut bytes: Vec<u8> = pose.iter().flat_map(|entry| entry.to_le_bytes()).collect();
    for number in [11, 12, color.len() as u64, depth.len() as u64] {
        bytes.extend(number.to_le_bytes());
    }
    bytes.extend(color);
    bytes.extend(depth);
    bytes
}
