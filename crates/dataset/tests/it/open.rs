//! Detection of scene formats.

use crate::support::*;
use splatseg_dataset::{DatasetError, DatasetSettings, Format, has_depth, open_scene};
use std::fs;
use std::path::Path;

#[test]
fn missing_empty_and_unknown_paths_are_distinguished() {
    let folder = tempfile::tempdir().unwrap();
    let settings = DatasetSettings::default();
    let missing = open_scene(folder.path().join("nothing"), &settings);
    assert!(matches!(missing, Err(DatasetError::NotFound { .. })));
    assert!(matches!(open_scene(folder.path(), &settings), Err(DatasetError::EmptyFolder { .. })));
    std::fs::write(folder.path().join("notes.txt"), "hello").unwrap();
    let unknown = open_scene(folder.path(), &settings).unwrap_err();
    assert!(matches!(unknown, DatasetError::NotRecognised { .. }));
    let text = unknown.to_string();
    for part in
        ["7scenes: frame-000000.color.png", "scannet: color/0.jpg", "mvpd: panoptic_", "synthetic: the word synthetic"]
    {
        assert!(text.contains(part), "{text}");
    }
}

#[test]
fn files_that_are_not_read_are_told_in_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let told = |name: &str, content: &[u8]| {
        let path = folder.path().join(name);
        fs::write(&path, content).unwrap();
        let error = open_scene(&path, &DatasetSettings::default()).unwrap_err().to_string();
        assert!(!error.contains('\n'), "{error}");
        error
    };
    let notes = told("notes.txt", b"hello, this is not a recording");
    assert!(
        notes.contains("found a file that begins with \"hello, this is n\", expected a recording: .mcap"),
        "{notes}"
    );
    assert!(told("empty", b"").contains("begins with nothing"));
    // Named like a recording, but not one.
    assert!(told("room.r3d", b"\x01\x02").contains(".r3d (a zip file)"));
    assert!(told("a.oni", b"NI10\0\0").contains("found a recording of OpenNI"));
    assert!(told("b.SVO2", b"any").contains("found a recording of a ZED camera"));
    assert!(told("c.h5", b"\x89HDF\r\n\x1a\n").contains("found an HDF5 file"));
    assert!(told("frames.zip", b"PK\x03\x04\0").contains("the folder that it unpacks to"));
}

#[test]
fn a_plain_video_has_no_depth() {
    let folder = tempfile::tempdir().unwrap();
    let starts: [&[u8]; 3] =
        [b"\0\0\0\x20ftypisom\0\0\x02\0", b"\x1A\x45\xDF\xA3\x9F\x42\x86\x81\x01aaa", b"RIFF\x10\0\0\0AVI "];
    for (start, name) in starts.iter().zip(["clip.mp4", "clip.mkv", "clip.avi"]) {
        let path = folder.path().join(name);
        fs::write(&path, start).unwrap();
        assert!(!has_depth(&path, &DatasetSettings::default()));
        // Without ffmpeg, or with it: these are no videos.
        let told = open_scene(&path, &DatasetSettings::default()).unwrap_err().to_string();
        assert!(told.contains(name) && told.contains("ffmpeg") && !told.contains('\n'), "{told}");
    }
    assert!(has_depth(Path::new("synthetic"), &DatasetSettings::default()));
}

/// A JPEG whose EXIF says that it is to be turned by 90 degrees clockwise.
fn lying_jpeg() -> Vec<u8> {
    let mut bytes = Vec::new();
    let color = image::RgbImage::from_fn(64, 48, |x, _| image::Rgb(if x < 32 { [250, 20, 20] } else { [20, 20, 250] }));
    color.write_to(&mut std::io::Cursor::new(&mut bytes), image::ImageFormat::Jpeg).unwrap();
    let exif = b"Exif\0\0II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0\x06\0\0\0\0\0\0\0";
    let segment = [&[0xFF, 0xE1, 0, exif.len() as u8 + 2], exif.as_slice()].concat();
    bytes.splice(2..2, segment);
    bytes
}

#[test]
fn photographs_are_turned_unless_their_camera_is_described() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("0.jpg"), lying_jpeg()).unwrap();
    let first =
        |settings: &DatasetSettings| open_scene(folder.path(), settings).unwrap().read_recorded(0).unwrap().frame;
    let upright = first(&DatasetSettings::default());
    assert_eq!((upright.width(), upright.height()), (48, 64));
    let (top, bottom) = (upright.color()[(24, 5)], upright.color()[(24, 60)]);
    assert!(top[0] > 200 && bottom[2] > 200, "{top:?} {bottom:?}");
    assert_eq!(first(&DatasetSettings::default().with(|settings| settings.fx = Some(60.0))).width(), 48);
    let settings = DatasetSettings::default().with(|s| (s.fx, s.cx) = (Some(60.0), Some(30.0)));
    assert_eq!(first(&settings).width(), 64);
    fs::write(folder.path().join("poses.txt"), "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1\n").unwrap();
    assert_eq!(first(&DatasetSettings::default()).width(), 64);
}

#[test]
fn a_folder_of_images_has_no_depth() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    for name in ["10.png", "9.png"] {
        image::RgbImage::from_pixel(40, 30, image::Rgb([9, 8, 7])).save(path.join(name)).unwrap();
    }
    fs::write(path.join("poses.txt"), "1 0 0 1 0 1 0 2 0 0 1 3 0 0 0 1\n".repeat(2)).unwrap();
    let settings = DatasetSettings::default();
    assert!(!has_depth(path, &settings));
    let scene = open_scene(path, &settings).unwrap();
    assert_eq!((scene.format(), scene.frame_count(), scene.frame_name(0)), (Some(Format::Images), 2, "9".to_owned()));
    assert!(!scene.has_depth() && scene.has_poses() && scene.sources()[0].contains("60 degrees"));
    let frame = scene.read_frame(1).unwrap();
    assert!(frame.depth().pixels().iter().all(|depth| *depth == 0.0) && frame.color()[(3, 4)] == [9, 8, 7]);
    assert_eq!(frame.world_from_camera().translation().to_array(), [1.0, 2.0, 3.0]);
    let camera = r#"{"width":40,"height":30,"fx":44,"fy":45,"cx":20,"cy":15,"depth_scale":1000}"#;
    fs::write(path.join("camera.json"), camera).unwrap();
    let scene = open_scene(path, &settings).unwrap();
    assert!(scene.sources().is_empty() && scene.read_frame(0).unwrap().intrinsics().fx == 44.0);
    // In `color/`, the images look like a folder that lacks depth, unless the format is given.
    fs::create_dir(path.join("color")).unwrap();
    fs::rename(path.join("9.png"), path.join("color/9.png")).unwrap();
    fs::remove_file(path.join("10.png")).unwrap();
    fs::remove_file(path.join("poses.txt")).unwrap();
    assert!(open_scene(path, &settings).unwrap_err().to_string().contains("this is missing: depth/"));
    let images = DatasetSettings::default().with(|settings| settings.format = Format::Images);
    assert_eq!(open_scene(path, &images).unwrap().frame_count(), 1);
}

#[test]
fn a_stated_format_must_be_there() {
    let folder = tempfile::tempdir().unwrap();
    write_sevenscenes(folder.path(), 1);
    let settings = |format| DatasetSettings::default().with(|settings| settings.format = format);
    assert!(open_scene(folder.path(), &settings(Format::SevenScenes)).is_ok());
    use Format::{Folder, Mvpd, Replica, Scannet, Sens, Synthetic, Tum};
    for format in [Scannet, Sens, Tum, Replica, Mvpd, Folder, Synthetic] {
        let error = open_scene(folder.path(), &settings(format)).unwrap_err();
        assert!(error.to_string().contains(&format!("not a scene of format {format}")), "{error}");
    }
}

#[test]
fn the_synthetic_room_needs_no_files() {
    let scene = open_scene("synthetic:frames=3,width=32,height=24", &DatasetSettings::default()).unwrap();
    assert_eq!((scene.frame_count(), scene.has_ground_truth()), (3, true));
    assert_eq!(scene.read_frame(2).unwrap().width(), 32);
    let error = open_scene("synthetic:frames=many", &DatasetSettings::default()).unwrap_err();
    assert!(matches!(error, DatasetError::Synthetic(_)), "{error}");
}

#[test]
fn impossible_settings_are_refused_on_opening() {
    let settings = DatasetSettings::default().with(|settings| settings.stride = 0);
    assert!(matches!(open_scene("synthetic", &settings), Err(DatasetError::Setting(_))));
}

fn write_empty_files(names: &[&str], folder: &Path) {
    for name in names {
        fs::create_dir_all(folder.join(name).parent().unwrap()).unwrap();
        fs::write(folder.join(name), "").unwrap();
    }
}

#[test]
fn missing_parts_of_a_scene_are_reported() {
    let error_without = |write: fn(&Path), remove: &str| {
        let folder = tempfile::tempdir().unwrap();
        write(folder.path());
        let part = folder.path().join(remove);
        if part.is_dir() {
            fs::remove_dir_all(part).unwrap()
        } else {
            fs::remove_file(part).unwrap()
        }
        let error = open_scene(folder.path(), &DatasetSettings::default()).unwrap_err().to_string();
        error.replace(&folder.path().display().to_string(), "SCENE")
    };
    let scannet = |folder: &Path| {
        write_scannet(folder, 2, &ScannetSizes { color: (16, 12), depth: (16, 12), labels: (16, 12) });
    };
    assert!(error_without(scannet, "depth").contains("this is missing: depth/ (found"));
    assert!(error_without(scannet, "color").contains("this is missing: color/ (found"));
    assert_eq!(
        error_without(scannet, "intrinsic"),
        "SCENE: the camera is not known: describe it in intrinsic/intrinsic_color.txt and intrinsic/intrinsic_depth.txt, or \
         give its focal length in pixels with --fx"
    );
    assert_eq!(
        error_without(scannet, "intrinsic/intrinsic_color.txt"),
        "SCENE/intrinsic/intrinsic_color.txt: the camera intrinsics file is missing"
    );
    let sevenscenes = |folder: &Path| write_sevenscenes(folder, 1);
    assert_eq!(
        error_without(sevenscenes, "frame-000000.depth.png"),
        "SCENE: looks like a scene of format 7scenes, but this is missing: frame-<number>.depth.png (found: \
         frame-<number>.color.png or .jpg)"
    );
    assert!(
        error_without(sevenscenes, "frame-000000.color.jpg")
            .contains("this is missing: frame-<number>.color.png or .jpg")
    );
    let replica = |folder: &Path| write_empty_files(&["traj.txt", "results/frame000000.jpg"], folder);
    let error = error_without(replica, "traj.txt");
    assert!(
        error.contains("format replica, but this is missing: results/depth<number>.png (found: results/, "),
        "{error}"
    );
    let no_depth = |folder: &Path| write_empty_files(&["traj.txt", "results/frame0.jpg", "other.txt"], folder);
    assert_eq!(error_without(no_depth, "other.txt"), "SCENE/results: no frames: looked for depth<number>.png");
    let mvpd =
        |folder: &Path| write_empty_files(&["panoptic_val.json", "imagesRGB/a/0.jpg", "imagesDEPTH/a/0.png"], folder);
    assert!(
        error_without(mvpd, "panoptic_val.json")
            .contains("format mvpd, but this is missing: panoptic_<split>.json (found")
    );
}

#[test]
fn empty_subfolders_are_reported() {
    let folder = tempfile::tempdir().unwrap();
    write_scannet(folder.path(), 1, &ScannetSizes { color: (16, 12), depth: (16, 12), labels: (16, 12) });
    fs::remove_file(folder.path().join("pose/0.txt")).unwrap();
    let error = open_scene(folder.path(), &DatasetSettings::default()).unwrap_err().to_string();
    assert!(error.ends_with("pose: no frames: looked for <number>.txt"), "{error}");
}
