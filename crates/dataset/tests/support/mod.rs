//! Small scenes on disk, valid until a test damages them.
#![allow(dead_code)] // Each test file uses a part.

pub mod recording;
pub mod sens;

use image::{ExtendedColorType, ImageEncoder};
use proptest::sample::Index;
use std::fs;
use std::path::{Path, PathBuf};

/// A pose that is easy to recognise: translation (number, 2, 3).
pub fn pose_text(number: usize) -> String {
    format!("1 0 0 {number}\n0 1 0 2\n0 0 1 3\n0 0 0 1\n")
}

/// A smooth picture: red grows to the right, green downwards.
pub fn write_color(path: &Path, width: u32, height: u32) {
    let image = image::RgbImage::from_fn(width, height, |x, y| {
        image::Rgb([(255 * x / width) as u8, (255 * y / height) as u8, 9])
    });
    image.save(path).unwrap();
}

/// A 16-bit grey PNG of `value(column, row)`.
pub fn write_png16(path: &Path, (width, height): (u32, u32), value: impl Fn(u32, u32) -> u16) {
    let image: image::ImageBuffer<image::Luma<u16>, Vec<u16>> =
        image::ImageBuffer::from_fn(width, height, |x, y| image::Luma([value(x, y)]));
    image.save(path).unwrap();
}

/// A 7-Scenes sequence of 64x48 pixels whose depth is 1 m plus a millimetre for each column, with frames 0, 10, 20...
pub fn write_sevenscenes(folder: &Path, frames: usize) {
    fs::create_dir_all(folder).unwrap();
    fs::write(folder.join("camera-intrinsics.txt"), "5.0e1 0 3.15e1\n0 50 23.5\n0 0 1\n").unwrap();
    for frame in 0..frames {
        let part = |ending: &str| folder.join(format!("frame-{:06}.{ending}", 10 * frame));
        write_color(&part("color.jpg"), 64, 48);
        write_png16(&part("depth.png"), (64, 48), |x, y| match (x, y) {
            (0, 0) => 0,
            (1, 0) => 65535,
            _ => 1000 + x as u16,
        });
        fs::write(part("pose.txt"), pose_text(frame)).unwrap();
    }
}

/// Sizes of a ScanNet scene, `(width, height)`.
pub struct ScannetSizes {
    pub color: (u32, u32),
    pub depth: (u32, u32),
    pub labels: (u32, u32),
}

fn matrix4(width: u32, height: u32) -> String {
    let (cx, cy) = ((width as f32 - 1.0) / 2.0, (height as f32 - 1.0) / 2.0);
    format!("{width} 0 {cx} 0\n0 {width} {cy} 0\n0 0 1 0\n0 0 0 1\n")
}

/// A ScanNet scene with focal lengths of one image width; labels are 1 on the left half and 2 on the right.
pub fn write_scannet(folder: &Path, frames: usize, sizes: &ScannetSizes) {
    for part in ["color", "depth", "pose", "intrinsic", "instance-filt"] {
        fs::create_dir_all(folder.join(part)).unwrap();
    }
    fs::write(folder.join("intrinsic/intrinsic_color.txt"), matrix4(sizes.color.0, sizes.color.1)).unwrap();
    fs::write(folder.join("intrinsic/intrinsic_depth.txt"), matrix4(sizes.depth.0, sizes.depth.1)).unwrap();
    for frame in 0..frames {
        write_color(&folder.join(format!("color/{frame}.jpg")), sizes.color.0, sizes.color.1);
        write_png16(&folder.join(format!("depth/{frame}.png")), sizes.depth, |_, _| 2000);
        let half = sizes.labels.0 / 2;
        write_png16(&folder.join(format!("instance-filt/{frame}.png")), sizes.labels, |x, _| 1 + u16::from(x >= half));
        fs::write(folder.join(format!("pose/{frame}.txt")), pose_text(frame)).unwrap();
    }
}

/// The bytes with some changed and the rest cut off.
pub fn damaged(mut bytes: Vec<u8>, changes: &[(Index, u8)], keep: &Index) -> Vec<u8> {
    for (at, value) in changes {
        let at = at.index(bytes.len());
        bytes[at] = *value;
    }
    bytes.truncate(keep.index(2 * bytes.len()));
    bytes
}

/// Keeps only the first half of a file.
pub fn truncate(path: &Path) {
    let bytes = fs::read(path).unwrap();
    fs::write(path, &bytes[..bytes.len() / 2]).unwrap();
}

/// Writes a PNG whose header claims another size than its data has.
pub fn write_lying_png(path: &Path, claimed: (u32, u32)) {
    let mut bytes = Vec::new();
    image::codecs::png::PngEncoder::new(&mut bytes)
        .write_image(&[0u8; 2 * 16 * 16], 16, 16, ExtendedColorType::L16)
        .unwrap();
    bytes[16..20].copy_from_slice(&claimed.0.to_be_bytes());
    bytes[20..24].copy_from_slice(&claimed.1.to_be_bytes());
    let checksum = crc32fast::hash(&bytes[12..29]);
    bytes[29..33].copy_from_slice(&checksum.to_be_bytes());
    fs::write(path, bytes).unwrap();
}

/// The folder of shared data, or `None` with a line that says that `test` was skipped.
pub fn shared_data(test: &str, part: &str) -> Option<PathBuf> {
    let path = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data")).join(part);
    if path.exists() {
        return Some(path);
    }
    // Not `println!`: the test runner would swallow the line of a test that passes.
    let _ = std::io::Write::write_all(
        &mut std::io::stderr(),
        format!("\nskipped: {test}: ../shared is not here\n").as_bytes(),
    );
    None
}
