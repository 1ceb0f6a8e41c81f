//! Depth images of every kind, written by NumPy, OpenCV, tifffile and OpenEXR (`tools/make_depth_test_data.py`).

use crate::support::*;
use serde::Deserialize;
use splatseg_dataset::{DatasetError, DatasetSettings, open_scene};
use std::fs;
use std::path::{Path, PathBuf};

/// The expected content of the files.
#[derive(Deserialize)]
struct Expected {
    width: u32,
    height: u32,
    /// Row by row; 0 where there is no depth.
    millimetres: Vec<u32>,
}

fn data() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/depth_files")
}

fn expected() -> Expected {
    serde_json::from_str(&fs::read_to_string(data().join("depth.json")).unwrap()).unwrap()
}

fn names() -> Vec<String> {
    let names = fs::read_dir(data()).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let mut names: Vec<String> = names.filter(|name| !name.ends_with(".json")).collect();
    names.sort();
    names
}

/// Writes a plain folder with one frame whose depth is a copy of `name`.
fn folder_with(name: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for part in ["color", "depth"] {
        fs::create_dir(folder.path().join(part)).unwrap();
    }
    let Expected { width, height, .. } = expected();
    write_color(&folder.path().join("color/0.png"), width, height);
    let ending = name.rsplit('.').next().unwrap();
    fs::copy(data().join(name), folder.path().join(format!("depth/0.{ending}"))).unwrap();
    folder
}

fn read(folder: &Path, settings: &DatasetSettings) -> Result<Vec<f32>, DatasetError> {
    let settings = settings.clone().with(|s| s.fx = Some(20.0));
    let frame = open_scene(folder, &settings)?.read_recorded(0)?.frame;
    Ok(frame.depth().pixels().to_vec())
}

#[test]
fn every_kind_of_file_holds_the_same_depth() {
    let expected = expected();
    let mut count = 0;
    for name in names().iter().filter(|name| !name.starts_with("refused_")) {
        let found = read(folder_with(name).path(), &DatasetSettings::default()).unwrap();
        let half_a_unit = |found: &f32, expected: &u32| (found * 1000.0 - *expected as f32).abs() <= 0.501;
        assert_eq!(found.len(), expected.millimetres.len(), "{name}");
        for (found, expected) in found.iter().zip(&expected.millimetres) {
            assert!(half_a_unit(found, expected) && (*found > 0.0) == (*expected > 0), "{name}: {found} {expected}");
        }
        // Metres are exact where they are stored.
        let is_exact = found.iter().all(|depth| (depth * 128.0).fract() == 0.0);
        assert_eq!(is_exact, !name.starts_with("integers"), "{name}");
        count += 1;
    }
    assert_eq!(count, 18);
}

#[test]
fn the_unit_setting_applies_to_integers_and_to_other_numbers() {
    let settings = DatasetSettings::default().with(|settings| settings.depth_scale = Some(500.0));
    let in_metres = |name: &str, settings: &DatasetSettings| read(folder_with(name).path(), settings).unwrap();
    for (name, factor) in [("integers.npy", 2.0), ("integers.png", 2.0), ("floats.npy", 1.0 / 500.0)] {
        let plain = in_metres(name, &DatasetSettings::default());
        for (scaled, plain) in in_metres(name, &settings).iter().zip(plain) {
            assert!((scaled - plain * factor).abs() < 1e-6, "{name}: {scaled} {plain}");
        }
    }
}

#[test]
fn the_unit_of_a_camera_file_applies_to_every_file() {
    let folder = folder_with("floats.npy");
    let Expected { width, height, .. } = expected();
    let camera = format!(
        r#"{{"width": {width}, "height": {height}, "fx": 20, "fy": 20, "cx": 5, "cy": 9, "depth_scale": 100}}"#
    );
    fs::write(folder.path().join("camera.json"), camera).unwrap();
    let (stated, plain) = (read(folder.path(), &DatasetSettings::default()).unwrap(), folder_with("floats.npy"));
    let plain = read(plain.path(), &DatasetSettings::default()).unwrap();
    assert!(stated.iter().zip(plain).all(|(stated, plain)| (stated * 100.0 - plain).abs() < 1e-5));
}

#[test]
fn what_is_not_read_says_what_it_is() {
    let refused = |name: &str| {
        let folder = folder_with(name);
        let error = read(folder.path(), &DatasetSettings::default()).unwrap_err().to_string();
        error.replace(&folder.path().display().to_string(), "SCENE")
    };
    assert_eq!(
        refused("refused_piz.exr"),
        "SCENE/depth/0.exr: depth image, compression: found PIZ, expected none, RLE, ZIPS or ZIP"
    );
    assert_eq!(
        refused("refused_colour.exr"),
        "SCENE/depth/0.exr: depth image, channels: found \"B, G, R\", expected one channel, or one named Z or depth"
    );
    assert_eq!(
        refused("refused_colour.tiff"),
        "SCENE/depth/0.tiff: the depth image has RGB(8) pixels, expected one channel of 16-bit integers or 32-bit floats"
    );
    let told = refused("refused_big_endian.npy");
    assert!(told.contains("depth image, type of the numbers: found \"'>u2'\", expected '<u2'"), "{told}");
}

#[test]
fn other_formats_have_depth_in_other_files_too() {
    let sizes = ScannetSizes { color: (11, 19), depth: (11, 19), labels: (11, 19) };
    let scannet = tempfile::tempdir().unwrap();
    write_scannet(scannet.path(), 2, &sizes);
    fs::remove_file(scannet.path().join("depth/1.png")).unwrap();
    fs::copy(data().join("floats.npy"), scannet.path().join("depth/1.npy")).unwrap();
    let scene = open_scene(scannet.path(), &DatasetSettings::default()).unwrap();
    assert_eq!((scene.frame_count(), scene.left_out().len()), (2, 0));
    let expected = read(folder_with("floats.npy").path(), &DatasetSettings::default()).unwrap();
    assert_eq!(scene.read_recorded(1).unwrap().frame.depth().pixels(), expected);
    assert_eq!(scene.read_ground_truth(1).unwrap().unwrap().size(), (11, 19));
    let sevenscenes = tempfile::tempdir().unwrap();
    write_sevenscenes(sevenscenes.path(), 1);
    fs::remove_file(sevenscenes.path().join("frame-000000.depth.png")).unwrap();
    fs::copy(data().join("floats_zip.exr"), sevenscenes.path().join("frame-000000.depth.exr")).unwrap();
    let error = open_scene(sevenscenes.path(), &DatasetSettings::default()).unwrap().read_recorded(0).unwrap_err();
    assert!(error.to_string().contains("depth.exr: the depth image has 11x19 pixels, but its colour image has 64x48"));
}

#[test]
fn folders_of_other_files_are_named_by_their_extensions() {
    let folder = folder_with("floats.npy");
    let part = folder.path().join("depth");
    fs::remove_file(part.join("0.npy")).unwrap();
    for (name, count) in [("bin", 3), ("txt", 1)] {
        (0..count).for_each(|index| fs::write(part.join(format!("{index}.{name}")), "").unwrap());
    }
    fs::write(part.join("LICENSE"), "").unwrap();
    let error = read(folder.path(), &DatasetSettings::default()).unwrap_err().to_string();
    let expected =
        "no frames: found 3 .bin, 1 .txt, 1 without an extension, expected <name>.png, .tiff, .npy, .exr or .pfm";
    assert!(error.ends_with(expected), "{error}");
}
