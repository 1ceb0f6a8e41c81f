//! Corners of an image with binary descriptors and places in space, to recognise a view.
//!
//! Corners are maxima of the structure tensor's smaller eigenvalue (Shi and Tomasi, CVPR 1994). Descriptors compare the
//! luminance of 256 pairs of places around a corner (BRIEF: Calonder et al., ECCV 2010). The places are given in metres:
//! depth tells how large a patch appears, so that descriptors do not change with the distance.

use crate::pyramid::{Level, Pyramid};
use glam::{Vec2, Vec3};
use rayon::prelude::*;
use std::sync::LazyLock;

/// Images wider than this are not searched for corners; the next coarser level is.
const MAX_WIDTH: usize = 400;

/// Side of the cells of the image, pixels. Each contributes at most [`PER_CELL`] corners.
const CELL: usize = 16;
const PER_CELL: usize = 2;

/// Distance between two corners of a cell, pixels.
const MIN_DISTANCE: f32 = 5.0;

/// Smallest eigenvalue of the structure tensor of a corner: mean squared change of the luminance per pixel.
const MIN_STRENGTH: f32 = 4.0;

/// Radius of the window of the structure tensor, pixels.
const WINDOW: usize = 2;

/// Radius of the patch that a descriptor covers, metres...
const PATCH_METRES: f32 = 0.06;
/// ...and its limits, pixels.
const PATCH_PIXELS: (f32, f32) = (7.0, 18.0);

/// Patches of a larger radius than this are read from the next coarser level.
const FINE_RADIUS: f32 = 10.0;

/// Maximum distance of a corner, metres: beyond, depth is too inexact.
const MAX_DEPTH: f32 = 6.0;

/// Number of bits of a descriptor.
pub(crate) const BITS: usize = 256;

/// A binary descriptor.
pub(crate) type Descriptor = [u64; BITS / 64];

/// A corner with its place and its descriptor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Feature {
    /// Place in the camera's coordinates, metres.
    pub(crate) point: Vec3,
    pub(crate) descriptor: Descriptor,
}

/// Number of bits in which two descriptors differ.
pub(crate) fn hamming(one: &Descriptor, other: &Descriptor) -> u32 {
    one.iter().zip(other).map(|(one, other)| (one ^ other).count_ones()).sum()
}

/// A sequence of pseudo-random numbers (SplitMix64), the same on every machine.
pub(crate) struct Random(pub(crate) u64);

impl Random {
    pub(crate) fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut mixed = self.0;
        mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        mixed ^ (mixed >> 31)
    }

    /// A number from 0 to `limit`, exclusive.
    pub(crate) fn below(&mut self, limit: usize) -> usize {
        (self.next() % limit.max(1) as u64) as usize
    }
}

/// The pairs of places that a descriptor compares, in units of the patch's radius: normally distributed.
static PAIRS: LazyLock<[[Vec2; 2]; BITS]> = LazyLock::new(|| {
    let mut random = Random(0x5EED);
    let mut coordinate = || {
        // The sum of four uniform numbers is nearly normal, here with a deviation of 0.43.
        let sum: f32 = (0..4).map(|_| (random.next() >> 40) as f32 / (1u64 << 24) as f32 - 0.5).sum();
        (sum * 0.75).clamp(-1.0, 1.0)
    };
    std::array::from_fn(|_| [Vec2::new(coordinate(), coordinate()), Vec2::new(coordinate(), coordinate())])
});

/// Returns the strongest corners of a frame that have depth, at most `limit`, the strongest first.
pub(crate) fn detect(pyramid: &Pyramid, limit: usize) -> Vec<Feature> {
    let finest = pyramid.levels.iter().position(|level| level.grey.width() <= MAX_WIDTH).unwrap_or(0);
    let (level, coarser) = (&pyramid.levels[finest], pyramid.levels.get(finest + 1));
    let mut corners = corners(level);
    corners.truncate(limit);
    corners.into_par_iter().with_min_len(32).filter_map(|corner| feature(level, coarser, corner.place)).collect()
}

/// A corner of the image.
#[derive(Clone, Copy)]
struct Corner {
    strength: f32,
    place: (usize, usize),
}

/// All corners, the strongest first.
fn corners(level: &Level) -> Vec<Corner> {
    let (width, height) = level.grey.size();
    let margin = WINDOW + 2;
    if width <= 2 * margin || height <= 2 * margin {
        return Vec::new();
    }
    let of_row = |row: usize| corners_in_cells(level, row * CELL, margin);
    let rows: Vec<Vec<Corner>> = (0..height.div_ceil(CELL)).into_par_iter().map(of_row).collect();
    let mut corners: Vec<Corner> = rows.into_iter().flatten().collect();
    // Ties in the order of rows and columns: sorting is stable.
    corners.sort_by(|one, other| other.strength.total_cmp(&one.strength));
    corners
}

/// The corners in a row of cells.
fn corners_in_cells(level: &Level, top: usize, margin: usize) -> Vec<Corner> {
    let (width, height) = level.grey.size();
    let mut cells: Vec<Vec<Corner>> = vec![Vec::new(); width.div_ceil(CELL)];
    let mut tensor = StructureTensor::default();
    for row in (top.max(margin)..(top + CELL).min(height - margin)).step_by(2) {
        let strengths = tensor.strengths(level, row);
        for (cell, found) in cells.iter_mut().enumerate() {
            let left = cell * CELL;
            for column in (left.max(margin)..(left + CELL).min(width - margin)).step_by(2) {
                let strength = strengths[column - WINDOW - 1];
                if strength >= MIN_STRENGTH {
                    found.push(Corner { strength, place: (column, row) });
                }
            }
        }
    }
    cells.into_iter().flat_map(strongest).collect()
}

/// The strongest corners of a cell that are not too close together.
fn strongest(mut found: Vec<Corner>) -> Vec<Corner> {
    found.sort_by(|one, other| other.strength.total_cmp(&one.strength));
    let mut kept: Vec<Corner> = Vec::with_capacity(PER_CELL);
    for corner in found {
        let place = |corner: &Corner| Vec2::new(corner.place.0 as f32, corner.place.1 as f32);
        if kept.iter().all(|other| place(other).distance(place(&corner)) >= MIN_DISTANCE) {
            kept.push(corner);
            if kept.len() == PER_CELL {
                break;
            }
        }
    }
    kept
}

/// The structure tensor around the pixels of a row, in buffers that are used for one row after the other. Each sum has the
/// order of the window's pixels, so that vectors of any width give the same bytes.
#[derive(Default)]
struct StructureTensor {
    /// Products of the gradient at the pixels of one row, from column 1 on: xx, xy, yy.
    products: [Vec<f32>; 3],
    /// Their sums over the windows around the pixels from column `WINDOW + 1` on.
    sums: [Vec<f32>; 3],
    strengths: Vec<f32>,
}

impl StructureTensor {
    /// The smaller eigenvalue of the tensor around the pixels from column `WINDOW + 1` to as far from the end, per pixel of
    /// the window.
    fn strengths(&mut self, level: &Level, row: usize) -> &[f32] {
        let inner = level.grey.width() - 2 * WINDOW - 2;
        for sums in &mut self.sums {
            sums.clear();
            sums.resize(inner, 0.0);
        }
        for row in row - WINDOW..=row + WINDOW {
            self.set_products(level, row);
            for (sums, products) in self.sums.iter_mut().zip(&self.products) {
                for shift in 0..=2 * WINDOW {
                    sums.iter_mut().zip(&products[shift..]).for_each(|(sum, product)| *sum += product);
                }
            }
        }
        let side = (2 * WINDOW + 1) as f32;
        let [xx, xy, yy] = &self.sums;
        self.strengths.clear();
        self.strengths.extend(xx.iter().zip(xy).zip(yy).map(|((xx, xy), yy)| {
            let (mean, difference) = ((xx + yy) * 0.5, (xx - yy) * 0.5);
            (mean - (difference * difference + xy * xy).sqrt()) / (side * side)
        }));
        &self.strengths
    }

    fn set_products(&mut self, level: &Level, row: usize) {
        let [above, here, below] = [row - 1, row, row + 1].map(|row| level.grey.row(row));
        let [xx, xy, yy] = &mut self.products;
        [&mut *xx, &mut *xy, &mut *yy].into_iter().for_each(Vec::clear);
        let inner = level.grey.width() - 2;
        let beside = here[..inner].iter().zip(&here[2..]).zip(&above[1..=inner]).zip(&below[1..=inner]);
        let gradients =
            || beside.clone().map(|(((left, right), above), below)| ((right - left) * 0.5, (below - above) * 0.5));
        xx.extend(gradients().map(|(x, _)| x * x));
        xy.extend(gradients().map(|(x, y)| x * y));
        yy.extend(gradients().map(|(_, y)| y * y));
    }
}

/// Describes a corner; `None` if it has no depth.
fn feature(level: &Level, coarser: Option<&Level>, (column, row): (usize, usize)) -> Option<Feature> {
    let depth = nearest_depth(level, column, row)?;
    let pixel = Vec2::new(column as f32, row as f32);
    let point = level.intrinsics.unproject(pixel, depth);
    let radius = (level.intrinsics.fx * PATCH_METRES / depth).clamp(PATCH_PIXELS.0, PATCH_PIXELS.1);
    let descriptor = match coarser {
        Some(coarser) if radius > FINE_RADIUS => descriptor(coarser, pixel * 0.5 - 0.25, radius * 0.5),
        _ => descriptor(level, pixel, radius),
    };
    Some(Feature { point, descriptor })
}

/// The smallest depth around a pixel: a corner at the edge of a thing belongs to the thing.
fn nearest_depth(level: &Level, column: usize, row: usize) -> Option<f32> {
    let rows = (row - 1..=row + 1).flat_map(|row| &level.depth.row(row)[column - 1..=column + 1]);
    let nearest = rows.copied().filter(|depth| *depth > 0.0).fold(f32::INFINITY, f32::min);
    (nearest <= MAX_DEPTH).then_some(nearest)
}

fn descriptor(level: &Level, centre: Vec2, radius: f32) -> Descriptor {
    let limit = Vec2::new(level.grey.width() as f32 - 1.001, level.grey.height() as f32 - 1.001);
    let grey = |place: Vec2| level.grey_at((centre + place * radius).clamp(Vec2::ZERO, limit));
    let mut bits = [0; BITS / 64];
    for (index, [one, other]) in PAIRS.iter().enumerate() {
        bits[index / 64] |= u64::from(grey(*one) < grey(*other)) << (index % 64);
    }
    bits
}

#[cfg(test)]
mod tests {
    use super::*;
    use splatseg_geometry::{Image, Intrinsics};

    /// The smaller eigenvalue of the structure tensor around one pixel, by its definition.
    fn strength(grey: &Image<f32>, column: usize, row: usize) -> f32 {
        let (mut xx, mut xy, mut yy) = (0.0f32, 0.0f32, 0.0f32);
        for row in row - WINDOW..=row + WINDOW {
            for column in column - WINDOW..=column + WINDOW {
                let x = (grey[(column + 1, row)] - grey[(column - 1, row)]) * 0.5;
                let y = (grey[(column, row + 1)] - grey[(column, row - 1)]) * 0.5;
                (xx, xy, yy) = (xx + x * x, xy + x * y, yy + y * y);
            }
        }
        let (mean, difference) = ((xx + yy) * 0.5, (xx - yy) * 0.5);
        (mean - (difference * difference + xy * xy).sqrt()) / 25.0
    }

    #[test]
    fn the_strength_of_a_row_is_that_of_each_pixel() {
        let (width, height) = (53, 31);
        let mut random = Random(7);
        let grey = Image::from_fn(width, height, |_, _| (random.next() >> 56) as f32);
        let intrinsics = Intrinsics { fx: 50.0, fy: 50.0, cx: 26.0, cy: 15.0, width, height };
        let level = Level { grey, depth: Image::filled(width, height, 1.0), intrinsics };
        let mut tensor = StructureTensor::default();
        for row in WINDOW + 1..height - WINDOW - 1 {
            let found = tensor.strengths(&level, row).to_vec();
            let columns = WINDOW + 1..width - WINDOW - 1;
            assert_eq!(found, columns.map(|column| strength(&level.grey, column, row)).collect::<Vec<f32>>());
        }
    }
}
