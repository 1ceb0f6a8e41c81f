//! Frames of the synthetic room as a phone records them: colour of 64x48 pixels, depth and confidence of a quarter of that.

use crate::support::recording::recording;
use glam::{DMat4, DVec4};
use splatseg_dataset::{DatasetError, DatasetSettings, Framing, ImageSize, open_scene};
use splatseg_geometry::{CameraFrame, Image, Intrinsics, Pose, RgbdFrame};
use splatseg_test_scenes::file_contents;
use std::fs;
use std::path::Path;

/// Size of the depth images, `(width, height)`.
pub const DEPTH_SIZE: (usize, usize) = (16, 12);

/// The frames.
pub fn frames() -> Vec<RgbdFrame<'static>> {
    recording("synthetic:frames=3,width=64,height=48,seed=3").into_iter().map(|(frame, _)| frame).collect()
}

/// Depth of a frame in whole millimetres, at the scale of a quarter.
pub fn small_millimetres(frame: &RgbdFrame) -> Image<u16> {
    let millimetre = |column, row| (frame.depth()[(4 * column + 1, 4 * row + 1)] * 1000.0).round() as u16;
    Image::from_fn(DEPTH_SIZE.0, DEPTH_SIZE.1, millimetre)
}

/// Levels of confidence: 0, 1 and 2 from column to column.
pub fn confidence(column: usize) -> u8 {
    (column % 3) as u8
}

/// A camera-to-world matrix with the axes of OpenGL: the second and third column point the other way.
pub fn opengl_matrix(frame: &RgbdFrame) -> DMat4 {
    frame.world_from_camera().to_matrix() * DMat4::from_diagonal(DVec4::new(1.0, -1.0, -1.0, 1.0))
}

/// The expected frame, if its colour was stored as it is: colour at the scale of depth, depth of all but the lowest
/// confidence, and the camera.
pub struct Expected {
    pub color: Vec<[u8; 3]>,
    pub depth: Vec<f32>,
    pub intrinsics: Intrinsics,
}

/// Returns what is read of a frame. `camera` is that of colour.
pub fn expected(frame: &RgbdFrame, camera: Intrinsics) -> Expected {
    let resize = Some(ImageSize { width: DEPTH_SIZE.0, height: DEPTH_SIZE.1 });
    let whole = CameraFrame::new("0", frame.color().clone(), frame.depth().clone(), camera).unwrap();
    let small = Framing { resize, ..Framing::default() }.apply(whole).unwrap();
    let depth = small_millimetres(frame);
    let measured = |column: usize, row: usize| match confidence(column) {
        0 => 0.0,
        _ => f32::from(depth[(column, row)]) / 1000.0,
    };
    let depth = Image::from_fn(DEPTH_SIZE.0, DEPTH_SIZE.1, measured);
    Expected { color: small.color().pixels().to_vec(), depth: depth.pixels().to_vec(), intrinsics: *small.intrinsics() }
}

/// Checks pixels, which are exact, and the camera of a frame.
pub fn assert_images(read: &CameraFrame, expected: &Expected) {
    assert_eq!(read.color().pixels(), expected.color);
    assert!(read.depth().pixels().iter().zip(&expected.depth).all(|(one, other)| (one - other).abs() < 1e-6));
    let numbers = |camera: &Intrinsics| [camera.fx, camera.fy, camera.cx, camera.cy];
    let pairs = numbers(read.intrinsics()).into_iter().zip(numbers(&expected.intrinsics));
    assert!(pairs.into_iter().all(|(one, other)| (one - other).abs() < 1e-3), "{:?}", read.intrinsics());
    assert_eq!((read.width(), read.height()), (expected.intrinsics.width, expected.intrinsics.height));
}

/// Checks a pose to six digits.
pub fn assert_pose(read: Option<Pose>, expected: &Pose) {
    let (read, expected) = (read.expect("a pose").to_matrix(), expected.to_matrix());
    assert!(read.abs_diff_eq(expected, 1e-6), "{read} {expected}");
}

/// Opens a scene and reads all of it. The first error, without the folder.
pub fn read_all(path: &Path, settings: &DatasetSettings) -> Result<usize, String> {
    let read = || -> Result<usize, DatasetError> {
        let scene = open_scene(path, settings)?;
        (0..scene.frame_count()).try_for_each(|index| scene.read_recorded(index).map(|_| ()))?;
        Ok(scene.frame_count())
    };
    read().map_err(|error| error.to_string().replace(&path.display().to_string(), "SCENE"))
}

/// Returns the error of opening or reading a scene.
pub fn refused(path: &Path) -> String {
    read_all(path, &DatasetSettings::default()).unwrap_err()
}

/// Cuts off every file of a scene at many lengths, and changes bytes of each. Whatever is wrong must come back as an error
/// in one line; an empty file always is one.
pub fn assert_damage_is_told(folder: &Path, scene: &Path) {
    assert!(read_all(scene, &DatasetSettings::default()).is_ok());
    let mut random = 12_345_u64;
    let mut next = |below: usize| {
        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        (random >> 33) as usize % below
    };
    for (name, bytes) in file_contents(folder) {
        let path = folder.join(&name);
        let check = |damaged: &[u8]| {
            fs::write(&path, damaged).unwrap();
            let read = read_all(scene, &DatasetSettings::default());
            assert!(read.as_ref().err().is_none_or(|error| error.len() < 4000), "{read:?}");
            read
        };
        assert!(check(&[]).is_err(), "{} may be empty", name.display());
        // Every length of small files, some of others.
        for keep in (1..bytes.len()).step_by(bytes.len() / 150 + 1) {
            let _ = check(&bytes[..keep]);
        }
        for _ in 0..60 {
            let mut changed = bytes.clone();
            for _ in 0..1 + next(4) {
                let at = next(changed.len());
                changed[at] = next(256) as u8;
            }
            let _ = check(&changed);
        }
        fs::write(&path, &bytes).unwrap();
    }
    assert!(read_all(scene, &DatasetSettings::default()).is_ok(), "the scene is whole again");
}
