//! The eight input channels of the network: colour, inverse depth, validity and normals.
//!
//! `training/splatseg_training/inputs.py` computes the same inputs for training. A golden test compares the two.
//! Definition:
//!
//! 1. Colour: rgb / 127.5 - 1.
//! 2. Holes in the depth get the depth of the nearest pixel with depth, in city-block distance (ties: see
//!    [`fill_holes`]). Depth beyond 100 m becomes 100 m.
//! 3. Inverse depth: 1 / max(z, 0.3 m) - 0.5.
//! 4. Validity: 1 where depth was measured.
//! 5. Smoothed depth: the mean over the 13 pixels within distance 2, weighted by
//!    exp(-dz² / (2 · 0.05²) - r² / (2 · 2²)), with dz in metres and r in pixels. Beyond the border the nearest pixel
//!    is used.
//! 6. Normals: with the points P of the smoothed depth, dx = P(x + 2) - P(x - 2), and dy likewise. Within 2 pixels of
//!    the border the nearest such difference inside the image is used. The normal is dx × dy / (|dx × dy| + 1e-9),
//!    pointing away from the camera. It is 0 if not finite, or if the image has fewer than 5 rows or columns.
//!
//! For a frame without any depth all five depth channels are 0, as in training samples without depth.

use super::resolution::ScaledFrame;
use rayon::prelude::*;
use splatseg_geometry::{CowImage, Intrinsics};
use splatseg_kernels::Instructions;
use splatseg_kernels::exp::exp;
use splatseg_kernels::feature_map::FeatureMap;
use splatseg_kernels::instructions::LANES;

/// Number of input channels.
pub(super) const CHANNELS: usize = COLOR_CHANNELS + DEPTH_CHANNELS;
/// Number of colour channels, which come first.
pub(super) const COLOR_CHANNELS: usize = 3;
/// Number of depth channels: inverse depth, validity and normals.
pub(super) const DEPTH_CHANNELS: usize = 5;
/// Depth is clamped to this, metres.
const FARTHEST: f32 = 100.0;
/// Inverse depth is clamped to that of this depth, metres.
const NEAREST: f32 = 0.3;
/// Radius of the smoothing, and half the baseline of the differences for normals, pixels.
const REACH: usize = 2;
/// Offsets (row, column) from the corner of a 5×5 window, and r² / 8 of the pixels within distance 2 of its centre.
const NEIGHBOURS: [(usize, usize, f32); 13] = [
    (0, 2, 0.5),
    (1, 1, 0.25),
    (1, 2, 0.125),
    (1, 3, 0.25),
    (2, 0, 0.5),
    (2, 1, 0.125),
    (2, 2, 0.0),
    (2, 3, 0.125),
    (2, 4, 0.5),
    (3, 1, 0.25),
    (3, 2, 0.125),
    (3, 3, 0.25),
    (4, 2, 0.5),
];

/// Writes the input of a frame to `map`, which is reshaped to `[8, height, width]`. Returns the smoothed depth, metres,
/// which is extended into holes; empty if no pixel has depth.
pub(super) fn compute(frame: &ScaledFrame<'_>, map: &mut FeatureMap) -> Vec<f32> {
    let (width, height) = frame.color.size();
    map.reshape(CHANNELS, height, width);
    let depth = measured(&frame.depth);
    let rows = by_row(map, height);
    let instructions = Instructions::best();
    let Some(depth) = depth else {
        rows.into_par_iter().enumerate().for_each(|(row, mut channels)| {
            write_color(frame.color.row(row), &mut channels);
            channels.iter_mut().skip(3).for_each(|values| values.fill(0.0));
        });
        return Vec::new();
    };
    let filled = fill_holes(depth, width);
    let smooth = smoothed(&filled, width, instructions);
    let rays = Rays::new(&frame.camera);
    rows.into_par_iter().enumerate().for_each(|(row, mut channels)| {
        instructions.run(
            #[inline(always)]
            || {
                write_color(frame.color.row(row), &mut channels);
                let (inverse, rest) = channels[3..].split_at_mut(1);
                for (out, depth) in inverse[0].iter_mut().zip(&filled[row * width..]) {
                    *out = 1.0 / depth.max(NEAREST) - 0.5;
                }
                for (out, depth) in rest[0].iter_mut().zip(frame.depth.row(row)) {
                    *out = if *depth > 0.0 { 1.0 } else { 0.0 };
                }
                write_normals(&smooth, &rays, row, &mut rest[1..]);
            },
        );
    });
    smooth
}

/// Depth in metres, clamped to [`FARTHEST`]. `None` if no pixel has depth.
fn measured(depth: &CowImage<'_, f32>) -> Option<Vec<f32>> {
    let depth: Vec<f32> = depth.pixels().iter().map(|depth| depth.min(FARTHEST)).collect();
    depth.iter().any(|depth| *depth > 0.0).then_some(depth)
}

/// Splits a map into rows: for each row, its slice of every channel.
fn by_row(map: &mut FeatureMap, height: usize) -> Vec<Vec<&mut [f32]>> {
    let mut rows: Vec<Vec<&mut [f32]>> = (0..height).map(|_| Vec::with_capacity(CHANNELS)).collect();
    for channel in map.rows_mut() {
        rows.iter_mut().zip(channel).for_each(|(row, values)| row.push(values));
    }
    rows
}

#[inline(always)]
fn write_color(color: &[[u8; 3]], channels: &mut [&mut [f32]]) {
    for (channel, out) in channels.iter_mut().take(3).enumerate() {
        for (out, color) in out.iter_mut().zip(color) {
            *out = f32::from(color[channel]) / 127.5 - 1.0;
        }
    }
}

/// Fills every hole (0) of `depth` with the depth of the nearest pixel with depth, in city-block distance. The first
/// pass is within each row, where ties go to the left. The second pass goes down: a pixel copies the depth of the one
/// above if that is nearer (distance above + 1 < own distance). The third pass does the same upwards.
fn fill_holes(mut depth: Vec<f32>, width: usize) -> Vec<f32> {
    if depth.iter().all(|depth| *depth > 0.0) {
        return depth;
    }
    // Larger than any distance, and exactly representable as f32.
    const FAR: f32 = 16_000_000.0;
    let mut distance = vec![FAR; depth.len()];
    depth.par_chunks_exact_mut(width).zip(distance.par_chunks_exact_mut(width)).for_each(|(depth, distance)| {
        let (mut nearest, mut steps) = (0.0, FAR);
        for (depth, distance) in depth.iter_mut().zip(distance.iter_mut()) {
            (nearest, steps) = if *depth > 0.0 { (*depth, 0.0) } else { (nearest, (steps + 1.0).min(FAR)) };
            (*depth, *distance) = (nearest, steps);
        }
        (nearest, steps) = (0.0, FAR);
        for (depth, distance) in depth.iter_mut().zip(distance.iter_mut()).rev() {
            steps = (steps + 1.0).min(FAR);
            if steps < *distance {
                (*depth, *distance) = (nearest, steps);
            } else {
                (nearest, steps) = (*depth, *distance);
            }
        }
    });
    let height = depth.len() / width;
    let mut copy_nearer = |from: usize, row: usize| {
        let [from_depth, to_depth] = two_rows(&mut depth, width, from, row);
        let [from_distance, to_distance] = two_rows(&mut distance, width, from, row);
        for column in 0..width {
            let nearer = from_distance[column] + 1.0 < to_distance[column];
            to_depth[column] = if nearer { from_depth[column] } else { to_depth[column] };
            to_distance[column] = if nearer { from_distance[column] + 1.0 } else { to_distance[column] };
        }
    };
    (1..height).for_each(|row| copy_nearer(row - 1, row));
    (1..height).rev().for_each(|row| copy_nearer(row, row - 1));
    depth
}

/// Borrows the neighbouring rows `first` and `second`.
fn two_rows(values: &mut [f32], width: usize, first: usize, second: usize) -> [&mut [f32]; 2] {
    let (upper, lower) = values.split_at_mut(first.max(second) * width);
    let upper = &mut upper[first.min(second) * width..];
    let lower = &mut lower[..width];
    if first < second { [upper, lower] } else { [lower, upper] }
}

/// Bilaterally smoothed depth, `[height, width]`.
fn smoothed(depth: &[f32], width: usize, instructions: Instructions) -> Vec<f32> {
    let height = depth.len() / width;
    // A border of two pixels, and padding after the last row for whole vectors.
    let pitch = width + 2 * REACH;
    let mut padded = Vec::with_capacity((height + 2 * REACH) * pitch + LANES);
    for row in 0..height + 2 * REACH {
        let row = &depth[row.saturating_sub(REACH).min(height - 1) * width..][..width];
        padded.extend_from_slice(&[row[0]; REACH]);
        padded.extend_from_slice(row);
        padded.extend_from_slice(&[row[width - 1]; REACH]);
    }
    padded.resize(padded.len() + LANES, 0.0);
    let mut smooth = vec![0.0; depth.len()];
    smooth.par_chunks_exact_mut(width).enumerate().for_each(|(row, out)| {
        instructions.run(
            #[inline(always)]
            || smooth_row(&padded[row * pitch..], pitch, out),
        );
    });
    smooth
}

/// Computes one row of smoothed depth. `window` starts at the corner of the first pixel's 5×5 window.
#[inline(always)]
fn smooth_row(window: &[f32], pitch: usize, out: &mut [f32]) {
    for (index, out) in out.chunks_mut(LANES).enumerate() {
        let start = index * LANES;
        let lanes_at = |row: usize, column: usize| -> [f32; LANES] {
            let values = &window[row * pitch + start + column..][..LANES];
            std::array::from_fn(|lane| values[lane])
        };
        let center = lanes_at(REACH, REACH);
        let (mut total, mut weights) = ([0.0; LANES], [0.0; LANES]);
        for (row, column, decay) in NEIGHBOURS {
            let near = lanes_at(row, column);
            for lane in 0..LANES {
                let step = near[lane] - center[lane];
                let exponent = step * step * -200.0 - decay;
                let weight = exp(if exponent < -80.0 { -80.0 } else { exponent });
                total[lane] += weight * near[lane];
                weights[lane] += weight;
            }
        }
        out.iter_mut().zip(total.iter().zip(weights)).for_each(|(out, (total, weight))| *out = total / weight);
    }
}

/// x and y at z = 1 of the pixels in each column and row.
struct Rays {
    x: Vec<f32>,
    y: Vec<f32>,
}

impl Rays {
    fn new(camera: &Intrinsics) -> Self {
        let x = (0..camera.width).map(|column| (column as f32 - camera.cx) / camera.fx);
        let y = (0..camera.height).map(|row| (row as f32 - camera.cy) / camera.fy);
        Self { x: x.collect(), y: y.collect() }
    }
}

/// Writes one row of the three normal channels.
#[inline(always)]
fn write_normals(depth: &[f32], rays: &Rays, row: usize, channels: &mut [&mut [f32]]) {
    let (width, height) = (rays.x.len(), rays.y.len());
    let [out_x, out_y, out_z] = channels else { return };
    if width.min(height) < 2 * REACH + 1 {
        return [out_x, out_y, out_z].into_iter().for_each(|out| out.fill(0.0));
    }
    let center_row = row.clamp(REACH, height - 1 - REACH);
    let depths = |row: usize| &depth[row * width..][..width];
    let rows = Neighbours {
        line: depths(row),
        above: depths(center_row - REACH),
        below: depths(center_row + REACH),
        x: &rays.x,
        y: [rays.y[row], rays.y[center_row - REACH], rays.y[center_row + REACH]],
    };
    let mut write = |column: usize, normals: [&[f32]; 3]| {
        [&mut *out_x, &mut *out_y, &mut *out_z].into_iter().zip(normals).for_each(|(out, values)| {
            out[column..][..values.len()].copy_from_slice(values);
        });
    };
    let mut normals = [[0.0; LANES]; 3];
    for start in (REACH..width - REACH).step_by(LANES) {
        let len = LANES.min(width - REACH - start);
        if len == LANES {
            rows.whole_vector(start, &mut normals);
        } else {
            (0..len).for_each(|lane| rows.one(start + lane, start + lane - REACH, lane, &mut normals));
        }
        write(start, [&normals[0][..len], &normals[1][..len], &normals[2][..len]]);
    }
    for column in (0..REACH).chain(width - REACH..width) {
        rows.one(column, column.saturating_sub(REACH).min(width - 1 - 2 * REACH), 0, &mut normals);
        write(column, [&normals[0][..1], &normals[1][..1], &normals[2][..1]]);
    }
}

/// The smoothed depth around the pixels of one row, and their rays.
struct Neighbours<'a> {
    line: &'a [f32],
    above: &'a [f32],
    below: &'a [f32],
    x: &'a [f32],
    /// y of the row, and of those above and below.
    y: [f32; 3],
}

impl Neighbours<'_> {
    /// Computes the normals of [`LANES`] columns from `start` on.
    #[inline(always)]
    fn whole_vector(&self, start: usize, normals: &mut [[f32; LANES]; 3]) {
        let left = start - REACH;
        let lanes = |values: &[f32], start: usize| -> [f32; LANES] {
            let values = &values[start..][..LANES];
            std::array::from_fn(|lane| values[lane])
        };
        let (z_left, z_right) = (lanes(self.line, left), lanes(self.line, left + 2 * REACH));
        let (x_left, x_right) = (lanes(self.x, left), lanes(self.x, left + 2 * REACH));
        let (z_above, z_below) = (lanes(self.above, start), lanes(self.below, start));
        let x = lanes(self.x, start);
        let [out_x, out_y, out_z] = normals;
        for lane in 0..LANES {
            let across = ([z_left[lane], z_right[lane]], [x_left[lane], x_right[lane]]);
            let down = ([z_above[lane], z_below[lane]], x[lane]);
            [out_x[lane], out_y[lane], out_z[lane]] = normal(across, down, self.y);
        }
    }

    /// Computes the normal of one column, from the difference between `left` and the column on the other side.
    #[inline(always)]
    fn one(&self, column: usize, left: usize, lane: usize, normals: &mut [[f32; LANES]; 3]) {
        let right = left + 2 * REACH;
        let across = ([self.line[left], self.line[right]], [self.x[left], self.x[right]]);
        let down = ([self.above[column], self.below[column]], self.x[column]);
        let normal = normal(across, down, self.y);
        normals.iter_mut().zip(normal).for_each(|(out, value)| out[lane] = value);
    }
}

/// The normal at a pixel: from the depth and x of the pixels to the left and right, and the depth of those above and below
/// with their common x. `y` is that of the pixel, and of those above and below.
#[inline(always)]
fn normal(
    ([z_left, z_right], [x_left, x_right]): ([f32; 2], [f32; 2]),
    ([z_above, z_below], x): ([f32; 2], f32),
    [y, y_above, y_below]: [f32; 3],
) -> [f32; 3] {
    let dx = [z_right * x_right - z_left * x_left, z_right * y - z_left * y, z_right - z_left];
    let dy = [z_below * x - z_above * x, z_below * y_below - z_above * y_above, z_below - z_above];
    let product = [dx[1] * dy[2] - dx[2] * dy[1], dx[2] * dy[0] - dx[0] * dy[2], dx[0] * dy[1] - dx[1] * dy[0]];
    let norm = (product[0] * product[0] + product[1] * product[1] + product[2] * product[2]).sqrt();
    let factor = 1.0 / (norm + 1e-9);
    product.map(|part| if norm < f32::INFINITY { part * factor } else { 0.0 })
}
