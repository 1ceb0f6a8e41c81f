//! Stray Scanner.

use crate::support::phones::*;
use crate::support::recording::png_color_bytes;
use crate::support::*;
use glam::{DMat3, DQuat};
use splatseg_dataset::{DatasetSettings, Format, open_scene};
use splatseg_geometry::Intrinsics;
use std::fs;
use std::path::Path;
use std::time::Duration;

fn camera(index: usize) -> Intrinsics {
    Intrinsics { fx: 60.0 + index as f32, fy: 61.0, cx: 30.0, cy: 24.5, width: 64, height: 48 }
}

/// `odometry.csv`, with the camera of each frame or without.
fn odometry(with_camera: bool) -> String {
    let mut text = "timestamp, frame, x, y, z, qx, qy, qz, qw".to_owned();
    text += if with_camera { ", fx, fy, cx, cy\n" } else { "\n" };
    for (index, frame) in frames().iter().enumerate() {
        let matrix = frame.world_from_camera().to_matrix();
        let [qx, qy, qz, qw] = DQuat::from_mat3(&DMat3::from_mat4(matrix)).to_array();
        let position = matrix.w_axis;
        text += &format!("{}.5, {index:06}, {}, {}, {}, ", 90 + index, position.x, position.y, position.z);
        text += &format!("{qx}, {qy}, {qz}, {qw}");
        let Intrinsics { fx, fy, cx, cy, .. } = camera(index);
        text += &if with_camera { format!(", {fx}, {fy}, {cx}, {cy}\n") } else { "\n".to_owned() };
    }
    text
}

fn write(folder: &Path, color: &str, with_camera: bool) {
    for part in [color, "depth", "confidence"] {
        fs::create_dir_all(folder.join(part)).unwrap();
    }
    for (index, frame) in frames().iter().enumerate() {
        fs::write(folder.join(format!("{color}/{index:06}.png")), png_color_bytes(frame.color())).unwrap();
        let depth = small_millimetres(frame);
        let size = (DEPTH_SIZE.0 as u32, DEPTH_SIZE.1 as u32);
        write_png16(&folder.join(format!("depth/{index:06}.png")), size, |x, y| depth[(x as usize, y as usize)]);
        image::GrayImage::from_fn(size.0, size.1, |x, _| image::Luma([confidence(x as usize)]))
            .save(folder.join(format!("confidence/{index:06}.png")))
            .unwrap();
    }
    fs::write(folder.join("odometry.csv"), odometry(with_camera)).unwrap();
    fs::write(folder.join("camera_matrix.csv"), "59.0, 0.0, 30.0\n0.0, 61.0, 24.5\n0.0, 0.0, 1.0").unwrap();
}

#[test]
fn frames_are_at_the_scale_of_depth_with_their_own_cameras() {
    for (color, with_camera) in [("rgb", true), ("color", false)] {
        let folder = tempfile::tempdir().unwrap();
        write(folder.path(), color, with_camera);
        let scene = open_scene(folder.path(), &DatasetSettings::default()).unwrap();
        assert_eq!((scene.format(), scene.frame_count()), (Some(Format::Stray), 3));
        for (index, written) in frames().iter().enumerate() {
            let read = scene.read_recorded(index).unwrap();
            let camera = if with_camera { camera(index) } else { Intrinsics { fx: 59.0, ..camera(0) } };
            assert_images(&read.frame, &expected(written, camera));
            assert_pose(read.world_from_camera, written.world_from_camera());
            assert_eq!(read.frame.timestamp(), Some(Duration::from_secs_f64(90.5 + index as f64)));
        }
    }
}

#[test]
fn the_matrix_is_that_of_the_video() {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path(), "rgb", false);
    // Images of 64x48 pixels, extracted from a video of 1920x1440: a thirtieth.
    fs::write(folder.path().join("camera_matrix.csv"), "1800, 0, 959.5\n0, 1830, 719.5\n0, 0, 1\n").unwrap();
    let read = open_scene(folder.path(), &DatasetSettings::default()).unwrap().read_recorded(0).unwrap().frame;
    let at_colour = Intrinsics { fx: 60.0, fy: 61.0, cx: 31.5, cy: 23.5, width: 64, height: 48 };
    assert_images(&read, &expected(&frames()[0], at_colour));
}

#[test]
fn an_empty_folder_does_not_hide_other_images() {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path(), "color", true);
    fs::create_dir(folder.path().join("rgb")).unwrap();
    assert_eq!(read_all(folder.path(), &DatasetSettings::default()), Ok(3));
    fs::remove_dir_all(folder.path().join("color")).unwrap();
    let told = refused(folder.path());
    assert!(told.contains("rgb: no frames"), "{told}");
}

#[test]
fn arrays_are_millimetres_too() {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path(), "rgb", true);
    let header = "{'descr': '<f4', 'fortran_order': False, 'shape': (12, 16), }\n";
    let depth = small_millimetres(&frames()[1]);
    let numbers = depth.pixels().iter().flat_map(|depth| f32::from(*depth).to_le_bytes());
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.bytes().chain(numbers));
    fs::write(folder.path().join("depth/000001.npy"), bytes).unwrap();
    fs::remove_file(folder.path().join("depth/000001.png")).unwrap();
    let read = open_scene(folder.path(), &DatasetSettings::default()).unwrap().read_recorded(1).unwrap().frame;
    assert_images(&read, &expected(&frames()[1], camera(1)));
}

#[test]
fn what_is_missing_is_told() {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path(), "rgb", false);
    fs::remove_file(folder.path().join("depth/000000.png")).unwrap();
    let short: String = odometry(false).lines().take(3).map(|line| line.to_owned() + "\n").collect();
    fs::write(folder.path().join("odometry.csv"), short).unwrap();
    let scene = open_scene(folder.path(), &DatasetSettings::default()).unwrap();
    assert_eq!((scene.frame_count(), scene.left_out()[0].count, scene.without_pose()[0].count), (2, 1, 1));
    fs::remove_file(folder.path().join("camera_matrix.csv")).unwrap();
    let told = refused(folder.path());
    assert!(told.contains("the camera is not known: describe it in camera_matrix.csv"), "{told}");
    let own = DatasetSettings::default().with(|settings| settings.fx = Some(60.0));
    assert_eq!(read_all(folder.path(), &own), Ok(2));
    fs::write(folder.path().join("odometry.csv"), "timestamp, frame, x, y, z\n").unwrap();
    let told = refused(folder.path());
    assert!(
        told.contains("odometry.csv: line 1: found \"timestamp, frame, x, y, z\", expected columns named"),
        "{told}"
    );
    fs::write(folder.path().join("odometry.csv"), odometry(true).replace("000001", "one")).unwrap();
    let told = refused(folder.path());
    assert!(told.contains("odometry.csv: line 3: found \"91.5, one,"), "{told}");
    fs::remove_dir_all(folder.path().join("rgb")).unwrap();
    let told = refused(folder.path());
    assert!(told.contains("format stray, but this is missing: rgb.mp4 or rgb/"), "{told}");
}

#[test]
fn poses_of_other_frames_are_told() {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path(), "rgb", false);
    fs::write(folder.path().join("odometry.csv"), odometry(false).replace(", 00000", ", 01000")).unwrap();
    let told = refused(folder.path());
    assert!(
        told.contains("odometry.csv: frames: found 10000 to 10002, expected those of the images, 0 to 2"),
        "{told}"
    );
    let head = odometry(false).lines().next().unwrap().to_owned();
    fs::write(folder.path().join("odometry.csv"), head).unwrap();
    let scene = open_scene(folder.path(), &DatasetSettings::default()).unwrap();
    assert_eq!((scene.has_poses(), scene.without_pose()[0].count), (false, 3));
}

#[test]
fn damage_is_told() {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path(), "rgb", true);
    assert_damage_is_told(folder.path(), folder.path());
}
