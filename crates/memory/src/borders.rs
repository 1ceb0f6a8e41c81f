//! Where segments and surfaces end in a frame.

use rayon::prelude::*;
use splatseg_geometry::{CowImage, Image, SegmentMap};

/// Distances are not told apart beyond this, pixels.
pub(crate) const MAX_DISTANCE: u8 = 32;

/// What lies at a pixel.
const MIXED: u8 = 1;
const BORDER: u8 = 2;

/// The borders of a frame: pixels beside one of another segment or across a depth edge.
#[derive(Clone, Debug)]
pub(crate) struct Borders {
    kinds: Image<u8>,
    distances: Image<u8>,
}

impl Borders {
    /// Finds them. Depths are metres, 0 where missing; neighbours that differ by more than the fraction
    /// `edge_disparity` are on two surfaces.
    pub fn new(depth: &CowImage<'_, f32>, segments: &SegmentMap, edge_disparity: f32) -> Self {
        let (width, height) = depth.size();
        let mut kinds = Image::filled(width, height, 0);
        kinds.pixels_mut().par_chunks_mut(width.max(1)).enumerate().for_each(|(row, kinds)| {
            for (column, kind) in kinds.iter_mut().enumerate() {
                *kind = kind_of(depth, segments, (column, row), edge_disparity);
            }
        });
        let distances = distances_to_borders(&kinds);
        Self { kinds, distances }
    }

    /// Whether a pixel's depth may be a mixture of a nearer and a farther surface: it lies between neighbours across two
    /// depth edges, and not on a slanted plane with them.
    pub fn is_mixed(&self, at: (usize, usize)) -> bool {
        self.kinds[at] & MIXED != 0
    }

    /// Steps along rows and columns to the nearest border, at most [`MAX_DISTANCE`]; 0 on one.
    pub fn distance(&self, at: (usize, usize)) -> u8 {
        self.distances[at]
    }
}

fn kind_of(depth: &CowImage<'_, f32>, segments: &SegmentMap, (column, row): (usize, usize), edge_disparity: f32) -> u8 {
    let (width, height) = depth.size();
    let (own, segment) = (depth[(column, row)], segments[(column, row)]);
    let (mut nearer, mut farther, mut border) = (false, false, false);
    let mut look = |at: (usize, usize)| {
        border |= segments[at] != segment;
        let other = depth[at];
        if own > 0.0 && other > 0.0 {
            let limit = edge_disparity * own.min(other);
            nearer |= own - other > limit;
            farther |= other - own > limit;
        }
    };
    if column > 0 {
        look((column - 1, row));
    }
    if column + 1 < width {
        look((column + 1, row));
    }
    if row > 0 {
        look((column, row - 1));
    }
    if row + 1 < height {
        look((column, row + 1));
    }
    let mixed = if nearer && farther && !is_on_a_plane(depth, (column, row), edge_disparity) { MIXED } else { 0 };
    if border || nearer || farther { mixed | BORDER } else { mixed }
}

/// Whether a pixel goes on with what lies beside it in its row, and above or below it. A surface seen at a small angle
/// has depth edges on both sides of each pixel, but along rows and columns its inverse depth is a straight line.
fn is_on_a_plane(depth: &CowImage<'_, f32>, (column, row): (usize, usize), edge_disparity: f32) -> bool {
    let inverse = |by: (isize, isize), steps: isize| {
        let at = (column.checked_add_signed(steps * by.0)?, row.checked_add_signed(steps * by.1)?);
        let is_inside = at.0 < depth.width() && at.1 < depth.height();
        (is_inside && depth[at] > 0.0).then(|| 1.0 / depth[at])
    };
    let own = 1.0 / depth[(column, row)];
    let continues = |by| {
        let expected = inverse(by, 1).zip(inverse(by, 2)).map(|(near, far)| 2.0 * near - far);
        expected.is_some_and(|expected| (expected - own).abs() <= edge_disparity * own)
    };
    (continues((1, 0)) || continues((-1, 0))) && (continues((0, 1)) || continues((0, -1)))
}

/// City-block distances by two passes.
fn distances_to_borders(kinds: &Image<u8>) -> Image<u8> {
    let (width, height) = kinds.size();
    let mut distances = kinds.map(|kind| if kind & BORDER != 0 { 0 } else { MAX_DISTANCE });
    let pixels = distances.pixels_mut();
    for index in 0..width * height {
        let left = if index % width > 0 { pixels[index - 1] } else { MAX_DISTANCE };
        let above = if index >= width { pixels[index - width] } else { MAX_DISTANCE };
        pixels[index] = pixels[index].min(left.min(above).saturating_add(1));
    }
    for index in (0..width * height).rev() {
        let right = if index % width + 1 < width { pixels[index + 1] } else { MAX_DISTANCE };
        let below = if index + width < width * height { pixels[index + width] } else { MAX_DISTANCE };
        pixels[index] = pixels[index].min(right.min(below).saturating_add(1));
    }
    distances
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_count_steps_to_segments_and_surfaces() {
        let segments = SegmentMap::from_fn(9, 1, |column, _| u32::from(column >= 7));
        let depth = Image::from_fn(9, 1, |column, _| if column < 2 { 1.0 } else { 2.0 });
        let borders = Borders::new(&depth, &segments, 0.03);
        let found: Vec<u8> = (0..9).map(|column| borders.distance((column, 0))).collect();
        assert_eq!(found, [1, 0, 0, 1, 2, 1, 0, 0, 1]);
        assert!((0..9).all(|column| !borders.is_mixed((column, 0))));
    }

    #[test]
    fn depth_between_two_surfaces_is_mixed() {
        let depth = Image::from_pixels(5, 1, vec![1.0, 1.0, 1.5, 2.0, 2.0]).unwrap();
        let borders = Borders::new(&depth, &SegmentMap::filled(5, 1, 0), 0.03);
        let mixed: Vec<bool> = (0..5).map(|column| borders.is_mixed((column, 0))).collect();
        assert_eq!(mixed, [false, false, true, false, false]);
    }

    #[test]
    fn a_floor_seen_at_a_small_angle_is_not_mixed() {
        // A floor, and on it a pillar that begins with pixels of the depth `mixed`.
        let mixed_columns = |mixed| {
            let depth = Image::from_fn(8, 12, |column, row| match column {
                0..5 => 48.0 / (row as f32 + 4.0),
                5 => mixed,
                _ => 2.0,
            });
            let borders = Borders::new(&depth, &SegmentMap::filled(8, 12, 0), 0.03);
            let is_mixed = |column: &usize| (0..12).any(|row| borders.is_mixed((*column, row)));
            (0..8).filter(is_mixed).collect::<Vec<usize>>()
        };
        assert!(mixed_columns(2.0).is_empty());
        assert_eq!(mixed_columns(2.6), [5]);
    }
}
