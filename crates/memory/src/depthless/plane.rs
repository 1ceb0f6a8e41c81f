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
    use splatseg_geometry::{Image, Intrinsics, Pose, SegmentId};

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
        let spread: Vec<BorderPoint> = few.into_iter().skip(1).step_by(6).collect();
        assert!(fitted(&spread[..MIN_FIT_POINTS], CORNERS, 0).is_some());
        assert_eq!(fitted(&spread[..MIN_FIT_POINTS - 1], CORNERS, 0), None);
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

    #[test]
    fn a_plane_needs_half_of_the_points() {
        let plane = Vec3::new(0.1, -0.15, 0.5);
        let is_found = |off: usize| {
            let mut points = around(plane, 1000);
            points[0].inverse_depth = plane.dot(points[0].ray.extend(1.0));
            // Every third place comes once round 80: those off are spread all over, and on no plane together.
            for place in 0..off {
                points[place * 3 % 80].inverse_depth = 1.0 + 0.06 * (place * 17 % 41) as f32;
            }
            fitted(&points, CORNERS, 0).is_some()
        };
        assert!(is_found(40) && !is_found(41));
    }

    #[test]
    fn points_are_on_a_plane_within_a_fiftieth_of_their_inverse_depth() {
        let plane = Vec3::new(0.1, -0.2, 0.5);
        let ray = Vec2::new(0.4, 0.3);
        let exact = plane.dot(ray.extend(1.0));
        let near = [0.981, 1.0, 1.019].map(|factor| is_on(plane, &point(ray, exact * factor)));
        let off = [0.979, 1.021].map(|factor| is_on(plane, &point(ray, exact * factor)));
        assert_eq!((near, off), ([true; 3], [false; 2]));
    }

    #[test]
    fn a_plane_holds_where_it_is_at_most_twice_as_near_or_far_as_its_points() {
        // Inverse depths of 0.5 to 0.7.
        let plane = Vec3::new(1.0, 0.0, 0.5);
        let places = (0..25).map(|place| Vec2::new((place % 5) as f32, (place / 5) as f32) * 0.05);
        let points: Vec<BorderPoint> = places.map(|ray| point(ray, plane.dot(ray.extend(1.0)))).collect();
        let holds_at = |x: f32| fitted(&points, [Vec2::ZERO, Vec2::ZERO, Vec2::ZERO, Vec2::new(x, 0.3)], 0).is_some();
        assert_eq!([-0.26, -0.24, 0.89, 0.91].map(holds_at), [false, true, true, false]);
    }

    #[test]
    fn points_nearly_in_one_line_give_no_plane() {
        let spread = |flatness: f32, turned: f32| {
            let ray = |place: usize| Vec2::new(place as f32 - 10.0, (place % 3) as f32 * 7.0 * flatness) * 0.03;
            let points: Vec<BorderPoint> =
                (0..21).map(|place| point(Vec2::from_angle(turned).rotate(ray(place)) + 0.1, 0.5)).collect();
            least_squares(&points).is_some()
        };
        for turned in [0.0, 0.5, 1.5] {
            assert!(spread(0.03, turned) && !spread(0.01, turned), "turned by {turned}");
        }
    }

    #[test]
    fn the_plane_is_that_with_the_least_squared_error() {
        let noisy = |place: usize| {
            let ray = Vec2::new((place % 5) as f32, (place / 5) as f32) * 0.1 - 0.15;
            point(ray, 0.5 + 0.2 * ray.x - 0.1 * ray.y + 0.01 * (place * 7 % 5) as f32)
        };
        let points: Vec<BorderPoint> = (0..25).map(noisy).collect();
        let error = |plane: Vec3| -> f32 {
            points.iter().map(|point| (plane.dot(point.ray.extend(1.0)) - point.inverse_depth).powi(2)).sum()
        };
        let found = least_squares(&points).unwrap();
        for by in [Vec3::X, Vec3::Y, Vec3::Z].into_iter().flat_map(|axis| [axis * 0.01, axis * -0.01]) {
            assert!(error(found + by) > error(found) + 1e-6, "{by}");
        }
    }

    #[test]
    fn the_second_depth_within_reach_is_taken() {
        let row =
            |with_depth: &[usize]| Image::from_fn(30, 1, |column, _| f32::from(u8::from(with_depth.contains(&column))));
        let rightwards = |with_depth: &[usize]| first_surface(&row(with_depth), (0, 0), (1, 0));
        assert_eq!(rightwards(&[3, 5, 6]), Some((5, 0)));
        assert_eq!(
            rightwards(&[0, 3]),
            Some((3, 0)),
            "the first pixel is not looked at, and a single one is better than none"
        );
        assert_eq!(rightwards(&[1, REACH]), Some((REACH, 0)));
        assert_eq!(rightwards(&[1, REACH + 1]), Some((1, 0)));
        assert_eq!(rightwards(&[REACH + 1]), None);
        assert_eq!(first_surface(&row(&[28, 29]), (25, 0), (1, 0)), Some((29, 0)));
        assert_eq!(first_surface(&row(&[29]), (25, 0), (1, 0)), Some((29, 0)));
        assert_eq!(first_surface(&row(&[0, 1]), (4, 0), (-1, 0)), Some((0, 0)));
        assert_eq!(first_surface(&row(&[0]), (4, 0), (-1, 0)), Some((0, 0)));
        let column = Image::from_fn(1, 30, |_, row| f32::from(u8::from([4, 6, 10, 12].contains(&row))));
        assert_eq!(first_surface(&column, (0, 8), (0, 1)), Some((0, 12)));
        assert_eq!(first_surface(&column, (0, 8), (0, -1)), Some((0, 4)));
        assert_eq!(first_surface(&column, (0, 13), (0, 1)), None);
    }

    const CAMERA: Intrinsics = Intrinsics { fx: 50.0, fy: 60.0, cx: 20.0, cy: 15.0, width: 40, height: 30 };

    /// The plane behind the pixels from (16, 12) to (23, 17), which are of segment 1 and have no depth; all others have
    /// that of `depth` and the id of `seen`.
    fn behind(depth: impl Fn(usize, usize) -> f32, seen: impl Fn(usize, usize) -> SegmentId) -> Plane {
        let is_inside = |column: usize, row: usize| (16..24).contains(&column) && (12..18).contains(&row);
        let seen =
            SegmentMap::from_fn(40, 30, |column, row| if is_inside(column, row) { 1 } else { seen(column, row) });
        let depth = Image::from_fn(40, 30, |column, row| if is_inside(column, row) { 0.0 } else { depth(column, row) });
        let own = SegmentMap::from_fn(40, 30, |column, row| u32::from(is_inside(column, row)));
        let region = Region::of_maps(&own, &own, 1).remove(0);
        let frame = RgbdFrame::new("0", Image::filled(40, 30, [0; 3]), depth, CAMERA, Pose::IDENTITY).unwrap();
        Plane::behind(&region, &frame, &seen)
    }

    fn depth_of(plane: Vec3, column: usize, row: usize) -> f32 {
        1.0 / plane.dot(CAMERA.unproject(Vec2::new(column as f32, row as f32), 1.0))
    }

    #[test]
    fn the_own_depths_of_a_segment_come_first() {
        let (screen, wall) = (Vec3::new(0.1, -0.1, 0.5), Vec3::new(0.0, 0.1, 0.3));
        let is_frame = |column: usize, row: usize| (13..27).contains(&column) && (9..21).contains(&row);
        let depth = |column, row| depth_of(if is_frame(column, row) { screen } else { wall }, column, row);
        let with_frame = behind(depth, |column, row| if is_frame(column, row) { 1 } else { 2 });
        assert!((with_frame.inverse - screen).length() < 1e-3, "{with_frame:?}");
        let without = behind(|column, row| depth_of(wall, column, row), |_, _| 2);
        assert!((without.inverse - wall).length() < 1e-3, "{without:?}");
        assert_eq!((with_frame.support, without.support), (Support::Fit, Support::Fit));
    }

    #[test]
    fn depths_on_no_plane_give_their_median() {
        let depth = |column: usize, row: usize| {
            let is_aside = (12..18).contains(&row);
            1.0 + 0.3 * ((column * 7 + row * 13) % 11) as f32 + if is_aside { 1.3 } else { 0.0 }
        };
        // The second pixels outside of the region.
        let around = (12..18).flat_map(|row| [(14, row), (25, row)]);
        let around: Vec<(usize, usize)> =
            around.chain((16..24).flat_map(|column| [(column, 10), (column, 19)])).collect();
        let median = |own: &dyn Fn(usize, usize) -> bool| {
            let points = around.iter().filter(|at| own(at.0, at.1));
            let mut inverse: Vec<f32> = points.map(|at| 1.0 / depth(at.0, at.1)).collect();
            inverse.sort_by(f32::total_cmp);
            Vec3::Z * inverse[inverse.len() / 2]
        };
        let all = Plane { inverse: median(&|_, _| true), support: Support::Median };
        assert_eq!(behind(depth, |_, _| 2), all);
        // 16 own ones are enough, 6 are not.
        let above_and_below = |_: usize, row: usize| !(12..18).contains(&row);
        let own = Plane { inverse: median(&above_and_below), support: Support::Median };
        assert_ne!(own, all);
        assert_eq!(behind(depth, |column, row| if above_and_below(column, row) { 1 } else { 2 }), own);
        assert_eq!(behind(depth, |column, _| if column < 16 { 1 } else { 2 }), all);
    }

    #[test]
    fn fewer_than_four_depths_around_say_nothing() {
        let behind_few = |columns: usize| {
            behind(|column, row| if (16..16 + columns).contains(&column) && row < 12 { 2.0 } else { 0.0 }, |_, _| 2)
        };
        assert_eq!(behind_few(3), Plane::FAR);
        assert_eq!(behind_few(4), Plane { inverse: Vec3::Z * 0.5, support: Support::Median });
    }
}
