//! The plane that a segment without depth is taken to lie on, from the depths around it.
//!
//! A plane is kept as the vector `n` with `n · X = 1` for its points `X`, camera coordinates. The inverse z-depth that it
//! has along a ray `(x, y, 1)` is `n · (x, y, 1)`: linear, so that fitting is least squares in three unknowns. `n = 0` is
//! the plane at infinity, seen the same from everywhere.

use super::region::Region;
use glam::{Vec2, Vec3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use splatseg_geometry::{CowImage, RgbdFrame, SegmentMap};

/// How far from a region depth is looked for, pixels: around screens and glass there is often none for a while.
const REACH: usize = 12;
/// Border points that are looked at, at most.
const MAX_POINTS: usize = 192;
/// A plane is fitted to no fewer points.
const MIN_FIT_POINTS: usize = 12;
/// A median depth is taken of no fewer points.
const MIN_MEDIAN_POINTS: usize = 4;
/// Planes through three points that are tried.
const TRIALS: usize = 32;
/// A point is on a plane if their inverse depths differ by no more than this fraction.
const TOLERANCE: f32 = 0.02;
/// A fit is good if this share of the points is on it...
const MIN_SHARE: f32 = 0.5;
/// ...and if, all over the region, it is at most so many times nearer or farther than those points.
const MAX_EXTRAPOLATION: f32 = 2.0;
/// Points are in one line if the smaller of their two spreads is below this share of the mean one.
const MIN_ROUNDNESS: f32 = 1e-3;

/// What a plane rests on; better ones are greater.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub(super) enum Support {
    /// No depth near: infinitely far.
    None,
    /// The median depth around, parallel to the image.
    Median,
    /// A plane fitted to the depths around.
    Fit,
}

/// A plane in a camera's frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Plane {
    /// `n`, 1 / metres: the points `X` of the plane have `n · X = 1`.
    pub inverse: Vec3,
    pub support: Support,
}

/// A pixel with depth at the border of a region.
#[derive(Clone, Copy, Debug)]
struct BorderPoint {
    /// Where its ray meets z = 1, camera coordinates.
    ray: Vec2,
    /// 1 / z-depth, 1 / metres.
    inverse_depth: f32,
    /// Whether it has the segment's own id.
    is_own: bool,
}

impl Plane {
    /// What lies infinitely far away.
    const FAR: Self = Self { inverse: Vec3::ZERO, support: Support::None };

    /// The plane of `region`. Depths of the segment's own id come first: a screen is where its frame is and not where
    /// the wall behind it is.
    pub fn behind(region: &Region, frame: &RgbdFrame, seen: &SegmentMap) -> Self {
        let all = border_points(region, frame, seen);
        let own: Vec<BorderPoint> = all.iter().copied().filter(|point| point.is_own).collect();
        let corners = region.corners().map(|pixel| ray(frame, pixel));
        let seed = u64::from(region.id);
        if let Some(inverse) = [&own, &all].into_iter().find_map(|points| fitted(points, corners, seed)) {
            return Self { inverse, support: Support::Fit };
        }
        let points = if own.len() >= MIN_FIT_POINTS { own } else { all };
        if points.len() < MIN_MEDIAN_POINTS {
            return Self::FAR;
        }
        let mut depths: Vec<f32> = points.iter().map(|point| point.inverse_depth).collect();
        let middle = depths.len() / 2;
        let (_, median, _) = depths.select_nth_unstable_by(middle, f32::total_cmp);
        Self { inverse: Vec3::new(0.0, 0.0, *median), support: Support::Median }
    }
}

/// Where the ray of a pixel (column, row) meets z = 1.
fn ray(frame: &RgbdFrame, pixel: Vec2) -> Vec2 {
    frame.intrinsics().unproject(pixel, 1.0).truncate()
}

/// Walks out of the region, along rows and columns, to the nearest depths.
fn border_points(region: &Region, frame: &RgbdFrame, seen: &SegmentMap) -> Vec<BorderPoint> {
    let starts = region.border_steps();
    let every = starts.len().div_ceil(MAX_POINTS).max(1);
    let walked = starts.into_iter().step_by(every).filter_map(|(from, step)| first_surface(frame.depth(), from, step));
    walked
        .map(|at| BorderPoint {
            ray: ray(frame, Vec2::new(at.0 as f32, at.1 as f32)),
            inverse_depth: 1.0 / frame.depth()[at],
            is_own: seen[at] == region.id,
        })
        .collect()
}

/// The second pixel with depth on the way from `from`: the first may be a mixture.
fn first_surface(depth: &CowImage<'_, f32>, from: (usize, usize), step: (isize, isize)) -> Option<(usize, usize)> {
    let (width, height) = depth.size();
    let mut at = from;
    let mut found = None;
    for _ in 0..REACH {
        let Some(next) = at.0.checked_add_signed(step.0).zip(at.1.checked_add_signed(step.1)) else { break };
        if next.0 >= width || next.1 >= height {
            break;
        }
        at = next;
        if depth[at] > 0.0 {
            if found.is_some() {
                return Some(at);
            }
            found = Some(at);
        }
    }
    found
}

/// The plane `n` with the most points on it; `None` if too few points are on it. The same numbers for the same `seed`.
fn fitted(points: &[BorderPoint], corners: [Vec2; 4], seed: u64) -> Option<Vec3> {
    if points.len() < MIN_FIT_POINTS {
        return None;
    }
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut best = (0, Vec3::ZERO);
    for _ in 0..TRIALS {
        let three: [BorderPoint; 3] = std::array::from_fn(|_| points[random.random_range(0..points.len())]);
        if let Some(plane) = least_squares(&three) {
            let count = points.iter().filter(|point| is_on(plane, point)).count();
            if count > best.0 {
                best = (count, plane);
            }
        }
    }
    // The second time with the points of a plane that is no longer that of three.
    for _ in 0..2 {
        let on: Vec<BorderPoint> = points.iter().copied().filter(|point| is_on(best.1, point)).collect();
        best = (on.len(), least_squares(&on)?);
    }
    let (count, plane) = best;
    let is_shared = count >= MIN_FIT_POINTS && count as f32 >= MIN_SHARE * points.len() as f32;
    (is_shared && is_near_all_over(plane, points, corners)).then_some(plane)
}

fn is_on(plane: Vec3, point: &BorderPoint) -> bool {
    (plane.dot(point.ray.extend(1.0)) - point.inverse_depth).abs() <= TOLERANCE * point.inverse_depth
}

/// Whether the plane is about as far away as its points wherever it is needed.
fn is_near_all_over(plane: Vec3, points: &[BorderPoint], corners: [Vec2; 4]) -> bool {
    let on = || points.iter().filter(|point| is_on(plane, point)).map(|point| point.inverse_depth);
    let (farthest, nearest) = (on().fold(f32::INFINITY, f32::min), on().fold(0.0, f32::max));
    let (least, most) = (farthest / MAX_EXTRAPOLATION, nearest * MAX_EXTRAPOLATION);
    corners.iter().all(|corner| (least..=most).contains(&plane.dot(corner.extend(1.0))))
}

/// The `n` with the least squared error of inverse depth; `None` if the points are in one line.
fn least_squares(points: &[BorderPoint]) -> Option<Vec3> {
    let count = points.len() as f32;
    let mean = points.iter().fold(Vec3::ZERO, |sum, point| sum + point.ray.extend(point.inverse_depth)) / count;
    let (mut xx, mut xy, mut yy, mut xq, mut yq) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for point in points {
        let from_mean = point.ray.extend(point.inverse_depth) - mean;
        let Vec3 { x, y, z: q } = from_mean;
        (xx, xy, yy) = (xx + x * x, xy + x * y, yy + y * y);
        (xq, yq) = (xq + x * q, yq + y * q);
    }
    let determinant: f32 = xx * yy - xy * xy;
    let half = 0.5 * (xx + yy);
    let is_spread = determinant > MIN_ROUNDNESS * half * half;
    if !is_spread {
        return None;
    }
    let (a, b) = ((xq * yy - yq * xy) / determinant, (yq * xx - xq * xy) / determinant);
    let plane = Vec3::new(a, b, mean.z - a * mean.x - b * mean.y);
    plane.is_finite().then_some(plane)
}

#[cfg(test)]
mod tests {
    use super::*;

    const CORNERS: [Vec2; 4] = [Vec2::new(-0.5, -0.5), Vec2::new(0.5, -0.5), Vec2::new(-0.5, 0.5), Vec2::new(0.5, 0.5)];

    fn point(ray: Vec2, inverse_depth: f32) -> BorderPoint {
        BorderPoint { ray, inverse_depth, is_own: false }
    }

    /// Points around a square, on `plane` but for every `stride`-th, which is far nearer.
    fn around(plane: Vec3, stride: usize) -> Vec<BorderPoint> {
        (0..80)
            .map(|place| {
                let angle = place as f32 / 80.0 * std::f32::consts::TAU;
                let ray = Vec2::from_angle(angle) * 0.55;
                let inverse_depth = if place % stride == 0 { 1.3 } else { plane.dot(ray.extend(1.0)) };
                point(ray, inverse_depth)
            })
            .collect()
    }

    #[test]
    fn a_plane_is_found_among_points_of_other_surfaces() {
        let plane = Vec3::new(0.1, -0.15, 0.5);
        for stride in [3, 7, 1000] {
            let found = fitted(&around(plane, stride), CORNERS, 0).unwrap();
            assert!((found - plane).length() < 1e-4, "every {stride}th is off: {found}");
        }
    }

    #[test]
    fn points_that_say_little_of_the_plane_give_none() {
        let line: Vec<BorderPoint> = (0..40).map(|x| point(Vec2::new(x as f32 * 0.01, 0.3), 0.5)).collect();
        assert_eq!(fitted(&line, CORNERS, 0), None);
        let few = around(Vec3::new(0.0, 0.0, 0.5), 1000);
        assert_eq!(fitted(&few[..MIN_FIT_POINTS - 1], CORNERS, 0), None);
        let scattered: Vec<BorderPoint> = around(Vec3::Z, 1000)
            .into_iter()
            .enumerate()
            .map(|(place, at)| BorderPoint { inverse_depth: 0.2 + 0.07 * (place * 7 % 11) as f32, ..at })
            .collect();
        assert_eq!(fitted(&scattered, CORNERS, 0), None);
        assert_eq!(fitted(&[], CORNERS, 0), None);
    }

    #[test]
    fn a_plane_that_runs_away_over_the_region_is_none() {
        let plane = Vec3::new(0.9, 0.0, 0.3);
        let near: Vec<BorderPoint> = around(plane, 1000).into_iter().filter(|point| point.ray.x > 0.3).collect();
        assert!(near.len() > MIN_FIT_POINTS);
        assert_eq!(fitted(&near, CORNERS, 0), None);
    }
}
