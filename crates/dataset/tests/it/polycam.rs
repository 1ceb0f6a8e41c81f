//! Polycam's raw data.

use crate::support::phones::*;
use crate::support::recording::png_color_bytes;
use crate::support::*;
use serde_json::{Value, json};
use splatseg_dataset::{DatasetSettings, Format, open_scene};
use splatseg_geometry::{Intrinsics, RgbdFrame};
use std::fs;
use std::path::Path;
use std::time::Duration;

/// Names of the frames: microseconds.
const TIMES: [u64; 3] = [262_195_552_056, 262_196_218_700, 262_196_885_400];

fn camera(index: usize) -> Intrinsics {
    Intrinsics { fx: 60.0 + index as f32, fy: 61.0, cx: 30.0, cy: 24.5, width: 64, height: 48 }
}

fn camera_file(frame: &RgbdFrame, index: usize) -> Value {
    let Intrinsics { fx, fy, cx, cy, width, height } = camera(index);
    let mut file =
        json!({"fx": fx, "fy": fy, "cx": cx, "cy": cy, "width": width, "height": height, "blur_score": 165.6});
    let matrix = opengl_matrix(frame);
    for row in 0..3 {
        for column in 0..4 {
            file[format!("t_{row}{column}")] = json!(matrix.row(row)[column]);
        }
    }
    file
}

/// Writes a recording whose images and cameras were corrected, or were not.
fn write(folder: &Path, prefix: &str) {
    let keyframes = folder.join("keyframes");
    for part in [&*format!("{prefix}images"), &format!("{prefix}cameras"), "depth", "confidence"] {
        fs::create_dir_all(keyframes.join(part)).unwrap();
    }
    for (index, (frame, time)) in frames().iter().zip(TIMES).enumerate() {
        let file = |part: &str, ending: &str| keyframes.join(format!("{part}/{time}.{ending}"));
        fs::write(file(&format!("{prefix}images"), "png"), png_color_bytes(frame.color())).unwrap();
        fs::write(file(&format!("{prefix}cameras"), "json"), camera_file(frame, index).to_string()).unwrap();
        let depth = small_millimetres(frame);
        let size = (DEPTH_SIZE.0 as u32, DEPTH_SIZE.1 as u32);
        write_png16(&file("depth", "png"), size, |x, y| depth[(x as usize, y as usize)]);
        // 0, 54 and 255 are the levels in real recordings.
        let level = |x: u32| [0, 54, 255][usize::from(confidence(x as usize))];
        image::GrayImage::from_fn(size.0, size.1, |x, _| image::Luma([level(x)]))
            .save(file("confidence", "png"))
            .unwrap();
    }
}

#[test]
fn frames_are_at_the_scale_of_depth_with_turned_axes_and_their_own_cameras() {
    for prefix in ["", "corrected_"] {
        let folder = tempfile::tempdir().unwrap();
        write(folder.path(), prefix);
        fs::write(folder.path().join("mesh_info.json"), "{}").unwrap();
        for path in [folder.path().to_owned(), folder.path().join("keyframes")] {
            let scene = open_scene(&path, &DatasetSettings::default()).unwrap();
            assert_eq!((scene.format(), scene.frame_count()), (Some(Format::Polycam), 3));
            assert_eq!(scene.name(), folder.path().file_name().unwrap().to_str().unwrap());
            for (index, written) in frames().iter().enumerate() {
                let read = scene.read_recorded(index).unwrap();
                assert_images(&read.frame, &expected(written, camera(index)));
                assert_pose(read.world_from_camera, written.world_from_camera());
                assert_eq!(read.frame.timestamp(), Some(Duration::from_micros(TIMES[index])));
            }
        }
    }
}

#[test]
fn corrected_poses_come_before_others() {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path(), "");
    let cameras = folder.path().join("keyframes/corrected_cameras");
    fs::create_dir(&cameras).unwrap();
    for (index, time) in TIMES.into_iter().enumerate() {
        fs::write(cameras.join(format!("{time}.json")), camera_file(&frames()[2], index).to_string()).unwrap();
    }
    let read = open_scene(folder.path(), &DatasetSettings::default()).unwrap().read_recorded(0).unwrap();
    assert_pose(read.world_from_camera, frames()[2].world_from_camera());
}

#[test]
fn what_is_missing_is_told() {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path(), "");
    let keyframes = folder.path().join("keyframes");
    fs::remove_file(keyframes.join(format!("depth/{}.png", TIMES[0]))).unwrap();
    fs::remove_file(keyframes.join(format!("cameras/{}.json", TIMES[1]))).unwrap();
    fs::remove_dir_all(keyframes.join("confidence")).unwrap();
    let scene = open_scene(folder.path(), &DatasetSettings::default()).unwrap();
    let told: Vec<&str> = scene.left_out().iter().map(|left_out| left_out.what.as_str()).collect();
    assert_eq!(told, ["without a depth image of the same name", "without a camera file of the same name"]);
    let measured = scene.read_recorded(0).unwrap().frame.depth().pixels().iter().filter(|depth| **depth > 0.0).count();
    assert_eq!(measured, DEPTH_SIZE.0 * DEPTH_SIZE.1, "without confidence, all depth counts");
    fs::remove_file(keyframes.join(format!("depth/{}.png", TIMES[2]))).unwrap();
    let told = refused(folder.path());
    assert!(told.contains("frames: found 2 without depth and 1 without a camera file"), "{told}");
    fs::remove_dir_all(keyframes.join("depth")).unwrap();
    let told = refused(folder.path());
    assert!(told.contains("format polycam, but this is missing: keyframes/depth/"), "{told}");
}

#[test]
fn damage_is_told() {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path(), "corrected_");
    assert_damage_is_told(folder.path(), folder.path());
}
