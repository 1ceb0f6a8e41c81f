//! Small scenes on disk, valid until a test damages them.
#![allow(dead_code)] // The test of memory and the example use a part.

pub mod bag;
pub mod mcap;
pub mod mkv;
pub mod mvpd;
pub mod orbbec;
pub mod phones;
pub mod recording;
pub mod sens;
pub mod two_ways;
pub mod warnings;

use image::{ExtendedColorType, ImageEncoder};
use proptest::sample::Index;
use splatseg_test_scenes::file_contents;
use std::fs;
use std::path::{Path, PathBuf};

/// Returns a recognisable pose with translation (number, 2, 3).
pub fn pose_text(number: usize) -> String {
    format!("1 0 0 {number}\n0 1 0 2\n0 0 1 3\n0 0 0 1\n")
}

/// Returns a smooth picture: red increases to the right, green downwards.
pub fn write_color(path: &Path, width: u32, height: u32) {
    let image = image::RgbImage::from_fn(width, height, |x, y| {
        image::Rgb([(255 * x / width) as u8, (255 * y / height) as u8, 9])
    });
    image.save(path).unwrap();
}

/// Encodes a 16-bit grey PNG of `value(column, row)`.
pub fn write_png16(path: &Path, (width, height): (u32, u32), value: impl Fn(u32, u32) -> u16) {
    let image: image::ImageBuffer<image::Luma<u16>, Vec<u16>> =
        image::ImageBuffer::from_fn(width, height, |x, y| image::Luma([value(x, y)]));
    image.save(path).unwrap();
}

/// Writes a 7-Scenes sequence of 64x48 pixels with depth of 1 m plus a millimetre per column, and frames 0, 10, 20...
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

/// Writes a ScanNet scene with focal lengths of one image width. Labels are 1 on the left half and 2 on the right.
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

/// Changes some bytes and cuts off the rest.
pub fn damaged(mut bytes: Vec<u8>, changes: &[(Index, u8)], keep: &Index) -> Vec<u8> {
    for (at, value) in changes {
        let at = at.index(bytes.len());
        bytes[at] = *value;
    }
    bytes.truncate(keep.index(2 * bytes.len()));
    bytes
}

/// Truncates a file to its first half.
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

/// Returns the folder of shared data, or prints that `test` was skipped and returns `None`.
pub fn shared_data(test: &str, part: &str) -> Option<PathBuf> {
    splatseg_test_scenes::shared(&format!("data/{part}"), test)
}

/// Replaces each of a scene's files in turn by a FIFO and then by a link to `/dev/zero`. Opening and reading the scene
/// at `path` must end each time, and the errors must name the file that is not regular.
#[cfg(unix)]
pub fn assert_special_files_are_refused(folder: &Path, path: &Path) {
    for (file, bytes) in file_contents(folder) {
        let file = folder.join(file);
        for kind in ["FIFO", "device"] {
            fs::remove_file(&file).unwrap();
            if kind == "FIFO" {
                assert!(std::process::Command::new("mkfifo").arg(&file).status().unwrap().success());
            } else {
                std::os::unix::fs::symlink("/dev/zero", &file).unwrap();
            }
            let (sender, receiver) = std::sync::mpsc::channel();
            let path = path.to_owned();
            // Not joined, because a hanging reader must not hang the test.
            std::thread::spawn(move || sender.send(all_errors_of(&path)));
            let told = receiver.recv_timeout(std::time::Duration::from_secs(10));
            let told = told.unwrap_or_else(|_| panic!("{}: a {kind} is read for ever", file.display()));
            for error in told.iter().filter(|error| error.contains("a regular file")) {
                assert!(error.contains(&format!("{}: ", file.display())), "{error}");
            }
        }
        fs::remove_file(&file).unwrap();
        fs::write(&file, bytes).unwrap();
    }
    assert_eq!(all_errors_of(path), Vec::<String>::new(), "the scene is whole again");
}

/// Opens a scene, reads all of it, and returns the errors.
fn all_errors_of(path: &Path) -> Vec<String> {
    let scene = match splatseg_dataset::open_scene(path, &splatseg_dataset::DatasetSettings::default()) {
        Ok(scene) => scene,
        Err(error) => return vec![error.to_string()],
    };
    let mut errors = Vec::new();
    for index in 0..scene.frame_count() {
        errors.extend(scene.read_frame(index).err().map(|error| error.to_string()));
        errors.extend(scene.read_ground_truth(index).err().map(|error| error.to_string()));
    }
    errors
}
