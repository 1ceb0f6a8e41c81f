//! The camera and the limits of rasterisation, as kernels take them.

use cubecl::prelude::*;
use glam::Vec3;

/// A `splatseg_render::Camera`, and what the memory asks of a frame.
#[derive(CubeLaunch, CubeType, Clone, Copy)]
pub(crate) struct View {
    /// Rows of the rotation from the world to the camera.
    pub xx: f32,
    pub xy: f32,
    pub xz: f32,
    pub yx: f32,
    pub yy: f32,
    pub yz: f32,
    pub zx: f32,
    pub zy: f32,
    pub zz: f32,
    /// Translation from the world to the camera, metres.
    pub tx: f32,
    pub ty: f32,
    pub tz: f32,
    /// Focal lengths and principal point, pixels.
    pub fx: f32,
    pub fy: f32,
    pub cx: f32,
    pub cy: f32,
    /// Size of the image, pixels.
    pub width: u32,
    pub height: u32,
    /// Size of the image, tiles.
    pub columns: u32,
    pub rows: u32,
    /// Limits of rasterisation.
    pub near_plane: f32,
    pub far_plane: f32,
    pub low_pass: f32,
    pub max_alpha: f32,
    pub min_alpha: f32,
    pub min_transmittance: f32,
    /// Standard deviations at which an opaque Gaussian has the smallest alpha.
    pub deviations: f32,
}

/// A point, metres.
#[derive(CubeType, Clone, Copy)]
pub(crate) struct Point {
    pub x: f32,
    pub y: f32,
    pub z: f32,
}

/// The centre of a Gaussian in the camera's frame. `balls` are `[gaussians, 4]`: centre and radius.
#[cube]
pub(crate) fn to_camera(balls: &[f32], gaussian: usize, view: &View) -> Point {
    let x = balls[gaussian * 4];
    let y = balls[gaussian * 4 + 1];
    let z = balls[gaussian * 4 + 2];
    Point {
        x: view.xx * x + view.xy * y + view.xz * z + view.tx,
        y: view.yx * x + view.yy * y + view.yz * z + view.ty,
        z: view.zx * x + view.zy * y + view.zz * z + view.tz,
    }
}

/// Rounds a number that is not negative to the nearest integer, halves up.
#[cube]
pub(crate) fn round_half_up(x: f32) -> f32 {
    let below = x.floor();
    select(x - below >= 0.5, below + 1.0, below)
}

/// The launch argument for a camera.
pub(crate) fn view_args(camera: &splatseg_render::Camera) -> ViewLaunch {
    let rotation = camera.camera_from_world_rotation;
    let [x, y, z]: [Vec3; 3] = [rotation.row(0), rotation.row(1), rotation.row(2)];
    let translation = camera.camera_from_world_translation;
    let (intrinsics, limits) = (&camera.intrinsics, &camera.limits);
    let tiles = |pixels: usize| pixels.div_ceil(16) as u32;
    ViewLaunch::new(
        x.x,
        x.y,
        x.z,
        y.x,
        y.y,
        y.z,
        z.x,
        z.y,
        z.z,
        translation.x,
        translation.y,
        translation.z,
        intrinsics.fx,
        intrinsics.fy,
        intrinsics.cx,
        intrinsics.cy,
        intrinsics.width as u32,
        intrinsics.height as u32,
        tiles(intrinsics.width),
        tiles(intrinsics.height),
        limits.near_plane,
        limits.far_plane,
        limits.low_pass,
        limits.max_alpha,
        limits.min_alpha,
        limits.min_transmittance,
        (2.0 * (1.0 / limits.min_alpha).ln()).sqrt(),
    )
}
