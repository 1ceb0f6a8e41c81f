//! Undistorted images agree with OpenCV's. `tools/make_undistortion_test_data.py` generates the reference images.

use crate::support::warnings::with_warnings;
use glam::dvec2;
use proptest::prelude::*;
use serde::Deserialize;
use splatseg_dataset::{LensCorrection, Undistortion, read_color_image};
use splatseg_geometry::{Distortion, Image, Intrinsics};
use std::path::{Path, PathBuf};

#[derive(Deserialize)]
struct Golden {
    camera: Intrinsics,
    lenses: Vec<Lens>,
}

#[derive(Deserialize)]
struct Lens {
    name: String,
    model: String,
    coefficients: Vec<f64>,
    /// Column, row, and their position in the distorted image according to OpenCV.
    sources: Vec<(usize, usize, f32, f32)>,
}

impl Lens {
    fn distortion(&self) -> Distortion {
        Distortion::from_coefficients(&self.model, &self.coefficients).unwrap()
    }
}

fn file(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/undistort").join(name)
}

fn golden() -> Golden {
    serde_json::from_slice(&std::fs::read(file("lenses.json")).unwrap()).unwrap()
}

fn map(camera: &Intrinsics, distortion: &Distortion) -> Undistortion {
    Undistortion::new(camera, distortion, Path::new("camera")).unwrap().expect("the lens distorts")
}

/// Returns true if a position is in the image but not in the outer half of its border pixels, which OpenCV mixes with
/// black.
fn is_inside(camera: &Intrinsics, x: f32, y: f32) -> bool {
    (0.0..=camera.width as f32 - 1.0).contains(&x) && (0.0..=camera.height as f32 - 1.0).contains(&y)
}

#[test]
fn sources_are_those_of_opencv() {
    let Golden { camera, lenses } = golden();
    for lens in &lenses {
        let map = map(&camera, &lens.distortion());
        for &(column, row, x, y) in lens.sources.iter().filter(|(_, _, x, y)| is_inside(&camera, *x, *y)) {
            let [found_x, found_y] = map.source(column, row).expect("inside");
            let off = (found_x - x).abs().max((found_y - y).abs());
            assert!(off < 2e-3, "{}: ({column}, {row}) from ({found_x}, {found_y}), OpenCV ({x}, {y})", lens.name);
        }
        assert_eq!(map.source(camera.width, 0), None);
    }
}

#[test]
fn colour_is_that_of_opencv() {
    let Golden { camera, lenses } = golden();
    let distorted = read_color_image(&file("color.png")).unwrap();
    for lens in &lenses {
        let map = map(&camera, &lens.distortion());
        let found = map.color(&distorted, Path::new("color.png")).unwrap();
        let expected = read_color_image(&file(&format!("{}_color.png", lens.name))).unwrap();
        let mut compared = 0;
        for row in 0..camera.height {
            for column in 0..camera.width {
                let place = map.source(column, row).filter(|[x, y]| is_inside(&camera, *x, *y));
                let (found, expected) = (found[(column, row)], expected[(column, row)]);
                if place.is_some() {
                    compared += 1;
                    let off = (0..3).map(|channel| found[channel].abs_diff(expected[channel])).max();
                    assert!(off <= Some(1), "{}: ({column}, {row}) is {found:?}, OpenCV {expected:?}", lens.name);
                } else if map.source(column, row).is_none() {
                    assert_eq!(found, [0; 3]);
                }
            }
        }
        assert!(compared > 2000, "{}: {compared} pixels", lens.name);
    }
}

#[test]
fn depth_is_that_of_opencv() {
    let Golden { camera, lenses } = golden();
    let distorted = depth_image("depth.png");
    for lens in &lenses {
        let map = map(&camera, &lens.distortion());
        let found = map.depth(&distorted, Path::new("depth.png")).unwrap();
        let expected = depth_image(&format!("{}_depth.png", lens.name));
        let differ = found.pixels().iter().zip(expected.pixels()).filter(|(found, expected)| found != expected).count();
        // Halfway between two pixels, either is correct.
        assert!(differ <= 2, "{}: {differ} pixels differ", lens.name);
    }
}

/// Reads the 16-bit values of a PNG.
fn depth_image(name: &str) -> Image<f32> {
    let pixels = image::open(file(name)).unwrap().into_luma16();
    let (width, height) = (pixels.width() as usize, pixels.height() as usize);
    Image::from_pixels(width, height, pixels.pixels().map(|pixel| f32::from(pixel.0[0])).collect()).unwrap()
}

#[test]
fn a_lens_that_does_not_distort_has_no_map() {
    let zeros = Distortion::from_coefficients("plumb_bob", &[0.0; 5]).unwrap();
    assert!(Undistortion::new(&golden().camera, &zeros, Path::new("camera")).unwrap().is_none());
}

#[test]
fn images_of_another_size_are_refused() {
    let Golden { camera, lenses } = golden();
    let map = map(&camera, &lenses[0].distortion());
    let error = map.depth(&Image::filled(32, 24, 1.0), Path::new("7.png")).unwrap_err();
    assert_eq!(error.to_string(), "7.png: the depth image has 32x24 pixels, but the camera has 64x48");
}

#[test]
fn a_model_that_folds_the_image_shows_nothing_beyond_the_fold() {
    let Golden { camera, .. } = golden();
    // Without a limit, sources in the corners would fold back to the centre.
    let folding = Distortion::from_coefficients("plumb_bob", &[-0.9, 0.0, 0.0, 0.0]).unwrap();
    let map = map(&camera, &folding);
    assert_eq!(map.source(0, 0), None);
    assert!(map.source(31, 25).is_some());
}

proptest! {
    #[test]
    fn the_distortion_of_a_picture_is_undone(k1 in -0.3f64..0.3, k2 in -0.05f64..0.05, p1 in -0.003f64..0.003) {
        // The view angle of most cameras, where a polynomial with such coefficients still describes a lens.
        let camera = Intrinsics { fx: 60.0, fy: 60.0, cx: 31.0, cy: 23.0, width: 64, height: 48 };
        let lens = Distortion::from_coefficients("plumb_bob", &[k1, k2, p1, 0.001]).unwrap();
        // A ramp over the scene, seen through the lens.
        let ramp = |x: f64, y: f64| [128.0 + 150.0 * x, 128.0 + 150.0 * y, 90.0];
        let distorted = Image::from_fn(64, 48, |column, row| {
            let seen = lens.undistort(dvec2((column as f64 - 31.0) / 60.0, (row as f64 - 23.0) / 60.0));
            seen.map_or([0; 3], |point| ramp(point.x, point.y).map(|value| value.round() as u8))
        });
        let map = map(&camera, &lens);
        let color = map.color(&distorted, Path::new("a")).unwrap();
        for (column, row) in [(31, 23), (12, 30), (50, 12), (20, 8)] {
            let expected = ramp((column as f64 - 31.0) / 60.0, (row as f64 - 23.0) / 60.0);
            for (found, expected) in color[(column, row)].iter().zip(expected) {
                prop_assert!((f64::from(*found) - expected).abs() <= 1.6, "({column}, {row}): {found} for {expected}");
            }
        }
    }

    #[test]
    fn depth_is_never_mixed(k1 in -0.4f64..0.4, k2 in -0.2f64..0.2, seed in 0usize..100) {
        let camera = golden().camera;
        let lens = Distortion::from_coefficients("plumb_bob", &[k1, k2, 0.001, 0.0]).unwrap();
        let measured = Image::from_fn(64, 48, |column, row| ((column * 31 + row * 17 + seed) % 7) as f32);
        let depth = map(&camera, &lens).depth(&measured, Path::new("a")).unwrap();
        prop_assert!(depth.pixels().iter().all(|z| z.fract() == 0.0 && *z < 7.0));
    }

    #[test]
    fn any_lens_gives_images(k in prop::array::uniform8(-1e6f64..1e6), focal in 1e-3f32..1e6, center in -1e6f32..1e6) {
        let camera = Intrinsics { fx: focal, fy: 51.0, cx: center, cy: 20.0, width: 5, height: 4 };
        let lens = Distortion::from_coefficients("rational_polynomial", &k).unwrap();
        let map = Undistortion::new(&camera, &lens, Path::new("a")).unwrap().expect("not all zero");
        let color = map.color(&Image::filled(5, 4, [7; 3]), Path::new("a")).unwrap();
        prop_assert!(color.pixels().iter().all(|pixel| [[0; 3], [7; 3]].contains(pixel)));
    }
}

#[test]
fn frames_that_arrive_one_by_one_are_corrected_alike() {
    let lens = Distortion::from_coefficients("plumb_bob", &[-0.2, 0.05, 0.001, 0.002, 0.0]).unwrap();
    let camera = golden().camera;
    let color = Image::from_fn(camera.width, camera.height, |x, y| [x as u8, y as u8, 9]);
    let depth = Image::from_fn(camera.width, camera.height, |x, _| 1.0 + x as f32);
    let correction = LensCorrection::default();
    let correct = |camera: &Intrinsics, lens: &Distortion| {
        correction.correct((color.clone(), depth.clone()), (camera, lens), "camera")
    };
    // The map of the camera before is not used for another one.
    for camera in [camera, Intrinsics { fx: 2.0 * camera.fx, ..camera }, camera] {
        let map = map(&camera, &lens);
        let expected = (map.color(&color, Path::new("a")).unwrap(), map.depth(&depth, Path::new("a")).unwrap());
        assert!(correct(&camera, &lens).unwrap() == expected);
    }
    assert!(correct(&camera, &Distortion::None).unwrap() == (color.clone(), depth.clone()));
    let error = correct(&Intrinsics { width: 5, ..camera }, &lens).unwrap_err().to_string();
    assert!(error.starts_with("camera: "), "{error}");
}

#[test]
fn a_lens_that_leaves_most_of_the_image_black_is_doubted() {
    let Golden { camera, lenses } = golden();
    let warnings = |coefficients: &[f64]| {
        let lens = Distortion::from_coefficients("plumb_bob", coefficients).unwrap();
        with_warnings(|| map(&camera, &lens)).1
    };
    let found = warnings(&[80.0, 0.0, 0.0, 0.0]);
    let [warning] = found.as_slice() else { panic!("{found:?}") };
    assert!(warning.starts_with("camera: the lens sees nothing in 9") && warning.contains("coefficients"), "{warning}");
    assert_eq!(warnings(&[-0.3, 0.1, 0.0, 0.0]), [""; 0]);
    for lens in &lenses {
        assert_eq!(with_warnings(|| map(&camera, &lens.distortion())).1, [""; 0], "{}", lens.name);
    }
}
