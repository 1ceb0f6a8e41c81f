//! ARKitScenes.

use crate::support::phones::*;
use crate::support::recording::png_color_bytes;
use crate::support::*;
use glam::{DMat3, DQuat};
use splatseg_dataset::{DatasetSettings, Format, open_scene};
use splatseg_geometry::Intrinsics;
use std::fs;
use std::path::Path;
use std::time::Duration;

const TIMES: [&str; 3] = ["6845.298", "6845.398", "6845.498"];

/// The camera of colour images at the scale of depth.
fn camera(index: usize) -> Intrinsics {
    Intrinsics { fx: 15.0 + index as f32, fy: 15.25, cx: 7.5, cy: 5.75, width: DEPTH_SIZE.0, height: DEPTH_SIZE.1 }
}

/// Writes a video. The second camera's file is a millisecond off, and poses are up to 4 ms off.
fn write(folder: &Path) {
    for part in ["lowres_wide", "lowres_depth", "confidence", "lowres_wide_intrinsics"] {
        fs::create_dir_all(folder.join(part)).unwrap();
    }
    let mut trajectory = String::new();
    for (index, (frame, time)) in frames().iter().zip(TIMES).enumerate() {
        let file = |part: &str| folder.join(format!("{part}/47333462_{time}.png"));
        fs::write(file("lowres_wide"), png_color_bytes(frame.color())).unwrap();
        let depth = small_millimetres(frame);
        let size = (DEPTH_SIZE.0 as u32, DEPTH_SIZE.1 as u32);
        write_png16(&file("lowres_depth"), size, |x, y| depth[(x as usize, y as usize)]);
        image::GrayImage::from_fn(size.0, size.1, |x, _| image::Luma([confidence(x as usize)]))
            .save(file("confidence"))
            .unwrap();
        let Intrinsics { fx, fy, cx, cy, width, height } = camera(index);
        let time_of_camera = if index == 1 { "6845.397" } else { time };
        let camera = format!("{width} {height} {fx} {fy} {cx} {cy}");
        fs::write(folder.join(format!("lowres_wide_intrinsics/47333462_{time_of_camera}.pincam")), camera).unwrap();
        let camera_from_world = frame.world_from_camera().inverse().to_matrix();
        let rotation = DQuat::from_mat3(&DMat3::from_mat4(camera_from_world)).to_scaled_axis();
        let (seconds, translation) = (time.parse::<f64>().unwrap() + 0.002 * index as f64, camera_from_world.w_axis);
        trajectory += &format!("{seconds} {} {} {} ", rotation.x, rotation.y, rotation.z);
        trajectory += &format!("{} {} {}\n", translation.x, translation.y, translation.z);
    }
    fs::write(folder.join("lowres_wide.traj"), trajectory).unwrap();
}

#[test]
fn poses_are_world_to_camera_and_cameras_are_of_each_frame() {
    let folder = tempfile::tempdir().unwrap();
    let (raw, of_3dod) = (folder.path().join("47333462"), folder.path().join("47333463"));
    write(&raw);
    write(&of_3dod.join("47333463_frames"));
    for path in [raw, of_3dod] {
        let scene = open_scene(&path, &DatasetSettings::default()).unwrap();
        assert_eq!((scene.format(), scene.frame_count()), (Some(Format::ArkitScenes), 3));
        for (index, written) in frames().iter().enumerate() {
            let read = scene.read_recorded(index).unwrap();
            let expected = expected(written, camera(index).resized(64, 48));
            assert_images(&read.frame, &expected);
            assert_pose(read.world_from_camera, written.world_from_camera());
            let seconds = TIMES[index].parse().unwrap();
            assert_eq!(read.frame.timestamp(), Some(Duration::from_secs_f64(seconds)));
            assert_eq!(read.frame.name(), format!("47333462_{}", TIMES[index]));
        }
    }
}

#[test]
fn what_is_missing_is_told() {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path());
    fs::remove_file(folder.path().join(format!("lowres_depth/47333462_{}.png", TIMES[0]))).unwrap();
    fs::remove_file(folder.path().join(format!("lowres_wide_intrinsics/47333462_{}.pincam", TIMES[2]))).unwrap();
    let scene = open_scene(folder.path(), &DatasetSettings::default()).unwrap();
    let told: Vec<&str> = scene.left_out().iter().map(|left_out| left_out.what.as_str()).collect();
    assert_eq!(told, ["without an image in lowres_depth", "without a camera in lowres_wide_intrinsics"]);
    fs::remove_file(folder.path().join("lowres_wide.traj")).unwrap();
    assert!(!open_scene(folder.path(), &DatasetSettings::default()).unwrap().has_poses());
    fs::write(folder.path().join("lowres_wide.traj"), "1 2 3 4 5 6 7\n1 2 3\n").unwrap();
    let told = refused(folder.path());
    assert!(told.contains("lowres_wide.traj: line 2: found \"1 2 3\", expected 7 numbers"), "{told}");
    for (trajectory, found) in [("", "no pose"), ("6846.4 0 0 0 1 2 3\n6847 0 0 0 1 2 3\n", "6846.400 to 6847.000 s")] {
        fs::write(folder.path().join("lowres_wide.traj"), trajectory).unwrap();
        let told = refused(folder.path());
        let expected =
            format!("times of the poses: found {found}, expected those of the images, 6845.398 to 6845.398 s");
        assert!(told.contains(&expected), "{told}");
    }
    fs::remove_file(folder.path().join("lowres_wide.traj")).unwrap();
    fs::write(folder.path().join("lowres_wide_intrinsics/47333462_6845.397.pincam"), "16 12 15 15").unwrap();
    let told = refused(folder.path());
    assert!(told.contains("found \"16 12 15 15\", expected 6 numbers: width height fx fy cx cy"), "{told}");
    let own = DatasetSettings::default().with(|settings| settings.fx = Some(15.0));
    fs::remove_dir_all(folder.path().join("lowres_wide_intrinsics")).unwrap();
    assert_eq!(read_all(folder.path(), &own), Ok(2));
}

#[test]
fn lost_poses_are_counted() {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path());
    let lost: String = TIMES.iter().map(|time| format!("{time} nan nan nan nan nan nan\n")).collect();
    fs::write(folder.path().join("lowres_wide.traj"), lost).unwrap();
    let scene = open_scene(folder.path(), &DatasetSettings::default()).unwrap();
    assert_eq!((scene.has_poses(), scene.without_pose()[0].count), (false, 3));
}

#[test]
fn damage_is_told() {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path());
    assert_damage_is_told(folder.path(), folder.path());
}
