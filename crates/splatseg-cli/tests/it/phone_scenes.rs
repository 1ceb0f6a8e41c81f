//! Frames as programs of phones write them, with a camera of its own for each frame where the format has that.

use splatseg_geometry::{RgbdFrame, SegmentMap};
use std::fs;
use std::path::Path;

type Frames = [(RgbdFrame<'static>, SegmentMap)];

/// Writes a picture of bytes or of 16 bits, `(width, height)` that of the frame.
fn write(path: &Path, image: impl Into<image::DynamicImage>) {
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    image.into().save(path).unwrap();
}

fn color(frame: &RgbdFrame) -> image::RgbImage {
    let bytes = frame.color().pixels().iter().flatten().copied().collect();
    image::RgbImage::from_raw(frame.width() as u32, frame.height() as u32, bytes).unwrap()
}

/// Depth in whole millimetres.
fn depth(frame: &RgbdFrame) -> image::ImageBuffer<image::Luma<u16>, Vec<u16>> {
    image::ImageBuffer::from_fn(frame.width() as u32, frame.height() as u32, |column, row| {
        image::Luma([(1000.0 * frame.depth()[(column as usize, row as usize)]) as u16])
    })
}

/// The lowest confidence in the first column, the highest elsewhere.
fn confidence(frame: &RgbdFrame, highest: u8) -> image::GrayImage {
    image::GrayImage::from_fn(frame.width() as u32, frame.height() as u32, |column, _| {
        image::Luma([if column == 0 { 0 } else { highest }])
    })
}

/// Writes the raw data of Polycam.
pub fn write_polycam(folder: &Path, frames: &Frames) {
    let folder = folder.join("keyframes");
    for (index, (frame, _)) in frames.iter().enumerate() {
        let name = 262_195_552_056_u64 + 100_000 * index as u64;
        write(&folder.join(format!("images/{name}.jpg")), color(frame));
        write(&folder.join(format!("depth/{name}.png")), depth(frame));
        write(&folder.join(format!("confidence/{name}.png")), confidence(frame, 255));
        let (width, height) = (frame.width(), frame.height());
        let mut camera = serde_json::json!({
            "fx": 20.0 + index as f64 / 3.0, "fy": 21.0, "cx": 15.0, "cy": 11.5, "width": width, "height": height,
        });
        let matrix = frame.world_from_camera().to_matrix();
        for (row, column) in (0..3).flat_map(|row| (0..4).map(move |column| (row, column))) {
            camera[format!("t_{row}{column}")] = matrix.row(row)[column].into();
        }
        let cameras = folder.join("cameras");
        fs::create_dir_all(&cameras).unwrap();
        fs::write(cameras.join(format!("{name}.json")), camera.to_string()).unwrap();
    }
}

/// Writes a recording of Stray Scanner whose frames were extracted.
pub fn write_stray(folder: &Path, frames: &Frames) {
    let mut odometry = "timestamp, frame, x, y, z, qx, qy, qz, qw, fx, fy, cx, cy\n".to_owned();
    for (index, (frame, _)) in frames.iter().enumerate() {
        write(&folder.join(format!("rgb/{index:06}.png")), color(frame));
        write(&folder.join(format!("depth/{index:06}.png")), depth(frame));
        write(&folder.join(format!("confidence/{index:06}.png")), confidence(frame, 2));
        let [x, y, z] = frame.world_from_camera().translation().to_array();
        odometry +=
            &format!("{index}.5, {index:06}, {x}, {y}, {z}, 0.1, 0.1, 0.7, 0.7, {}.5, 21, 15, 11.5\n", 20 + index);
    }
    fs::write(folder.join("odometry.csv"), odometry).unwrap();
    fs::write(folder.join("camera_matrix.csv"), "20, 0, 15\n0, 21, 11.5\n0, 0, 1\n").unwrap();
}

/// Writes a scene of ARKitScenes.
pub fn write_arkitscenes(folder: &Path, frames: &Frames) {
    let mut trajectory = String::new();
    for (index, (frame, _)) in frames.iter().enumerate() {
        let name = format!("4_{index}.5");
        write(&folder.join(format!("lowres_wide/{name}.png")), color(frame));
        write(&folder.join(format!("lowres_depth/{name}.png")), depth(frame));
        let (width, height) = (frame.width(), frame.height());
        let cameras = folder.join("lowres_wide_intrinsics");
        fs::create_dir_all(&cameras).unwrap();
        let camera = format!("{width} {height} {}.25 21 15 11.5", 20 + index);
        fs::write(cameras.join(format!("{name}.pincam")), camera).unwrap();
        trajectory += &format!("{index}.5 0.1 0.2 0.3 1 2 {index}\n");
    }
    fs::write(folder.join("lowres_wide.traj"), trajectory).unwrap();
}
