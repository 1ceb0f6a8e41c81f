//! Projection of 3D Gaussians to 2D Gaussians on the image ("EWA splatting", as in 3DGS and gsplat).

use crate::{Camera, Shape, Splats};
use glam::{Mat3, Vec2, Vec3};
use rayon::prelude::*;

/// Gaussians projected by one task: small enough to balance two cores, large enough for negligible overhead.
const CHUNK: usize = 4096;

/// A Gaussian projected to the image.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ProjectedGaussian {
    /// Index of the Gaussian.
    pub gaussian: u32,
    /// Centre, pixels (column, row); pixel centres have integer coordinates.
    pub mean: Vec2,
    /// Inverse 2D covariance `(a, b, c)`: a pixel at offset (dx, dy) has sigma = (a dx² + c dy²)/2 + b dx dy.
    pub conic: [f32; 3],
    /// Opacity in [0, 1].
    pub opacity: f32,
    /// Camera z of the centre, metres.
    pub depth: f32,
    /// Half width and half height of the bounding box, outside which alpha is below its minimum, pixels.
    pub half_extent: Vec2,
}

/// Projects the Gaussians `first..` of `gaussians` and keeps those that can touch the image, in index order.
pub fn project(gaussians: &(impl Splats + ?Sized), first: usize, camera: &Camera) -> Vec<ProjectedGaussian> {
    let chunks: Vec<Vec<ProjectedGaussian>> = (first..gaussians.count())
        .into_par_iter()
        .step_by(CHUNK)
        .map(|start| {
            let end = (start + CHUNK).min(gaussians.count());
            (start..end).filter_map(|index| project_one(gaussians, index, camera)).collect()
        })
        .collect();
    chunks.concat()
}

/// Projects one Gaussian; `None` if it is outside the near and far planes or the image, too faint, or not finite.
pub fn project_one(gaussians: &(impl Splats + ?Sized), index: usize, camera: &Camera) -> Option<ProjectedGaussian> {
    let limits = &camera.limits;
    let center = camera.to_camera(gaussians.mean(index));
    let opacity = gaussians.opacity(index);
    let in_range = center.z > limits.near_plane && center.z < limits.far_plane;
    if !in_range || opacity < limits.min_alpha || !opacity.is_finite() {
        return None;
    }
    let (width, height) = (camera.intrinsics.width as f32, camera.intrinsics.height as f32);
    let mean = project_center(center, camera);
    // Alpha reaches its minimum where sigma = ln(opacity / minimum).
    let deviations = (2.0 * (opacity / limits.min_alpha).ln()).sqrt();
    let [xx, xy, yy] = covariance_2d(gaussians.shape(index), center, camera);
    let half_extent = Vec2::new(deviations * xx.sqrt(), deviations * yy.sqrt());
    // The image's edge is half a pixel beyond the outermost pixel centres.
    let inside = mean.x + half_extent.x > -0.5
        && mean.x - half_extent.x < width - 0.5
        && mean.y + half_extent.y > -0.5
        && mean.y - half_extent.y < height - 0.5;
    let determinant = xx * yy - xy * xy;
    let conic = [yy / determinant, -xy / determinant, xx / determinant];
    let finite = conic.iter().all(|entry| entry.is_finite());
    // NaNs fail `inside`; a determinant that is not positive comes from overflow or cancellation.
    (inside && determinant > 0.0 && finite).then_some(ProjectedGaussian {
        gaussian: index as u32,
        mean,
        conic,
        opacity,
        depth: center.z,
        half_extent,
    })
}

/// Pixel at which a camera-frame point appears.
#[inline(always)]
fn project_center(center: Vec3, camera: &Camera) -> Vec2 {
    let intrinsics = &camera.intrinsics;
    Vec2::new(intrinsics.fx * center.x / center.z + intrinsics.cx, intrinsics.fy * center.y / center.z + intrinsics.cy)
}

/// `(xx, xy, yy)` of J V J^T plus the low-pass, with V the covariance in the camera's frame and J the local affine
/// approximation of projection, whose centre is clamped to 0.3 times the field of view beyond the image.
fn covariance_2d(shape: Shape, center: Vec3, camera: &Camera) -> [f32; 3] {
    let intrinsics = &camera.intrinsics;
    let (fx, fy) = (intrinsics.fx, intrinsics.fy);
    let (width, height) = (intrinsics.width as f32, intrinsics.height as f32);
    // gsplat's principal point counts from the image's corner.
    let (cx, cy) = (intrinsics.cx + 0.5, intrinsics.cy + 0.5);
    let z = center.z;
    let margin_x = 0.15 * width / fx;
    let margin_y = 0.15 * height / fy;
    let tx = z * (center.x / z).clamp(-(cx / fx + margin_x), (width - cx) / fx + margin_x);
    let ty = z * (center.y / z).clamp(-(cy / fy + margin_y), (height - cy) / fy + margin_y);
    let row_x = Vec3::new(fx / z, 0.0, -fx * tx / (z * z));
    let row_y = Vec3::new(0.0, fy / z, -fy * ty / (z * z));
    let low_pass = camera.limits.low_pass;
    match shape {
        // A ball looks the same from every side: no rotation is needed.
        Shape::Ball(radius) => {
            let variance = radius * radius;
            [
                variance * row_x.length_squared() + low_pass,
                variance * row_x.dot(row_y),
                variance * row_y.length_squared() + low_pass,
            ]
        }
        Shape::Ellipsoid(scale, quat) => {
            let rotation = camera.camera_from_world_rotation * Mat3::from_quat(quat.normalize());
            let axes = (rotation * Mat3::from_diagonal(scale)).transpose();
            let (x, y) = (axes * row_x, axes * row_y);
            [x.length_squared() + low_pass, x.dot(y), y.length_squared() + low_pass]
        }
    }
}
