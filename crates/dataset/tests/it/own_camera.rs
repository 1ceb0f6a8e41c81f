//! Cameras given by the settings, for recordings without a calibration file.

use crate::support::*;
use splatseg_dataset::{DatasetSettings, FrameSource, FrameStream, GroundTruth, Scene, open_scene};
use splatseg_geometry::Intrinsics;
use std::fs;
use std::path::Path;
use std::sync::Arc;

const CAMERA: Intrinsics = Intrinsics { fx: 50.0, fy: 51.0, cx: 30.0, cy: 20.0, width: 64, height: 48 };

fn own() -> DatasetSettings {
    let Intrinsics { fx, fy, cx, cy, .. } = CAMERA;
    DatasetSettings::default().with(|s| {
        (s.fx, s.fy, s.cx, s.cy) = (Some(fx.into()), Some(fy.into()), Some(cx.into()), Some(cy.into()));
    })
}

fn fx(fx: f64) -> DatasetSettings {
    DatasetSettings::default().with(|s| s.fx = Some(fx))
}

/// Writes images of 64x48 pixels, without a camera or poses; depth is 2 m.
fn write_folder(folder: &Path) {
    for part in ["color", "depth"] {
        fs::create_dir(folder.join(part)).unwrap();
    }
    for index in 0..3 {
        write_color(&folder.join(format!("color/{index}.png")), 64, 48);
        write_png16(&folder.join(format!("depth/{index}.png")), (64, 48), |_, _| 2000);
    }
}

fn camera(path: &Path, settings: &DatasetSettings) -> Intrinsics {
    *open_scene(path, settings).unwrap().read_recorded(0).unwrap().frame.intrinsics()
}

fn refused(path: &Path, settings: &DatasetSettings) -> String {
    let error = open_scene(path, settings).unwrap_err().to_string();
    error.replace(&path.display().to_string(), "SCENE")
}

#[test]
fn a_folder_of_images_needs_only_a_focal_length() {
    let folder = tempfile::tempdir().unwrap();
    write_folder(folder.path());
    assert_eq!(
        refused(folder.path(), &DatasetSettings::default()),
        "SCENE: the camera is not known: describe it in camera.json, or give its focal length in pixels with --fx"
    );
    let scene = open_scene(folder.path(), &fx(50.0)).unwrap();
    let frame = scene.read_recorded(2).unwrap().frame;
    assert_eq!(*frame.intrinsics(), Intrinsics { fy: 50.0, cx: 31.5, cy: 23.5, ..CAMERA });
    assert_eq!(frame.depth()[(9, 9)], 2.0, "millimetres");
    assert_eq!(camera(folder.path(), &own()), CAMERA);
}

#[test]
fn intrinsics_are_those_of_the_stored_images() {
    let folder = tempfile::tempdir().unwrap();
    write_folder(folder.path());
    let settings = own().with(|s| (s.resize, s.crop_border) = ("32x24".parse().ok(), 2));
    let scene = open_scene(folder.path(), &settings).unwrap();
    let frame = FrameStream::open(scene, &settings, GroundTruth::Skip).unwrap().next().unwrap().unwrap().frame;
    assert_eq!(*frame.intrinsics(), CAMERA.resized(32, 24).cropped(2));
}

#[test]
fn images_of_another_size_than_the_first_are_reported() {
    let folder = tempfile::tempdir().unwrap();
    write_folder(folder.path());
    write_color(&folder.path().join("color/1.png"), 32, 24);
    write_png16(&folder.path().join("depth/1.png"), (32, 24), |_, _| 2000);
    let scene = open_scene(folder.path(), &own()).unwrap();
    let error = scene.read_recorded(1).unwrap_err().to_string();
    assert!(error.ends_with("1.png: the colour image has 32x24 pixels, but the first image has 64x48"), "{error}");
    assert!(scene.read_recorded(2).is_ok());
    // A damaged first image does not matter.
    truncate(&folder.path().join("color/0.png"));
    fs::write(folder.path().join("color/0.png"), "no image").unwrap();
    fs::remove_file(folder.path().join("color/1.png")).unwrap();
    let scene = open_scene(folder.path(), &own()).unwrap();
    assert!(scene.read_recorded(0).is_err() && scene.read_recorded(1).is_ok());
}

#[test]
fn a_recorded_camera_is_replaced() {
    let folder = tempfile::tempdir().unwrap();
    write_folder(folder.path());
    let file = r#"{"width": 64, "height": 48, "fx": 60, "fy": 60, "cx": 31, "cy": 23, "depth_units_per_metre": 4000}"#;
    fs::write(folder.path().join("camera.json"), file).unwrap();
    assert_eq!(camera(folder.path(), &own()), CAMERA);
    let depth = open_scene(folder.path(), &own()).unwrap().read_recorded(0).unwrap().frame.depth()[(9, 9)];
    assert_eq!(depth, 0.5, "the file's other values are kept");
    let sevenscenes = tempfile::tempdir().unwrap();
    write_sevenscenes(sevenscenes.path(), 1);
    assert_eq!(camera(sevenscenes.path(), &own()), CAMERA);
    fs::remove_file(sevenscenes.path().join("camera-intrinsics.txt")).unwrap();
    assert_eq!(camera(sevenscenes.path(), &own()), CAMERA);
    let room = Path::new("synthetic:frames=1,width=64,height=48");
    assert_eq!(camera(room, &own()), CAMERA);
    let pictures = |settings: &DatasetSettings| {
        let frame = open_scene(room, settings).unwrap().read_recorded(0).unwrap().frame;
        (frame.color().pixels().to_vec(), frame.depth().pixels().to_vec())
    };
    assert_eq!(pictures(&own()), pictures(&DatasetSettings::default()));
    let recording = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/mcap/room.mcap");
    assert_eq!(camera(&recording, &own()), Intrinsics { width: 320, height: 240, ..CAMERA });
}

#[test]
fn scannet_needs_no_intrinsics_either() {
    let folder = tempfile::tempdir().unwrap();
    write_scannet(folder.path(), 1, &ScannetSizes { color: (128, 96), depth: (64, 48), labels: (128, 96) });
    // Twice the focal length that the images were written with, so the file is not used.
    let settings = fx(256.0);
    for has_files in [true, false] {
        if !has_files {
            fs::remove_dir_all(folder.path().join("intrinsic")).unwrap();
        }
        let found = camera(folder.path(), &settings);
        assert_eq!((found.fx, found.fy, found.cx, found.cy), (128.0, 128.0, 31.5, 23.5));
        let labels = open_scene(folder.path(), &settings).unwrap().read_ground_truth(0).unwrap().unwrap();
        assert_eq!((labels.size(), labels[(31, 5)], labels[(32, 5)]), ((64, 48), 1, 2));
    }
}

#[test]
fn impossible_cameras_are_reported() {
    let folder = tempfile::tempdir().unwrap();
    write_folder(folder.path());
    let told = |change: fn(&mut DatasetSettings)| refused(folder.path(), &DatasetSettings::default().with(change));
    assert_eq!(told(|s| s.fx = Some(0.0)), "dataset.fx is 0, expected more than 0 and at most 1000000");
    assert_eq!(told(|s| s.fx = Some(f64::NAN)), "dataset.fx is NaN, expected more than 0 and at most 1000000");
    assert_eq!(told(|s| s.fy = Some(50.0)), "dataset.fy is 50, expected no value without dataset.fx (--fx)");
    let scene: Arc<dyn Scene> = open_scene(folder.path(), &fx(0.01)).unwrap();
    let error = FrameStream::open(scene, &fx(0.01), GroundTruth::Skip).unwrap_err().to_string();
    assert_eq!(
        error,
        "dataset.fx, fy, cx and cy: focal lengths: found 1e-2 and 1e-2 pixels, expected those of a camera of 64x48 pixels, \
         about 64"
    );
    let scene = open_scene(folder.path(), &fx(70.0)).unwrap();
    assert!(FrameStream::open(scene, &fx(70.0), GroundTruth::Skip).unwrap().description().frame_size.is_some());
}
