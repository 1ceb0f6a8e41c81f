//! Frames of the synthetic room for tests to write in a format and read back.

pub use splatseg_test_scenes::recording;

use image::codecs::jpeg::JpegEncoder;
use image::{ExtendedColorType, ImageEncoder};
use splatseg_geometry::{CowImage, RgbdFrame, SegmentMap};
use std::io::Write;

pub fn jpeg_bytes(color: &CowImage<'_, [u8; 3]>) -> Vec<u8> {
    let pixels: Vec<u8> = color.pixels().iter().flatten().copied().collect();
    let mut bytes = Vec::new();
    JpegEncoder::new_with_quality(&mut bytes, 95)
        .encode(&pixels, color.width() as u32, color.height() as u32, ExtendedColorType::Rgb8)
        .unwrap();
    bytes
}

fn png_bytes(pixels: &[u8], (width, height): (usize, usize), kind: ExtendedColorType) -> Vec<u8> {
    let mut bytes = Vec::new();
    image::codecs::png::PngEncoder::new(&mut bytes).write_image(pixels, width as u32, height as u32, kind).unwrap();
    bytes
}

pub fn png_color_bytes(color: &CowImage<'_, [u8; 3]>) -> Vec<u8> {
    let pixels: Vec<u8> = color.pixels().iter().flatten().copied().collect();
    png_bytes(&pixels, color.size(), ExtendedColorType::Rgb8)
}

/// Returns depth as 16-bit integers with the given units per metre.
pub fn depth_units(depth: &CowImage<'_, f32>, units_per_metre: f32) -> Vec<u16> {
    depth.pixels().iter().map(|z| (z * units_per_metre).round() as u16).collect()
}

pub fn png_depth_bytes(depth: &CowImage<'_, f32>, units_per_metre: f32) -> Vec<u8> {
    let pixels: Vec<u8> = depth_units(depth, units_per_metre).iter().flat_map(|unit| unit.to_ne_bytes()).collect();
    png_bytes(&pixels, depth.size(), ExtendedColorType::L16)
}

pub fn png_label_bytes(labels: &SegmentMap) -> Vec<u8> {
    let pixels: Vec<u8> = labels.pixels().iter().map(|id| *id as u8).collect();
    png_bytes(&pixels, labels.size(), ExtendedColorType::L8)
}

/// Encodes ids in COCO's panoptic format: R + 256 G + 65536 B.
pub fn png_panoptic_bytes(labels: &SegmentMap) -> Vec<u8> {
    let pixels: Vec<u8> = labels.pixels().iter().flat_map(|id| id.to_le_bytes().into_iter().take(3)).collect();
    png_bytes(&pixels, labels.size(), ExtendedColorType::Rgb8)
}

/// Returns a zip file with these members.
pub fn zip_bytes(members: &[(String, Vec<u8>)]) -> Vec<u8> {
    let mut writer = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
    let options = zip::write::SimpleFileOptions::default().compression_method(zip::CompressionMethod::Deflated);
    for (name, bytes) in members {
        writer.start_file(name.as_str(), options).unwrap();
        writer.write_all(bytes).unwrap();
    }
    writer.finish().unwrap().into_inner()
}

/// Returns a tar.gz file with these members.
pub fn tar_gz_bytes(members: &[(String, Vec<u8>)]) -> Vec<u8> {
    let mut builder = tar::Builder::new(flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast()));
    for (name, bytes) in members {
        let mut header = tar::Header::new_gnu();
        header.set_size(bytes.len() as u64);
        header.set_mode(0o644);
        builder.append_data(&mut header, name, bytes.as_slice()).unwrap();
    }
    builder.into_inner().unwrap().finish().unwrap()
}

/// Tolerances for comparing a frame with the one written.
pub struct Tolerance {
    /// Largest difference of depth, metres.
    pub depth: f32,
    /// Mean difference of colour, of 255.
    pub color: f32,
}

/// Checks depth, colour and pose of a frame that was written and read back.
pub fn assert_same(read: &RgbdFrame, written: &RgbdFrame, tolerance: &Tolerance) {
    assert_eq!((read.width(), read.height()), (written.width(), written.height()));
    for (found, expected) in read.depth().pixels().iter().zip(written.depth().pixels()) {
        assert!((found - expected).abs() <= tolerance.depth, "depth {found}, written {expected}");
    }
    let difference = |(found, expected): (&[u8; 3], &[u8; 3])| -> f32 {
        (0..3).map(|channel| (f32::from(found[channel]) - f32::from(expected[channel])).abs()).sum()
    };
    let sum: f32 = read.color().pixels().iter().zip(written.color().pixels()).map(difference).sum();
    let mean = sum / (3 * read.color().pixels().len()) as f32;
    assert!(mean <= tolerance.color, "colour differs by {mean} on average");
    let (found, expected) = (read.world_from_camera().to_matrix(), written.world_from_camera().to_matrix());
    assert!((found - expected).abs_diff_eq(glam::DMat4::ZERO, 2e-5), "{found} {expected}");
}
