//! Recordings of RealSense's own SDK, in the three ways in which its versions write them.

use crate::support::two_ways;
use splatseg_dataset::{DatasetSettings, Format, open_scene};
use std::path::{Path, PathBuf};

const RECORDINGS: [(&str, Format); 3] =
    [("realsense_2.56.bag", Format::Bag), ("realsense_2.58.db3", Format::Db3), ("realsense_2.59.db3", Format::Db3)];

fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/recordings").join(name)
}

/// The millimetres of depth that were written, at a pixel of the depth camera.
fn written(frame: usize, column: usize, row: usize) -> f32 {
    0.5 * (2000 + 10 * column + 20 * row + 50 * frame) as f32
}

#[test]
fn frames_are_those_that_were_recorded() {
    for (name, format) in RECORDINGS {
        let scene = open_scene(data(name), &DatasetSettings::default()).unwrap();
        assert_eq!((scene.format(), scene.frame_count(), scene.has_poses()), (Some(format), 3, false), "{name}");
        // Frames have the resolution of depth, which is less than that of colour: 20 and 30 pixels of focal length.
        assert_eq!(scene.stored_color_size(0), Some((32, 24)), "{name}");
        for index in 0..3 {
            let frame = scene.read_recorded(index).unwrap().frame;
            let pixel = frame.color()[(0, 0)];
            assert!(pixel[2] == 9 + index as u8 && pixel[0] < 16 && pixel[1] < 20, "{name}: {pixel:?}");
            let nearest = frame.depth().pixels().iter().copied().filter(|z| *z > 0.0).fold(f32::INFINITY, f32::min);
            assert!((nearest - written(index, 0, 0) / 1000.0).abs() < 0.02, "{name}: {nearest}");
        }
    }
}

#[test]
fn all_versions_give_the_same_registered_frames() {
    let read = |name: &str| two_ways::read_path(&data(name), &DatasetSettings::default()).unwrap();
    let expected = read("realsense_2.59.db3");
    assert_eq!(expected.warnings, [""; 0]);
    assert!(expected.sources[1].contains(", registered to colour here"), "{:?}", expected.sources);
    for (name, _) in RECORDINGS {
        let found = read(name);
        assert_eq!(found.warnings, [""; 0], "{name}");
        assert_eq!(found.sources[1].split(", ").last(), expected.sources[1].split(", ").last(), "{name}");
        for ((found, _), (expected, _)) in found.frames.iter().zip(&expected.frames) {
            assert!(found.color() == expected.color() && found.intrinsics() == expected.intrinsics(), "{name}");
            let pairs = found.depth().pixels().iter().zip(expected.depth().pixels());
            // Text has six digits, so that a pixel at an edge may differ.
            let differ = pairs.filter(|(found, expected)| (*found - *expected).abs() > 1e-5).count();
            assert!(differ <= 2, "{name}: {differ} pixels differ");
        }
    }
    // A point 1.05 m in front of the depth camera is where the extrinsics place it.
    let (frame, _) = &expected.frames[0];
    let depth = frame.depth();
    let seen = depth.pixels().iter().filter(|z| **z > 0.0).count();
    assert!(2 * seen > depth.pixels().len(), "{seen} of {}", depth.pixels().len());
    let turn = glam::Mat3::from_rotation_y(0.02);
    let (column, row) = (12usize, 8usize);
    let z = written(0, column, row) / 1000.0;
    let point = turn * (glam::Vec3::new((column as f32 - 11.5) / 20.0, (row as f32 - 7.5) / 20.0, 1.0) * z)
        + glam::Vec3::new(0.015, 0.002, -0.001);
    let pixel = frame.intrinsics().project(point).unwrap().round();
    let found = depth[(pixel.x as usize, pixel.y as usize)];
    assert!((found - point.z).abs() < 0.01, "{found}, expected {}", point.z);
}

#[test]
fn the_unit_of_depth_can_be_chosen() {
    let settings = DatasetSettings::default().with(|settings| settings.depth_scale = Some(1000.0));
    for (name, _) in RECORDINGS {
        let frame = open_scene(data(name), &settings).unwrap().read_recorded(0).unwrap().frame;
        let nearest = frame.depth().pixels().iter().copied().filter(|z| *z > 0.0).fold(f32::INFINITY, f32::min);
        assert!((nearest - 2.0).abs() < 0.04, "{name}: {nearest}");
    }
}
