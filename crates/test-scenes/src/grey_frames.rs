//! Frames of one colour.

use splatseg_geometry::{Image, Intrinsics, Pose, RgbdFrame};

/// A camera that looks through the centre of its image. `focal` is its focal length in both directions, pixels.
pub fn camera(width: usize, height: usize, focal: f32) -> Intrinsics {
    let (cx, cy) = ((width as f32 - 1.0) / 2.0, (height as f32 - 1.0) / 2.0);
    Intrinsics { fx: focal, fy: focal, cx, cy, width, height }
}

/// A grey frame with this depth, metres, which has the camera's size.
pub fn grey_frame(name: impl Into<String>, camera: Intrinsics, depth: Image<f32>, pose: Pose) -> RgbdFrame<'static> {
    let color = Image::filled(camera.width, camera.height, [90; 3]);
    RgbdFrame::new(name, color, depth, camera, pose).unwrap()
}

/// A frame of a grey wall across the whole view, `distance` metres in front of the camera.
pub fn wall(name: impl Into<String>, camera: Intrinsics, distance: f32, pose: Pose) -> RgbdFrame<'static> {
    grey_frame(name, camera, Image::filled(camera.width, camera.height, distance), pose)
}
