//! 7-Scenes sequences, whole and damaged.

use crate::support::*;
use splatseg_dataset::{DatasetError, DatasetSettings, DepthRegistration, Scene, SevenScenesScene, open_scene};
use std::fs;

fn open(folder: &std::path::Path) -> std::sync::Arc<dyn Scene> {
    open_scene(folder, &DatasetSettings::default()).unwrap()
}

#[test]
fn frames_come_in_order_with_registered_depth_in_metres() {
    let folder = tempfile::tempdir().unwrap();
    write_sevenscenes(folder.path(), 12);
    fs::create_dir(folder.path().join("pose_drifting")).unwrap();
    let scene = open(folder.path());
    assert_eq!((scene.frame_count(), scene.frame_name(11)), (12, "frame-000110".to_owned()));
    let frame = scene.read_frame(11).unwrap();
    assert_eq!(frame.name(), "frame-000110");
    assert_eq!((frame.width(), frame.height()), (64, 48));
    assert_eq!((frame.intrinsics().fx, frame.intrinsics().cx, frame.intrinsics().cy), (50.0, 31.5, 23.5));
    assert_eq!((frame.depth()[(0, 0)], frame.depth()[(1, 0)], frame.depth()[(40, 20)]), (0.0, 0.0, 1.04));
    assert_eq!(frame.world_from_camera().translation().to_array(), [11.0, 2.0, 3.0]);
    assert!(!scene.has_ground_truth() && scene.read_ground_truth(0).unwrap().is_none());
    assert!(matches!(scene.read_frame(12), Err(DatasetError::NoSuchFrame { index: 12, count: 12, .. })));
}

#[test]
fn one_frame_is_a_scene_and_png_colour_is_preferred() {
    let folder = tempfile::tempdir().unwrap();
    write_sevenscenes(folder.path(), 1);
    image::RgbImage::from_pixel(64, 48, image::Rgb([1, 2, 3]))
        .save(folder.path().join("frame-000000.color.png"))
        .unwrap();
    let scene = open(folder.path());
    assert_eq!(scene.frame_count(), 1);
    assert_eq!(scene.read_frame(0).unwrap().color()[(5, 5)], [1, 2, 3]);
}

#[test]
fn without_intrinsics_the_published_camera_is_assumed() {
    let folder = tempfile::tempdir().unwrap();
    write_sevenscenes(folder.path(), 1);
    fs::remove_file(folder.path().join("camera-intrinsics.txt")).unwrap();
    let camera = *open(folder.path()).read_frame(0).unwrap().intrinsics();
    assert_eq!((camera.fx, camera.fy), (52.5, 52.5), "525 for 640 pixels, this image has 64");
    for file in ["color.png", "depth.png"] {
        write_png16(&folder.path().join(format!("frame-000000.{file}")), (64, 36), |_, _| 2000);
    }
    let error = open(folder.path()).read_frame(0).unwrap_err().to_string();
    assert!(error.contains("color.png: colour image: found 64x36 pixels, expected the shape of 640x480"), "{error}");
    assert!(error.contains("--fx"), "{error}");
    let own = DatasetSettings::default().with(|settings| settings.fx = Some(52.5));
    assert!(open_scene(folder.path(), &own).unwrap().read_frame(0).is_ok());
}

#[test]
fn published_depth_is_warped_into_the_colour_camera() {
    let folder = tempfile::tempdir().unwrap();
    write_sevenscenes(folder.path(), 1);
    fs::remove_file(folder.path().join("camera-intrinsics.txt")).unwrap();
    write_png16(&folder.path().join("frame-000000.depth.png"), (64, 48), |_, _| 2000);
    let settings = DatasetSettings::default().with(|settings| settings.register_depth = DepthRegistration::True);
    let frame = open_scene(folder.path(), &settings).unwrap().read_frame(0).unwrap();
    // The depth camera's first column is at x = (0 - 32.05) / 58.5 * 2 m; its colour pixel is 3 to the right.
    assert_eq!((frame.depth()[(1, 20)], frame.depth()[(5, 20)], frame.depth()[(32, 24)]), (0.0, 2.0, 2.0));
    let translation = frame.world_from_camera().translation();
    assert!((translation.x - 0.025).abs() < 1e-6, "the pose is now the colour camera's");
}

#[test]
fn folders_of_sequences_list_them() {
    let folder = tempfile::tempdir().unwrap();
    for sequence in ["seq-02", "seq-01"] {
        write_sevenscenes(&folder.path().join(sequence), 1);
    }
    let error = open_scene(folder.path(), &DatasetSettings::default()).unwrap_err();
    assert!(error.to_string().ends_with("holds several sequences, pick one of seq-01, seq-02"), "{error}");
    assert_eq!(open(&folder.path().join("seq-01")).name(), "seq-01");
}

/// Damages one frame of two, and returns the error of reading it after checking that the other can still be read.
fn damaged(damage: impl Fn(&std::path::Path)) -> DatasetError {
    let folder = tempfile::tempdir().unwrap();
    write_sevenscenes(folder.path(), 2);
    damage(&folder.path().join("frame-000000"));
    let scene = SevenScenesScene::open(folder.path(), &DatasetSettings::default()).unwrap();
    assert!(scene.read_frame(1).is_ok());
    let error = scene.read_frame(0).unwrap_err();
    assert!(error.to_string().contains("frame-000000"), "the file is named: {error}");
    error
}

#[test]
fn missing_files_of_a_frame_are_named() {
    let error = damaged(|frame| fs::remove_file(frame.with_extension("depth.png")).unwrap());
    assert!(error.to_string().ends_with("frame-000000.depth.png: the depth image is missing"), "{error}");
    let error = damaged(|frame| fs::remove_file(frame.with_extension("pose.txt")).unwrap());
    assert!(error.to_string().ends_with(": frame frame-000000 has no pose"), "{error}");
}

#[test]
fn damaged_images_are_reported() {
    assert!(matches!(damaged(|frame| truncate(&frame.with_extension("color.jpg"))), DatasetError::CutOff { .. }));
    assert!(matches!(damaged(|frame| truncate(&frame.with_extension("depth.png"))), DatasetError::Image { .. }));
    let no_image = |frame: &std::path::Path| fs::write(frame.with_extension("depth.png"), "hello").unwrap();
    assert!(matches!(damaged(no_image), DatasetError::Image { .. }));
    let empty = |frame: &std::path::Path| fs::write(frame.with_extension("color.jpg"), "").unwrap();
    assert!(matches!(damaged(empty), DatasetError::Image { .. }));
}

#[test]
fn lying_sizes_cost_no_memory() {
    let lies = |frame: &std::path::Path| write_lying_png(&frame.with_extension("depth.png"), (60_000, 60_000));
    assert!(matches!(damaged(lies), DatasetError::ImplausibleSize { width: 60_000, .. }));
    let plausible = |frame: &std::path::Path| write_lying_png(&frame.with_extension("depth.png"), (64, 48));
    assert!(matches!(damaged(plausible), DatasetError::Image { .. }));
}

#[test]
fn depth_must_be_16_bit_and_of_the_colours_size() {
    let other_size = |frame: &std::path::Path| write_png16(&frame.with_extension("depth.png"), (32, 24), |_, _| 1000);
    let error = damaged(other_size).to_string();
    assert!(error.ends_with("the depth image has 32x24 pixels, but its colour image has 64x48"), "{error}");
    let error = damaged(|frame| write_color(&frame.with_extension("depth.png"), 64, 48)).to_string();
    assert!(error.ends_with("the depth image has 8-bit RGB pixels, expected a PNG with 16-bit grey"), "{error}");
}

#[test]
fn damaged_poses_are_reported() {
    let with_pose =
        |text: String| damaged(|frame| fs::write(frame.with_extension("pose.txt"), &text).unwrap()).to_string();
    let fifteen = pose_text(0).trim_end().strip_suffix('1').unwrap().to_owned();
    assert!(with_pose(fifteen).ends_with("camera pose: found 15 numbers, expected 16, a 4x4 matrix"));
    assert!(with_pose(pose_text(0).replace('3', "x")).contains("found \"x\", expected numbers"));
    assert!(with_pose("-inf ".repeat(16)).ends_with(": frame frame-000000 has no pose"));
    assert!(with_pose(String::new()).ends_with("camera pose: found 0 numbers, expected 16, a 4x4 matrix"));
    assert!(with_pose(pose_text(0).replacen('1', "2", 1)).contains("not a rigid transform"));
    assert!(with_pose("1 ".repeat(50_000)).contains("are too many for a camera pose"));
}

#[test]
fn damaged_intrinsics_are_reported_on_opening() {
    let folder = tempfile::tempdir().unwrap();
    write_sevenscenes(folder.path(), 1);
    for (text, expected) in [
        ("1 2 3", "found 3 numbers, expected 9 or 16"),
        ("0 0 1 0 0 1 0 0 1", "focal lengths must be positive"),
        ("50 0 1 0 50 1 0 0 5", "expected rows fx 0 cx"),
        ("50 0 NaN 0 50 1 0 0 1", "image are invalid"),
    ] {
        fs::write(folder.path().join("camera-intrinsics.txt"), text).unwrap();
        let error = open_scene(folder.path(), &DatasetSettings::default()).unwrap_err().to_string();
        assert!(error.contains(expected) && error.contains("camera-intrinsics.txt"), "{error}");
    }
}

#[cfg(unix)]
#[test]
fn special_files_are_not_read() {
    let folder = tempfile::tempdir().unwrap();
    write_sevenscenes(folder.path(), 2);
    assert_special_files_are_refused(folder.path(), folder.path());
}
