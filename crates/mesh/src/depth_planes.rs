//! A depth image with the plane, the certainty and the edges at each pixel.
//!
//! On a plane the inverse depth is linear in the pixel's coordinates. So a plane is fitted to the inverse depths around a
//! pixel, and tells the depth between pixels and the angle at which the surface is seen.

use glam::Vec2;
use rayon::prelude::*;
use splatseg_geometry::{Image, Intrinsics};

/// The plane is fitted to the pixels this far away.
const REACH: usize = 2;
/// Depths that differ by more than this fraction for each pixel between them belong to different surfaces.
const SAME_SURFACE: f32 = 0.04;
/// Pixels with fewer neighbours of the same surface are left out: flying pixels, single measurements.
const MIN_NEIGHBOURS: usize = 5;
/// Standard deviation of a Kinect's depth: these two numbers in metres at [`NEAREST`], growing with the square of the rest.
const NOISE: (f32, f32) = (0.0012, 0.0019);
const NEAREST: f32 = 0.4;
/// Standard deviation of what else is wrong, such as poses, metres. It keeps near measurements from counting for all.
const OTHER_ERRORS: f32 = 0.01;
/// Measurements farther away are left out, metres.
const FARTHEST: f32 = 7.0;
/// Surfaces that are seen at a smaller cosine than this are left out.
const MIN_COSINE: f32 = 0.15;
/// Weight of a pixel at the edge of a surface, relative to others.
const EDGE_WEIGHT: f32 = 0.3;

/// Measurement of a pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct DepthPlane {
    /// Inverse depth, 1/m; 0 where nothing was measured.
    pub(crate) inverse: f32,
    /// Its change per column and per row.
    slope: Vec2,
    /// Distance from the surface for each metre of depth before it.
    pub(crate) distance_per_depth: f32,
    /// Cosine of the angle between the ray and the surface's normal.
    pub(crate) cosine: f32,
    /// How much the measurement counts, from 0 to 1; 0 where it is not used.
    pub(crate) weight: f32,
    /// Least depth around the pixel, metres: space before it is certainly free. 0 where nothing was measured.
    pub(crate) nearest: f32,
}

impl DepthPlane {
    /// Inverse depth of the surface beside the pixel's centre, 1/m.
    pub(crate) fn inverse_at(&self, offset: Vec2) -> f32 {
        self.inverse + self.slope.dot(offset)
    }
}

/// Finds the plane at each pixel of a depth image, metres.
pub(crate) fn depth_planes(depth: &Image<f32>, camera: &Intrinsics) -> Image<DepthPlane> {
    let inverse = depth.map(|depth| if *depth > 0.0 && depth.is_finite() { depth.recip() } else { 0.0 });
    let (width, height) = inverse.size();
    let row = |row: usize| (0..width).map(|column| plane(&inverse, camera, (column, row))).collect::<Vec<_>>();
    let planes: Vec<DepthPlane> = (0..height).into_par_iter().map(row).flatten_iter().collect();
    Image::from_fn(width, height, |column, row| planes[row * width + column])
}

fn plane(inverse: &Image<f32>, camera: &Intrinsics, (column, row): (usize, usize)) -> DepthPlane {
    let here = inverse[(column, row)];
    if here == 0.0 {
        return DepthPlane::default();
    }
    let (width, height) = inverse.size();
    let (mut count, mut is_edge, mut largest) = (0, false, here);
    let (mut uu, mut uv, mut vv, mut uq, mut vq) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for y in row.saturating_sub(REACH)..(row + REACH + 1).min(height) {
        for x in column.saturating_sub(REACH)..(column + REACH + 1).min(width) {
            let other = inverse[(x, y)];
            let steps = x.abs_diff(column).max(y.abs_diff(row));
            if other == 0.0 || steps == 0 {
                continue;
            }
            if steps == 1 {
                largest = largest.max(other);
            }
            if (other / here - 1.0).abs() > SAME_SURFACE * steps as f32 {
                is_edge |= steps == 1;
                continue;
            }
            let (u, v, q) = (x as f32 - column as f32, y as f32 - row as f32, other - here);
            count += 1;
            (uu, uv, vv) = (uu + u * u, uv + u * v, vv + v * v);
            (uq, vq) = (uq + u * q, vq + v * q);
        }
    }
    let determinant = uu * vv - uv * uv;
    let nearest = largest.recip();
    if count < MIN_NEIGHBOURS || determinant < 1e-3 {
        return DepthPlane { inverse: here, nearest, ..DepthPlane::default() };
    }
    let slope = Vec2::new(uq * vv - vq * uv, vq * uu - uq * uv) / determinant;
    let (right, down) = (column as f32 - camera.cx, row as f32 - camera.cy);
    // The plane's normal, divided by its distance from the camera.
    let normal =
        glam::Vec3::new(slope.x * camera.fx, slope.y * camera.fy, here - slope.x * right - slope.y * down).length();
    let distance_per_depth = here / normal;
    let ray = glam::Vec3::new(right / camera.fx, down / camera.fy, 1.0).length();
    let cosine = distance_per_depth / ray;
    let edge = if is_edge { EDGE_WEIGHT } else { 1.0 };
    let is_used = cosine >= MIN_COSINE && here.recip() <= FARTHEST;
    let weight = if is_used { edge * cosine * certainty(here.recip()) } else { 0.0 };
    DepthPlane { inverse: here, slope, distance_per_depth, cosine, weight, nearest }
}

/// How much a measurement of a depth counts, from 0 to 1: the inverse of its variance.
fn certainty(depth: f32) -> f32 {
    let noise = NOISE.0 + NOISE.1 * (depth - NEAREST).powi(2);
    let other = OTHER_ERRORS * OTHER_ERRORS;
    other / (other + noise * noise)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    const CAMERA: Intrinsics = Intrinsics { fx: 150.0, fy: 140.0, cx: 79.5, cy: 59.5, width: 160, height: 120 };

    /// Depth of a plane: `normal · point = distance`, in the camera's coordinates.
    fn tilted(normal: Vec3, distance: f32) -> Image<f32> {
        Image::from_fn(160, 120, |column, row| {
            let ray = Vec3::new((column as f32 - CAMERA.cx) / CAMERA.fx, (row as f32 - CAMERA.cy) / CAMERA.fy, 1.0);
            distance / normal.dot(ray)
        })
    }

    #[test]
    fn a_plane_is_found_with_its_depth_between_pixels() {
        let normal = Vec3::new(0.3, -0.4, 1.0).normalize();
        let planes = depth_planes(&tilted(normal, 2.0), &CAMERA);
        for (column, row) in [(0, 0), (80, 60), (159, 119), (20, 100)] {
            let plane = planes[(column, row)];
            let offset = Vec2::new(0.4, -0.3);
            let place = Vec2::new(column as f32, row as f32) + offset;
            let ray = Vec3::new((place.x - CAMERA.cx) / CAMERA.fx, (place.y - CAMERA.cy) / CAMERA.fy, 1.0);
            let expected = normal.dot(ray) / 2.0;
            assert!((plane.inverse_at(offset) / expected - 1.0).abs() < 1e-4, "{column}, {row}");
            let ray = Vec3::new((column as f32 - CAMERA.cx) / CAMERA.fx, (row as f32 - CAMERA.cy) / CAMERA.fy, 1.0);
            assert!((plane.distance_per_depth / normal.dot(ray) - 1.0).abs() < 1e-3);
            assert!((plane.cosine / normal.dot(ray.normalize()) - 1.0).abs() < 1e-3);
        }
    }

    #[test]
    fn edges_count_less_and_lone_pixels_nothing() {
        let mut depth = Image::filled(160, 120, 2.0f32);
        (0..120).for_each(|row| (80..160).for_each(|column| depth.pixels_mut()[row * 160 + column] = 3.0));
        depth.pixels_mut()[30 * 160 + 30] = 0.8;
        let planes = depth_planes(&depth, &CAMERA);
        let at = |column, row| planes[(column, row)];
        assert!(at(79, 60).weight < 0.4 * at(77, 60).weight && at(80, 60).weight < 0.4 * at(83, 60).weight);
        assert_eq!((at(30, 30).weight, at(80, 60).nearest, at(81, 60).nearest), (0.0, 2.0, 3.0));
        assert!(at(40, 60).weight > 1.8 * at(140, 60).weight, "far measurements count less");
    }
}
