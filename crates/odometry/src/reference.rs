//! Points of a keyframe that later frames are aligned with.

use crate::pyramid::Level;
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

/// Selects points of one level of a keyframe: in each cell of a grid the one with the strongest image gradient among
/// those with a surface. `number` is the level's number, 0 for the finest.
pub(crate) fn select_points(level: &Level, number: usize, finest_width: usize) -> Vec<ReferencePoint> {
    let (width, height) = level.depth.size();
    let cell = cell_side(width, height);
    let rows = height.div_ceil(cell);
    let of_row = |row: usize| -> Vec<ReferencePoint> {
        let columns = (0..width.div_ceil(cell)).map(|column| (column * cell, row * cell));
        columns.filter_map(|corner| best_in_cell(level, (number, finest_width), corner, cell)).collect()
    };
    let rows: Vec<Vec<ReferencePoint>> = (0..rows).into_par_iter().with_min_len(4).map(of_row).collect();
    rows.into_iter().flatten().collect()
}

/// Side of the cells of a level, pixels.
fn cell_side(width: usize, height: usize) -> usize {
    (1..).find(|side| width.div_ceil(*side) * height.div_ceil(*side) <= MAX_POINTS).unwrap_or(1)
}

fn best_in_cell(level: &Level, number: (usize, usize), corner: (usize, usize), cell: usize) -> Option<ReferencePoint> {
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
    reference_point(level, number, column, row)
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
    column: usize,
    row: usize,
) -> Option<ReferencePoint> {
    let camera = &level.intrinsics;
    let ray = Vec3::new((column as f32 - camera.cx) / camera.fx, (row as f32 - camera.cy) / camera.fy, 1.0);
    let (plane, samples) = fit_plane(level, number, column, row)?;
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

/// Fits a plane {p : plane · p = 1} to the pixels around one that lie on the same surface. On a plane the inverse depth
/// is linear in the pixel's coordinates. Returns the plane, and the number of pixels.
fn fit_plane(level: &Level, number: usize, column: usize, row: usize) -> Option<(Vec3, f32)> {
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
    let expected = MAX_ROUGHNESS * depth_deviation(1.0 / centre) * centre;
    if variance > expected * expected {
        return None;
    }
    let slopes = slopes * centre;
    // 1/z = a (u - column) + b (v - row) + c, with u = fx x + cx and v = fy y + cy for the ray (x, y, 1).
    let at_origin = centre + slopes.z + slopes.x * (camera.cx - column as f32) + slopes.y * (camera.cy - row as f32);
    let plane = Vec3::new(slopes.x * camera.fx, slopes.y * camera.fy, at_origin);
    plane.is_finite().then_some((plane, count))
}
