//! Points of a keyframe that later frames are aligned with, and the noise of its depth.

use crate::pyramid::{Level, Pyramid};
use glam::{Vec2, Vec3};
use rayon::prelude::*;
use splatseg_geometry::SegmentId;

/// Maximum number of points per level, about: one per cell of a grid.
const MAX_POINTS: usize = 4800;

/// Below this change of luminance per pixel, a point says nothing about the image's motion.
const MIN_GRADIENT: f32 = 1.5;

/// Radius of the window in which a plane is fitted, pixels, by level from the finest; the last one holds for the rest.
const WINDOW_RADIUS: [isize; 3] = [3, 2, 2];

/// Pixels whose inverse depth differs by more than this fraction from that of the window's centre are on another
/// surface.
const SAME_SURFACE: f32 = 0.04;

/// Where the depth deviates from the plane by more than this many of the sensor's deviations, there is no plane.
const MAX_ROUGHNESS: f32 = 2.5;

/// The noise of a sensor is measured in windows whose centres are this far apart, pixels.
const NOISE_STRIDE: usize = 2;

/// Surfaces are rough, too: noise below this many of a Kinect's deviations is that of a Kinect. Kinects and time-of-flight
/// cameras have 0.3 to 1 in most frames, and up to 2.1 in some.
const USUAL_NOISE: f32 = 2.0;

/// Share of a window that must be on the centre's surface.
const MIN_WINDOW_SHARE: f32 = 0.5;

/// Surfaces at a more grazing angle than this are measured too badly: cosine between normal and line of sight.
const MIN_COSINE: f32 = 0.17;

/// Maximum distance of usable depth, metres.
const MAX_DEPTH: f32 = 10.0;

/// A point on a surface that the keyframe saw, in the keyframe's camera coordinates.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ReferencePoint {
    /// Position, metres.
    pub(crate) position: Vec3,
    /// Unit normal of the surface, towards the camera.
    pub(crate) normal: Vec3,
    /// Inverse of the expected standard deviation of the distance between a measurement and the plane, 1/m.
    pub(crate) certainty: f32,
    /// Luminance in the keyframe.
    pub(crate) grey: f32,
    /// Change of the luminance with the point's position, per metre; zero where the image is flat.
    pub(crate) gradient: Vec3,
    /// Row-major index of the point's pixel at the finest level.
    pub(crate) pixel: u32,
    /// The segment that the point belongs to, once known.
    pub(crate) segment: SegmentId,
    /// Weight of the point's segment: less for things that move by themselves.
    pub(crate) weight: f32,
}

/// Standard deviation of a Kinect's depth at `depth` metres (Nguyen, Izadi and Lovell, 3DIM 2012), metres.
pub(crate) fn depth_deviation(depth: f32) -> f32 {
    let beyond = (depth - 0.4).max(0.0);
    0.0012 + 0.0019 * beyond * beyond
}

/// Noise of a frame's depth within the frame, in units of a Kinect's deviation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct DepthNoise(f32);

impl DepthNoise {
    /// Measures the noise: the median deviation from planes that are fitted to small windows, at the resolution at which
    /// all pixels are points. Finer windows do not see noise that neighbours share, coarser ones see the shape of things.
    pub(crate) fn of(pyramid: &Pyramid) -> Self {
        let is_coarse = |level: &Level| level.depth.pixels().len() <= MAX_POINTS;
        let last = pyramid.levels.len().saturating_sub(1);
        let number = pyramid.levels.iter().position(is_coarse).unwrap_or(last);
        let Some(level) = pyramid.levels.get(number) else { return Self(1.0) };
        let (width, height) = level.depth.size();
        let places = (0..height).step_by(NOISE_STRIDE);
        let places = places.flat_map(|row| (0..width).step_by(NOISE_STRIDE).map(move |column| (column, row)));
        let usable =
            places.filter(|place| (0.0..MAX_DEPTH).contains(&level.depth[*place]) && level.depth[*place] > 0.0);
        let fits = usable.filter_map(|(column, row)| fit_plane(level, number, column, row));
        let mut found: Vec<f32> = fits.map(|fit| fit.deviation()).collect();
        found.sort_unstable_by(f32::total_cmp);
        Self(found.get(found.len() / 2).copied().unwrap_or(1.0))
    }

    /// The noise in units of a Kinect's deviation, 1 if it is less.
    pub(crate) fn relative(self) -> f32 {
        self.0.max(1.0)
    }

    /// Factor for limits that are meant for a Kinect: 1 for a sensor as good.
    pub(crate) fn allowance(self) -> f32 {
        (self.0 / USUAL_NOISE).max(1.0)
    }
}

/// Selects points of one level of a keyframe: in each cell of a grid the one with the strongest image gradient among
/// those with a surface. `number` is the level's number, 0 for the finest.
pub(crate) fn select_points(
    level: &Level,
    number: usize,
    finest_width: usize,
    noise: DepthNoise,
) -> Vec<ReferencePoint> {
    let (width, height) = level.depth.size();
    let cell = cell_side(width, height);
    let rows = height.div_ceil(cell);
    let of_row = |row: usize| -> Vec<ReferencePoint> {
        let columns = (0..width.div_ceil(cell)).map(|column| (column * cell, row * cell));
        columns.filter_map(|corner| best_in_cell(level, (number, finest_width), noise, corner, cell)).collect()
    };
    let rows: Vec<Vec<ReferencePoint>> = (0..rows).into_par_iter().with_min_len(4).map(of_row).collect();
    rows.into_iter().flatten().collect()
}

/// Side of the cells of a level, pixels.
fn cell_side(width: usize, height: usize) -> usize {
    (1..).find(|side| width.div_ceil(*side) * height.div_ceil(*side) <= MAX_POINTS).unwrap_or(1)
}

fn best_in_cell(
    level: &Level,
    number: (usize, usize),
    noise: DepthNoise,
    corner: (usize, usize),
    cell: usize,
) -> Option<ReferencePoint> {
    let (width, height) = level.depth.size();
    let mut best: Option<(f32, usize, usize)> = None;
    for row in corner.1.max(1)..(corner.1 + cell).min(height - 1) {
        for column in corner.0.max(1)..(corner.0 + cell).min(width - 1) {
            let depth = level.depth[(column, row)];
            if depth > 0.0 && depth < MAX_DEPTH {
                let strength = image_gradient(level, column, row).length_squared();
                if best.is_none_or(|(strongest, ..)| strength > strongest) {
                    best = Some((strength, column, row));
                }
            }
        }
    }
    let (_, column, row) = best?;
    reference_point(level, number, noise, (column, row))
}

/// Change of the luminance per pixel, by central differences.
fn image_gradient(level: &Level, column: usize, row: usize) -> Vec2 {
    let grey = &level.grey;
    let horizontal = grey[(column + 1, row)] - grey[(column - 1, row)];
    let vertical = grey[(column, row + 1)] - grey[(column, row - 1)];
    Vec2::new(horizontal, vertical) * 0.5
}

fn reference_point(
    level: &Level,
    (number, finest_width): (usize, usize),
    noise: DepthNoise,
    (column, row): (usize, usize),
) -> Option<ReferencePoint> {
    let camera = &level.intrinsics;
    let ray = Vec3::new((column as f32 - camera.cx) / camera.fx, (row as f32 - camera.cy) / camera.fy, 1.0);
    let fit = fit_plane(level, number, column, row)?;
    let limit = MAX_ROUGHNESS * noise.allowance() * fit.expected;
    if fit.variance > limit * limit {
        return None;
    }
    let PlaneFit { plane, samples, .. } = fit;
    // The plane is {p : plane · p = 1}.
    let inverse_depth = plane.dot(ray);
    let normal = -plane.normalize();
    let cosine = -normal.dot(ray.normalize());
    let depth = 1.0 / inverse_depth;
    if !(cosine >= MIN_COSINE && depth > 0.0 && depth < MAX_DEPTH) {
        return None;
    }
    let position = ray * depth;
    let mut gradient = image_gradient(level, column, row);
    if gradient.length_squared() < MIN_GRADIENT * MIN_GRADIENT {
        gradient = Vec2::ZERO;
    }
    // d(pixel)/d(position) of the pinhole camera.
    let (along_x, along_y) = (gradient.x * camera.fx / depth, gradient.y * camera.fy / depth);
    Some(ReferencePoint {
        position,
        normal,
        certainty: 1.0 / plane_deviation(depth, cosine, camera.fx, samples),
        grey: level.grey[(column, row)],
        gradient: Vec3::new(along_x, along_y, -(along_x * position.x + along_y * position.y) / depth),
        pixel: ((row << number) * finest_width + (column << number)) as u32,
        segment: 0,
        weight: 1.0,
    })
}

/// Expected standard deviation of the distance between a measured point and a plane fitted to `samples` measurements,
/// metres: depth noise along the line of sight and half a pixel across it.
fn plane_deviation(depth: f32, cosine: f32, focal_length: f32, samples: f32) -> f32 {
    let (along, across) = (depth_deviation(depth), 0.5 * depth / focal_length);
    let variance = along * along * cosine * cosine + across * across * (1.0 - cosine * cosine);
    (variance * (1.0 + 4.0 / samples)).sqrt()
}

/// A plane in a window of depth.
struct PlaneFit {
    /// The plane is {p : plane · p = 1}.
    plane: Vec3,
    /// Number of pixels.
    samples: f32,
    /// Variance of the inverse depth around the plane, relative to that of the window's centre.
    variance: f32,
    /// Deviation of a Kinect's inverse depth, relative to that of the window's centre.
    expected: f32,
}

impl PlaneFit {
    /// Deviation from the plane in units of a Kinect's.
    fn deviation(&self) -> f32 {
        self.variance.max(0.0).sqrt() / self.expected
    }
}

/// Fits a plane {p : plane · p = 1} to the pixels around one that lie on the same surface. On a plane the inverse depth
/// is linear in the pixel's coordinates.
fn fit_plane(level: &Level, number: usize, column: usize, row: usize) -> Option<PlaneFit> {
    let camera = &level.intrinsics;
    let radius = WINDOW_RADIUS[number.min(WINDOW_RADIUS.len() - 1)];
    let (width, height) = level.depth.size();
    let centre = 1.0 / level.depth[(column, row)];
    // Moments of (dx, dy, 1), in pixels, and of their products with the relative difference of the inverse depth.
    let [mut xx, mut xy, mut yy, mut x, mut y, mut count] = [0.0f32; 6];
    let [mut xd, mut yd, mut d, mut dd] = [0.0f32; 4];
    for dy in -radius..=radius {
        let Some(below) = row.checked_add_signed(dy).filter(|row| *row < height) else { continue };
        let depths = level.depth.row(below);
        for dx in -radius..=radius {
            let Some(beside) = column.checked_add_signed(dx).filter(|column| *column < width) else { continue };
            let depth = depths[beside];
            if depth <= 0.0 {
                continue;
            }
            let difference = 1.0 / (depth * centre) - 1.0;
            if difference.abs() > SAME_SURFACE {
                continue;
            }
            let (fx, fy) = (dx as f32, dy as f32);
            (xx, xy, yy, x, y, count) = (xx + fx * fx, xy + fx * fy, yy + fy * fy, x + fx, y + fy, count + 1.0);
            (xd, yd, d) = (xd + fx * difference, yd + fy * difference, d + difference);
            dd += difference * difference;
        }
    }
    let side = (2 * radius + 1) as f32;
    if count < MIN_WINDOW_SHARE * side * side {
        return None;
    }
    let moments = glam::Mat3::from_cols_array(&[xx, xy, x, xy, yy, y, x, y, count]);
    if moments.determinant().abs() < 1e-3 * count {
        return None;
    }
    let products = Vec3::new(xd, yd, d);
    let slopes = moments.inverse() * products;
    let variance = (dd - slopes.dot(products)) / count;
    let slopes = slopes * centre;
    // 1/z = a (u - column) + b (v - row) + c, with u = fx x + cx and v = fy y + cy for the ray (x, y, 1).
    let at_origin = centre + slopes.z + slopes.x * (camera.cx - column as f32) + slopes.y * (camera.cy - row as f32);
    let plane = Vec3::new(slopes.x * camera.fx, slopes.y * camera.fy, at_origin);
    let expected = depth_deviation(1.0 / centre) * centre;
    plane.is_finite().then_some(PlaneFit { plane, samples: count, variance, expected })
}

#[cfg(test)]
mod tests {
    use super::*;
    use splatseg_geometry::{Image, Intrinsics};

    /// A number from -1 to 1 for a place in a grid.
    fn hashed(column: usize, row: usize) -> f32 {
        let mixed = ((column * 73_856_093) ^ (row * 19_349_663)).wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 40;
        (mixed % 2001) as f32 / 1000.0 - 1.0
    }

    /// Noise that neighbours share, with a deviation of about 1: a grid of random numbers `side` pixels apart,
    /// interpolated.
    fn smooth(column: usize, row: usize, side: usize) -> f32 {
        let (left, top) = (column / side, row / side);
        let (across, down) = ((column % side) as f32 / side as f32, (row % side) as f32 / side as f32);
        let above = hashed(left, top) * (1.0 - across) + hashed(left + 1, top) * across;
        let below = hashed(left, top + 1) * (1.0 - across) + hashed(left + 1, top + 1) * across;
        2.5 * (above * (1.0 - down) + below * down)
    }

    /// The noise of a slanted wall about 2 m away; `noise` is added to the depth, metres.
    fn noise_of(focal: f32, noise: impl Fn(usize, usize) -> f32) -> DepthNoise {
        let camera = Intrinsics { fx: focal, fy: focal, cx: 159.5, cy: 119.5, width: 320, height: 240 };
        let wall = |column: usize, row: usize| {
            let ray = Vec3::new((column as f32 - 159.5) / 260.0, (row as f32 - 119.5) / 260.0, 1.0);
            1.0 / Vec3::new(0.1, -0.15, 0.5).dot(ray)
        };
        let depth = Image::from_fn(320, 240, |column, row| wall(column, row) + noise(column, row));
        DepthNoise::of(&Pyramid::from_level(Level { grey: Image::filled(320, 240, 9.0), depth, intrinsics: camera }))
    }

    #[test]
    fn noise_is_that_of_the_sensor_whatever_its_focal_length() {
        for focal in [200.0, 260.0, 320.0] {
            let exact = noise_of(focal, |_, _| 0.0);
            assert_eq!((exact.relative(), exact.allowance()), (1.0, 1.0));
            // Two, four and eight centimetres, of which windows see a part.
            let found = [0.02, 0.04, 0.08].map(|metres| {
                noise_of(focal, |column, row| metres * smooth(column, row, 9)).relative() * depth_deviation(2.0)
            });
            for (found, metres) in found.into_iter().zip([0.02, 0.04, 0.08]) {
                assert!((0.3 * metres..metres).contains(&found), "{found} m instead of {metres}");
            }
        }
    }
}
