//! Exported ScanNet scenes, whole and damaged.

use crate::support::warnings::with_warnings;
use crate::support::*;
use splatseg_dataset::{DatasetError, DatasetSettings, LeftOut, ScannetScene, Scene, open_scene};
use std::fs;

const SAME: ScannetSizes = ScannetSizes { color: (40, 30), depth: (40, 30), labels: (40, 30) };

#[test]
fn frames_are_sorted_by_number_and_untouched_when_the_cameras_agree() {
    let folder = tempfile::tempdir().unwrap();
    write_scannet(folder.path(), 12, &SAME);
    let scene = open_scene(folder.path(), &DatasetSettings::default()).unwrap();
    assert_eq!((scene.frame_count(), scene.frame_name(2), scene.frame_name(11)), (12, "2".into(), "11".into()));
    let frame = scene.read_frame(11).unwrap();
    assert_eq!(frame.world_from_camera().translation().x, 11.0);
    let stored = image::open(folder.path().join("color/11.jpg")).unwrap().into_rgb8();
    assert_eq!(frame.color()[(7, 9)], stored.get_pixel(7, 9).0);
    assert_eq!((frame.depth()[(3, 3)], frame.intrinsics().fx), (2.0, 40.0));
    let labels = scene.read_ground_truth(0).unwrap().unwrap();
    assert_eq!((labels[(19, 5)], labels[(20, 5)]), (1, 2));
}

#[test]
fn colour_and_labels_of_another_size_are_brought_to_the_depth_camera() {
    let folder = tempfile::tempdir().unwrap();
    write_scannet(folder.path(), 1, &ScannetSizes { color: (160, 120), depth: (40, 30), labels: (160, 120) });
    let scene = ScannetScene::open(folder.path(), &DatasetSettings::default()).unwrap();
    let frame = scene.read_frame(0).unwrap();
    assert_eq!((frame.width(), frame.height(), frame.intrinsics().width), (40, 30, 40));
    // Red is 255 x / width, so the same ray has the same red in both images.
    for column in [5, 20, 34] {
        let ray = (column as f32 - 19.5) / 40.0;
        let expected = 255.0 * (ray * 160.0 + 79.5) / 160.0;
        let found = f32::from(frame.color()[(column, 15)][0]);
        assert!((found - expected).abs() < 4.0, "column {column}: {found}, expected {expected}");
    }
    let labels = scene.read_ground_truth(0).unwrap().unwrap();
    assert_eq!(labels.size(), (40, 30));
    assert_eq!((labels[(19, 5)], labels[(20, 5)]), (1, 2));
}

#[test]
fn cameras_of_the_images_before_they_were_made_smaller_are_scaled() {
    let folder = tempfile::tempdir().unwrap();
    write_scannet(folder.path(), 2, &ScannetSizes { labels: (80, 60), color: (80, 60), depth: (40, 30) });
    let read = || ScannetScene::open(folder.path(), &DatasetSettings::default()).unwrap().read_frame(1);
    let expected = read().unwrap();
    let matrix = |part: &str, (width, height): (usize, usize), center: usize| {
        let text = format!("{width} 0 {center} 0\n0 {height} {} 0\n0 0 1 0\n0 0 0 1\n", center * height / width);
        fs::write(folder.path().join(format!("intrinsic/intrinsic_{part}.txt")), text).unwrap();
    };
    matrix("color", (1296, 972), 647);
    matrix("depth", (640, 480), 320);
    let (found, told) = with_warnings(read);
    let found = found.unwrap();
    assert!(found.intrinsics().width == 40 && (found.intrinsics().fx - 40.0).abs() < 0.1, "{:?}", found.intrinsics());
    let differs =
        |(one, other): (&[u8; 3], &[u8; 3])| one.iter().zip(other).any(|(one, other)| one.abs_diff(*other) > 3);
    assert!(!found.color().pixels().iter().zip(expected.color().pixels()).any(differs));
    assert!(
        told[0].contains("intrinsic_color.txt: the principal point (647, 485) is the middle of images of 1296x968")
    );
    assert!(told[1].contains("intrinsic_depth.txt: ") && told[1].contains("640x480 pixels, and these have 40x30"));
    // The labels have the size of colour.
    let scene = ScannetScene::open(folder.path(), &DatasetSettings::default()).unwrap();
    let labels = scene.read_ground_truth(0).unwrap().unwrap();
    assert_eq!((labels[(18, 5)], labels[(21, 5)]), (1, 2));
    matrix("color", (100, 75), 5);
    let (_, told) = with_warnings(read);
    assert!(
        told.iter().any(|told| told.contains("intrinsic_color.txt: the principal point (5, 3) is far")),
        "{told:?}"
    );
    matrix("color", (1_000_000, 750_000), 40);
    let error = read().unwrap_err().to_string();
    assert!(error.contains("intrinsic_color.txt: focal lengths: found 1e6 and 7.5e5 pixels"), "{error}");
}

#[test]
fn labels_of_a_frame_whose_depth_is_damaged_are_read() {
    let folder = tempfile::tempdir().unwrap();
    write_scannet(folder.path(), 2, &SAME);
    std::fs::write(folder.path().join("depth/1.png"), b"").unwrap();
    let scene = ScannetScene::open(folder.path(), &DatasetSettings::default()).unwrap();
    assert!(scene.read_frame(1).is_err());
    assert_eq!(scene.read_ground_truth(1).unwrap().unwrap().size(), (40, 30));
    std::fs::write(folder.path().join("depth/0.png"), b"").unwrap();
    assert!(scene.read_ground_truth(1).is_err());
}

#[test]
fn labels_of_a_third_size_are_an_error() {
    let folder = tempfile::tempdir().unwrap();
    write_scannet(folder.path(), 1, &ScannetSizes { labels: (20, 15), ..SAME });
    let error =
        ScannetScene::open(folder.path(), &DatasetSettings::default()).unwrap().read_ground_truth(0).unwrap_err();
    assert!(matches!(error, DatasetError::SizesDiffer { found: (20, 15), expected: (40, 30), .. }), "{error}");
}

#[test]
fn labels_may_be_8_bit_but_not_palettes_or_colours() {
    let folder = tempfile::tempdir().unwrap();
    write_scannet(folder.path(), 2, &SAME);
    let path = folder.path().join("instance-filt/0.png");
    image::GrayImage::from_pixel(40, 30, image::Luma([7])).save(&path).unwrap();
    let scene = ScannetScene::open(folder.path(), &DatasetSettings::default()).unwrap();
    assert_eq!(scene.read_ground_truth(0).unwrap().unwrap()[(4, 4)], 7);
    write_color(&path, 40, 30);
    assert!(scene.read_ground_truth(0).unwrap_err().to_string().contains("8-bit RGB"));
    fs::remove_file(&path).unwrap();
    assert!(scene.read_ground_truth(0).unwrap().is_none(), "a frame without labels");
}

#[test]
fn a_frame_in_which_tracking_was_lost_has_no_pose() {
    let folder = tempfile::tempdir().unwrap();
    write_scannet(folder.path(), 2, &SAME);
    fs::write(folder.path().join("pose/0.txt"), "-inf -inf -inf -inf\n".repeat(4)).unwrap();
    let scene = ScannetScene::open(folder.path(), &DatasetSettings::default()).unwrap();
    let lost = scene.read_recorded(0).unwrap();
    assert_eq!((lost.world_from_camera, lost.frame.depth()[(3, 3)]), (None, 2.0));
    let error = scene.read_frame(0).unwrap_err().to_string();
    assert!(error.ends_with(": frame 0 has no pose"), "{error}");
    assert!(scene.read_frame(1).is_ok() && scene.has_poses());
}

#[test]
fn missing_intrinsics_and_frames_are_reported_on_opening() {
    let folder = tempfile::tempdir().unwrap();
    write_scannet(folder.path(), 1, &SAME);
    fs::remove_file(folder.path().join("intrinsic/intrinsic_depth.txt")).unwrap();
    let error = ScannetScene::open(folder.path(), &DatasetSettings::default()).unwrap_err().to_string();
    assert!(error.ends_with("intrinsic_depth.txt: the camera intrinsics file is missing"), "{error}");
    fs::remove_file(folder.path().join("color/0.jpg")).unwrap();
    assert!(matches!(
        ScannetScene::open(folder.path(), &DatasetSettings::default()),
        Err(DatasetError::NoFrames { .. })
    ));
}

#[test]
fn without_labels_there_is_no_ground_truth() {
    let folder = tempfile::tempdir().unwrap();
    write_scannet(folder.path(), 1, &SAME);
    fs::remove_dir_all(folder.path().join("instance-filt")).unwrap();
    let scene = ScannetScene::open(folder.path(), &DatasetSettings::default()).unwrap();
    assert!(!scene.has_ground_truth() && scene.read_ground_truth(0).unwrap().is_none());
}

#[cfg(unix)]
#[test]
fn special_files_are_not_read() {
    let folder = tempfile::tempdir().unwrap();
    write_scannet(folder.path(), 2, &SAME);
    assert_special_files_are_refused(folder.path(), folder.path());
}

#[cfg(unix)]
#[test]
fn frames_without_colour_and_names_that_are_not_utf8_are_counted() {
    use std::os::unix::ffi::OsStringExt;
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path().join(std::ffi::OsString::from_vec(b"sc\xFFne".to_vec()));
    write_scannet(&folder, 4, &SAME);
    fs::remove_file(folder.join("color/1.jpg")).unwrap();
    fs::remove_file(folder.join("color/2.jpg")).unwrap();
    fs::remove_file(folder.join("depth/2.png")).unwrap();
    fs::write(folder.join("color").join(std::ffi::OsString::from_vec(b"\xFF7.jpg".to_vec())), "").unwrap();
    let scene = open_scene(&folder, &DatasetSettings::default()).unwrap();
    assert_eq!((scene.frame_count(), scene.frame_name(1)), (2, "3".to_owned()));
    assert!(scene.read_frame(1).is_ok());
    let names = format!("with names that are not UTF-8 in {}", folder.join("color").display());
    let expected = [(1, names.as_str()), (2, "without a colour image")];
    assert_eq!(scene.left_out(), expected.map(|(count, what)| LeftOut { count, what: what.to_owned() }));
}
