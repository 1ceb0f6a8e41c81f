//! A remembered region as another camera sees it.
//!
//! With `X' = R X + t` from the remembered camera to the new one, points of the plane `n · X = 1` have
//! `X' = (R + t nᵀ) X`. That matrix alone takes rays of one camera to rays of the other: a homography. Its determinant
//! is the new camera's distance to the plane, as a multiple of the old one's; negative behind the plane.

use super::plane::Plane;
use super::region::Region;
use glam::{Mat3, Vec3};
use splatseg_geometry::{Intrinsics, LocalPose};
use std::ops::Range;

/// A camera that is nearer to the plane than this fraction of the first one's distance does not see it.
const MIN_DISTANCE_RATIO: f32 = 0.02;
/// Pixels of a region that are looked at, about, to tell how much of it lies in the image.
const SAMPLES: usize = 256;

/// A camera and where it stands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Viewpoint {
    pub intrinsics: Intrinsics,
    pub map_from_camera: LocalPose,
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
        let to_rotation = to.map_from_camera.rotation().transpose();
        let rotation = to_rotation * from.map_from_camera.rotation();
        let shift = to_rotation * (from.map_from_camera.translation() - to.map_from_camera.translation());
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

#[cfg(test)]
mod tests {
    use super::super::plane::Support;
    use super::*;
    use glam::{DVec2, DVec3, EulerRot, Mat4, Quat, Vec2};
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use splatseg_geometry::{Pose, SegmentMap};

    const OLD: Intrinsics = Intrinsics { fx: 50.0, fy: 55.0, cx: 30.0, cy: 21.0, width: 64, height: 48 };
    const NEW: Intrinsics = Intrinsics { fx: 70.0, fy: 65.0, cx: 42.0, cy: 25.0, width: 80, height: 56 };

    fn viewpoint(intrinsics: Intrinsics, position: Vec3, angles: Vec3) -> Viewpoint {
        let rotation = Quat::from_euler(EulerRot::YXZ, angles.x, angles.y, angles.z);
        let pose = Pose::from_matrix(Mat4::from_rotation_translation(rotation, position).as_dmat4())
            .unwrap()
            .relative_to(DVec3::ZERO);
        Viewpoint { intrinsics, map_from_camera: pose }
    }

    fn plane(inverse: Vec3) -> Plane {
        Plane { inverse, support: Support::Fit }
    }

    fn region(is_inside: impl Fn(usize, usize) -> bool) -> Region {
        let map = SegmentMap::from_fn(OLD.width, OLD.height, |column, row| u32::from(is_inside(column, row)));
        Region::of_maps(&map, &map, 1).remove(0)
    }

    /// Two bars and a hole, so that no two sides are alike.
    fn odd_region() -> Region {
        region(|column, row| {
            let is_bar = (12..20).contains(&column) || (22..50).contains(&column) && row < 30;
            is_bar && (6..40).contains(&row) && !((30..36).contains(&column) && (12..18).contains(&row))
        })
    }

    /// Ray casting: where the pixel of the new camera lies in the old image, if the plane is before both cameras, and its
    /// inverse z-depth in the new one.
    fn traced(at: DVec2, plane: &Plane, from: &Viewpoint, to: &Viewpoint) -> (Option<DVec2>, f64) {
        let rotations = [from, to].map(|camera| camera.map_from_camera.rotation().as_dmat3());
        let positions = [from, to].map(|camera| camera.map_from_camera.translation().as_dvec3());
        let (one, other) = (&to.intrinsics, &from.intrinsics);
        let ray = DVec3::new(
            (at.x - f64::from(one.cx)) / f64::from(one.fx),
            (at.y - f64::from(one.cy)) / f64::from(one.fy),
            1.0,
        );
        // The plane in world coordinates: normal · X = offset.
        let normal = rotations[0] * plane.inverse.as_dvec3();
        let offset = 1.0 + normal.dot(positions[0]);
        let inverse_depth = normal.dot(rotations[1] * ray) / (offset - normal.dot(positions[1]));
        // The point, divided by its depth: a direction if that is infinite.
        let point = rotations[0].transpose() * (rotations[1] * ray + inverse_depth * (positions[1] - positions[0]));
        let is_before = inverse_depth >= 0.0 && point.z > 0.0;
        let column = f64::from(other.fx) * point.x / point.z + f64::from(other.cx);
        let row = f64::from(other.fy) * point.y / point.z + f64::from(other.cy);
        (is_before.then_some(DVec2::new(column, row)), inverse_depth)
    }

    /// Compares a warp with ray casting; returns its pixels.
    fn check(region: &Region, plane: &Plane, from: &Viewpoint, to: &Viewpoint) -> usize {
        let warp = Warp::new(region, plane, from, to);
        let shift = to.map_from_camera.translation() - from.map_from_camera.translation();
        if 1.0 - (from.map_from_camera.rotation() * plane.inverse).dot(shift) <= MIN_DISTANCE_RATIO {
            assert!(warp.is_none(), "the plane is not before the new camera");
            return 0;
        }
        let (width, height) = (to.intrinsics.width, to.intrinsics.height);
        let mut found = vec![false; width * height];
        let runs = warp.as_ref().map_or(&[][..], |warp| &warp.runs);
        for run in runs {
            assert!(!run.is_empty() && run.start / width == (run.end - 1) / width, "{run:?} is a run of one row");
            found[run.clone()].fill(true);
        }
        assert!(runs.is_sorted_by_key(|run| run.start));
        let area = found.iter().filter(|is_inside| **is_inside).count();
        for (index, found) in found.iter().enumerate() {
            let at = DVec2::new((index % width) as f64, (index / width) as f64);
            let (place, inverse_depth) = traced(at, plane, from, to);
            if let Some(warp) = &warp {
                let linear = warp.inverse_of_pixel.dot(at.as_vec2().extend(1.0));
                assert!((f64::from(linear) - inverse_depth).abs() < 1e-4 * (1.0 + inverse_depth.abs()), "at {at}");
            }
            let is_close = |place: DVec2| (place + 0.5 - (place + 0.5).round()).abs().min_element() < 1e-3;
            if inverse_depth.abs() < 1e-4 && plane.inverse != Vec3::ZERO || place.is_some_and(is_close) {
                continue;
            }
            let expected = place.is_some_and(|place| region.contains(place.x as f32, place.y as f32));
            assert_eq!(*found, expected, "at {at}");
        }
        if let Some(warp) = &warp {
            assert_eq!(warp.area, area);
            let ray =
                |(column, row): (usize, usize)| from.intrinsics.unproject(Vec2::new(column as f32, row as f32), 1.0);
            if region.pixels().any(|pixel| plane.inverse.dot(ray(pixel)) < 0.0) {
                // Beyond the plane's horizon nothing can be said.
                return area;
            }
            let inside: Vec<bool> = region
                .pixels()
                .step_by(region.area.div_ceil(SAMPLES))
                .map(|(column, row)| {
                    let pixel = Vec2::new(column as f32, row as f32).as_dvec2();
                    let (place, _) = traced_forward(pixel, plane, from, to);
                    place.is_some_and(|place| {
                        place.cmpge(DVec2::splat(-0.5)).all()
                            && place.x < width as f64 - 0.5
                            && place.y < height as f64 - 0.5
                    })
                })
                .collect();
            let share = inside.iter().filter(|inside| **inside).count() as f32 / inside.len() as f32;
            assert!((warp.share_in_view - share).abs() < 0.02, "{} instead of {share}", warp.share_in_view);
        }
        area
    }

    /// The same the other way: where a pixel of the old camera lies in the new image.
    fn traced_forward(at: DVec2, plane: &Plane, from: &Viewpoint, to: &Viewpoint) -> (Option<DVec2>, f64) {
        // The plane as the new camera has it.
        let rotations = [from, to].map(|camera| camera.map_from_camera.rotation().as_dmat3());
        let shift = (to.map_from_camera.translation() - from.map_from_camera.translation()).as_dvec3();
        let normal = rotations[0] * plane.inverse.as_dvec3();
        let inverse = rotations[1].transpose() * normal / (1.0 - normal.dot(shift));
        traced(at, &super::tests::plane(inverse.as_vec3()), to, from)
    }

    #[test]
    fn it_is_where_ray_casting_finds_it() {
        let region = odd_region();
        let mut random = ChaCha8Rng::seed_from_u64(3);
        let mut random = |most: f32| Vec3::from_array(std::array::from_fn(|_| random.random_range(-most..most)));
        let mut seen = 0;
        for trial in 0..200 {
            let from = viewpoint(OLD, random(2.0), random(1.0));
            let forward = from.map_from_camera.rotation().z_axis;
            let moved = from.map_from_camera.translation() + random(0.4) + 0.4 * random(1.0).x * forward;
            let rotation = random(0.3);
            let turned = Mat4::from_mat3(from.map_from_camera.rotation())
                * Mat4::from_euler(EulerRot::YXZ, rotation.x, rotation.y, rotation.z);
            let pose = Pose::from_matrix((Mat4::from_translation(moved) * turned).as_dmat4())
                .unwrap()
                .relative_to(DVec3::ZERO);
            let to = Viewpoint { intrinsics: NEW, map_from_camera: pose };
            // Infinitely far, before the camera, and so steep that it ends within the image.
            let inverse = match trial % 5 {
                0 => Vec3::ZERO,
                1 => random(1.5) + Vec3::Z * 0.3,
                _ => random(0.2) + Vec3::Z * 0.5,
            };
            seen += usize::from(check(&region, &plane(inverse), &from, &to) > 200);
        }
        assert!(seen > 120, "{seen} of 200 show the region");
    }

    #[test]
    fn the_same_camera_sees_the_same_pixels() {
        let region = odd_region();
        let camera = viewpoint(OLD, Vec3::new(1.0, 2.0, 3.0), Vec3::new(0.3, 0.2, 0.1));
        for inverse in [Vec3::ZERO, Vec3::new(0.05, -0.1, 0.5)] {
            let warp = Warp::new(&region, &plane(inverse), &camera, &camera).unwrap();
            let pixels: Vec<usize> = warp.runs.iter().cloned().flatten().collect();
            assert_eq!(pixels, region.pixels().map(|(column, row)| row * OLD.width + column).collect::<Vec<_>>());
            assert_eq!((warp.area, warp.share_in_view), (region.area, 1.0));
            assert!((warp.inverse - inverse).length() < 1e-5);
            let upper = |index: usize| index < 20 * OLD.width;
            let image: Vec<usize> = (0..OLD.width * OLD.height).collect();
            assert_eq!(warp.count(&image, upper), pixels.iter().filter(|index| upper(**index)).count());
        }
    }

    #[test]
    fn what_lies_behind_the_camera_or_aside_is_not_seen() {
        let region = odd_region();
        let from = viewpoint(OLD, Vec3::ZERO, Vec3::ZERO);
        // 2 m ahead.
        let plane = plane(Vec3::new(0.0, 0.0, 0.5));
        let seen_from = |position, angles| Warp::new(&region, &plane, &from, &viewpoint(OLD, position, angles));
        assert!(seen_from(Vec3::ZERO, Vec3::ZERO).is_some());
        assert!(seen_from(Vec3::Z * 1.9, Vec3::ZERO).is_some());
        assert!(seen_from(Vec3::Z * 1.98, Vec3::ZERO).is_none(), "nearer than a fiftieth");
        assert!(seen_from(Vec3::Z * 2.5, Vec3::ZERO).is_none());
        for turned in [Vec3::X * 3.1, Vec3::X * 1.6, Vec3::X * -1.6, Vec3::Y * 1.6, Vec3::Y * -1.6] {
            assert!(seen_from(Vec3::ZERO, turned).is_none(), "{turned}");
        }
        for aside in [Vec3::X * 4.0, Vec3::X * -4.0, Vec3::Y * 4.0, Vec3::Y * -4.0] {
            assert!(seen_from(aside, Vec3::ZERO).is_none(), "{aside}");
        }
    }
}
