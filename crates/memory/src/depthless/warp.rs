//! A remembered region as another camera sees it.
//!
//! With `X' = R X + t` from the remembered camera to the new one, points of the plane `n · X = 1` have
//! `X' = (R + t nᵀ) X`. That matrix alone takes rays of one camera to rays of the other: a homography. Its determinant
//! is the new camera's distance to the plane, as a multiple of the old one's; negative behind the plane.

use super::plane::Plane;
use super::region::Region;
use glam::{Mat3, Vec3};
use splatseg_geometry::{Intrinsics, Pose};
use std::ops::Range;

/// A camera that is nearer to the plane than this fraction of the first one's distance does not see it.
const MIN_DISTANCE_RATIO: f32 = 0.02;
/// Pixels of a region that are looked at, about, to tell how much of it lies in the image.
const SAMPLES: usize = 256;

/// A camera and where it stands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Viewpoint {
    pub intrinsics: Intrinsics,
    pub world_from_camera: Pose,
}

/// Where a remembered region should be seen, whatever else is seen there.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Warp {
    /// Row-major pixels of the image: runs within rows, increasing.
    pub runs: Vec<Range<usize>>,
    /// Pixels in all runs.
    pub area: usize,
    /// Share of the region that lies within the image, in [0, 1].
    pub share_in_view: f32,
    /// The plane in the new camera's frame, as [`Plane::inverse`]; 1 / metres.
    pub inverse: Vec3,
    /// Its product with (column, row, 1) is the plane's inverse z-depth at a pixel of the new image, 1 / metres; 0 for
    /// what is infinitely far.
    pub inverse_of_pixel: Vec3,
}

impl Warp {
    /// The region, seen by `from` and lying on `plane`, as `to` sees it; `None` if that is not at all.
    pub fn new(region: &Region, plane: &Plane, from: &Viewpoint, to: &Viewpoint) -> Option<Self> {
        let to_rotation = to.world_from_camera.rotation().transpose();
        let rotation = to_rotation * from.world_from_camera.rotation();
        let shift = to_rotation * (from.world_from_camera.translation() - to.world_from_camera.translation());
        let normal = plane.inverse;
        let motion = Mat3::from_cols(
            rotation.x_axis + shift * normal.x,
            rotation.y_axis + shift * normal.y,
            rotation.z_axis + shift * normal.z,
        );
        let determinant = motion.determinant();
        if !(determinant > MIN_DISTANCE_RATIO && determinant.is_finite()) {
            return None;
        }
        let (from_pixel, to_pixel) = (matrix(&from.intrinsics), matrix(&to.intrinsics));
        let forward = to_pixel * motion * from_pixel.inverse();
        let (columns, rows) = bounds(region, &forward, &to.intrinsics)?;
        let back = from_pixel * motion.inverse() * to_pixel.inverse();
        let inverse = rotation * normal / determinant;
        let mut warp = Self {
            share_in_view: share_in_view(region, &forward, &to.intrinsics),
            inverse,
            inverse_of_pixel: to_pixel.inverse().transpose() * inverse,
            ..Self::default()
        };
        warp.find_runs(region, &back, (columns, rows), to.intrinsics.width);
        (warp.area > 0).then_some(warp)
    }

    /// The number of its pixels for which `holds`; `image` is row-major.
    pub fn count<T: Copy>(&self, image: &[T], holds: impl Fn(T) -> bool) -> usize {
        self.runs.iter().map(|run| image[run.clone()].iter().filter(|pixel| holds(**pixel)).count()).sum()
    }

    /// Looks up every pixel of a box: `back` takes pixels of the new image, `width` wide, to those of the old one.
    fn find_runs(&mut self, region: &Region, back: &Mat3, (columns, rows): (Range<usize>, Range<usize>), width: usize) {
        for row in rows {
            // Both are linear along a row.
            let first = Vec3::new(0.0, row as f32, 1.0);
            let (at_first, inverse_first) = (*back * first, self.inverse_of_pixel.dot(first));
            let is_inside = |column: usize| {
                let at = at_first + back.x_axis * column as f32;
                let is_before = at.z > 0.0 && inverse_first + self.inverse_of_pixel.x * column as f32 >= 0.0;
                let scale = 1.0 / at.z;
                is_before && region.contains(at.x * scale, at.y * scale)
            };
            let mut from = None;
            let mut runs = Vec::new();
            for column in columns.clone() {
                match (is_inside(column), from) {
                    (true, None) => from = Some(column),
                    (false, Some(first)) => {
                        runs.push(first..column);
                        from = None;
                    }
                    _ => {}
                }
            }
            runs.extend(from.map(|first| first..columns.end));
            self.area += runs.iter().map(Range::len).sum::<usize>();
            self.runs.extend(runs.into_iter().map(|run| row * width + run.start..row * width + run.end));
        }
    }
}

/// Takes rays to homogeneous pixels.
fn matrix(camera: &Intrinsics) -> Mat3 {
    let Intrinsics { fx, fy, cx, cy, .. } = *camera;
    Mat3::from_cols(Vec3::new(fx, 0.0, 0.0), Vec3::new(0.0, fy, 0.0), Vec3::new(cx, cy, 1.0))
}

/// Columns and rows of the new image that may show the region; `None` if none does.
fn bounds(region: &Region, forward: &Mat3, camera: &Intrinsics) -> Option<(Range<usize>, Range<usize>)> {
    let (all_columns, all_rows) = (0..camera.width, 0..camera.height);
    let corners = region.corners().map(|corner| *forward * corner.extend(1.0));
    if corners.iter().all(|corner| corner.z <= 0.0) {
        return None;
    }
    if corners.iter().any(|corner| corner.z < 1e-3) {
        return Some((all_columns, all_rows));
    }
    let range = |along: fn(Vec3) -> f32, size: usize| {
        let places = corners.map(|corner| along(corner) / corner.z);
        let first = places.iter().copied().fold(f32::INFINITY, f32::min).floor().max(0.0) as usize;
        let end = (places.iter().copied().fold(f32::NEG_INFINITY, f32::max).ceil().max(-1.0) + 1.0) as usize;
        (first < end.min(size)).then(|| first..end.min(size))
    };
    Some((range(|corner| corner.x, camera.width)?, range(|corner| corner.y, camera.height)?))
}

fn share_in_view(region: &Region, forward: &Mat3, camera: &Intrinsics) -> f32 {
    let (mut inside, mut all) = (0u32, 0u32);
    let (right, bottom) = (camera.width as f32 - 0.5, camera.height as f32 - 0.5);
    for (column, row) in region.pixels().step_by(region.area.div_ceil(SAMPLES).max(1)) {
        let at = *forward * Vec3::new(column as f32, row as f32, 1.0);
        let (x, y) = (at.x / at.z, at.y / at.z);
        all += 1;
        inside += u32::from(at.z > 0.0 && x >= -0.5 && y >= -0.5 && x < right && y < bottom);
    }
    if all == 0 { 0.0 } else { inside as f32 / all as f32 }
}
