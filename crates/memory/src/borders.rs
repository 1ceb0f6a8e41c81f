//! Borders of segments and surfaces in a frame.

use rayon::prelude::*;
use splatseg_geometry::{CowImage, Image, SegmentMap, distance_transform};

/// Maximum distance to a border, pixels; larger distances are set to it.
pub(crate) const MAX_DISTANCE: u32 = 32;

/// Bits for the kind of a pixel.
const MIXED: u8 = 1;
const BORDER: u8 = 2;

/// The borders of a frame: pixels beside a pixel of another segment or across a depth edge.
#[derive(Clone, Debug)]
pub(crate) struct Borders {
    kinds: Image<u8>,
    distances: Vec<u32>,
}

impl Borders {
    /// Finds the borders. Depths are in metres, 0 where missing. Neighbours whose depths differ by more than the
    /// fraction `tolerance` are on two surfaces.
    pub fn new(depth: &CowImage<'_, f32>, segments: &SegmentMap, tolerance: f32) -> Self {
        let (width, height) = depth.size();
        let mut kinds = Image::filled(width, height, 0);
        kinds.pixels_mut().par_chunks_mut(width.max(1)).enumerate().for_each(|(row, kinds)| {
            for (column, kind) in kinds.iter_mut().enumerate() {
                *kind = kind_of(depth, segments, (column, row), tolerance);
            }
        });
        let distances = distance_transform((width, height), |index| kinds.pixels()[index] & BORDER != 0);
        Self { kinds, distances }
    }

    /// True if a pixel's depth may be a mixture of a nearer and a farther surface: it has depth edges to a nearer and
    /// to a farther neighbour, and does not lie on a slanted plane with them.
    pub fn is_mixed(&self, at: (usize, usize)) -> bool {
        self.kinds[at] & MIXED != 0
    }

    /// Number of steps along rows and columns to the nearest border, at most [`MAX_DISTANCE`]; 0 on a border.
    pub fn distance(&self, (column, row): (usize, usize)) -> u32 {
        self.distances[row * self.kinds.width() + column].min(MAX_DISTANCE)
    }
}

fn kind_of(depth: &CowImage<'_, f32>, segments: &SegmentMap, (column, row): (usize, usize), tolerance: f32) -> u8 {
    let (width, height) = depth.size();
    let (own, segment) = (depth[(column, row)], segments[(column, row)]);
    let (mut nearer, mut farther, mut border) = (false, false, false);
    let mut look = |at: (usize, usize)| {
        border |= segments[at] != segment;
        let other = depth[at];
        if own > 0.0 && other > 0.0 {
            let limit = tolerance * own.min(other);
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
    let mixed = if nearer && farther && !is_on_a_plane(depth, (column, row), tolerance) { MIXED } else { 0 };
    if border || nearer || farther { mixed | BORDER } else { mixed }
}

/// True if a pixel continues the surface on one side in its row and on one side in its column. A surface seen at a
/// small angle has depth edges on both sides of each pixel, but along rows and columns its inverse depth is linear.
fn is_on_a_plane(depth: &CowImage<'_, f32>, (column, row): (usize, usize), tolerance: f32) -> bool {
    let inverse = |by: (isize, isize), steps: isize| {
        let at = (column.checked_add_signed(steps * by.0)?, row.checked_add_signed(steps * by.1)?);
        let is_inside = at.0 < depth.width() && at.1 < depth.height();
        (is_inside && depth[at] > 0.0).then(|| 1.0 / depth[at])
    };
    let own = 1.0 / depth[(column, row)];
    let continues = |by| {
        let expected = inverse(by, 1).zip(inverse(by, 2)).map(|(near, far)| 2.0 * near - far);
        expected.is_some_and(|expected| (expected - own).abs() <= tolerance * own)
    };
    (continues((1, 0)) || continues((-1, 0))) && (continues((0, 1)) || continues((0, -1)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    #[test]
    fn distances_count_steps_to_segments_and_surfaces() {
        let segments = SegmentMap::from_fn(9, 1, |column, _| u32::from(column >= 7));
        let depth = Image::from_fn(9, 1, |column, _| if column < 2 { 1.0 } else { 2.0 });
        let borders = Borders::new(&depth, &segments, 0.03);
        let found: Vec<u32> = (0..9).map(|column| borders.distance((column, 0))).collect();
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
        // A floor with a pillar whose edge pixels have the depth `mixed`.
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

    /// The pixel at offset `by`, if it is in the image.
    fn beside(size: (usize, usize), at: (usize, usize), by: (isize, isize)) -> Option<(usize, usize)> {
        let at = (at.0.checked_add_signed(by.0)?, at.1.checked_add_signed(by.1)?);
        (at.0 < size.0 && at.1 < size.1).then_some(at)
    }

    /// Returns whether a pixel is mixed and whether it is a border, by the definitions above.
    fn by_definition(depth: &Image<f32>, segments: &SegmentMap, at: (usize, usize), edge: f32) -> (bool, bool) {
        const STEPS: [(isize, isize); 4] = [(1, 0), (-1, 0), (0, 1), (0, -1)];
        let own = depth[at];
        let neighbours = || STEPS.into_iter().filter_map(|by| beside(depth.size(), at, by));
        let measured = neighbours().map(|at| depth[at]).filter(|other| own > 0.0 && *other > 0.0);
        let ratios: Vec<f32> = measured.map(|other| (other - own) / other.min(own)).collect();
        let (nearer, farther) = (ratios.iter().any(|ratio| *ratio < -edge), ratios.iter().any(|ratio| *ratio > edge));
        let continues = |(x, y): (isize, isize)| {
            let inverse = |steps| beside(depth.size(), at, (steps * x, steps * y)).map(|at| 1.0 / depth[at]);
            let ahead = inverse(1).zip(inverse(2)).map(|(one, two)| 2.0 * one - two);
            ahead.is_some_and(|ahead| (ahead * own - 1.0).abs() <= edge)
        };
        let is_plane = (continues(STEPS[0]) || continues(STEPS[1])) && (continues(STEPS[2]) || continues(STEPS[3]));
        let is_other = neighbours().any(|at_other| segments[at_other] != segments[at]);
        (nearer && farther && !is_plane, is_other || nearer || farther)
    }

    #[test]
    fn borders_and_mixed_pixels_match_the_definition() {
        let mut random = ChaCha8Rng::seed_from_u64(5);
        let (mut mixed, mut slanted) = (0, 0);
        for trial in 0..300 {
            let size = (random.random_range(1..14), random.random_range(1..12));
            let slope: [f32; 2] = std::array::from_fn(|_| random.random_range(-0.08..0.08));
            let noise = [0.0, 0.02, 0.3][trial % 3];
            let depth = Image::from_fn(size.0, size.1, |column, row| {
                let inverse = 1.0 + slope[0] * column as f32 + slope[1] * row as f32;
                let is_missing = random.random_range(0..12) == 0;
                if is_missing || inverse < 0.1 { 0.0 } else { (1.0 + random.random_range(-noise..=noise)) / inverse }
            });
            let parts = random.random_range(1..4);
            let segments = SegmentMap::from_fn(size.0, size.1, |column, row| ((column + row / 2) / 5 % parts) as u32);
            let borders = Borders::new(&depth, &segments, 0.05);
            let mut is_border = Image::filled(size.0, size.1, false);
            for at in (0..size.0).flat_map(|column| (0..size.1).map(move |row| (column, row))) {
                let (is_mixed, found) = by_definition(&depth, &segments, at, 0.05);
                assert_eq!(borders.is_mixed(at), is_mixed, "{at:?} of {depth:?}");
                is_border[at] = found;
                mixed += usize::from(is_mixed);
                slanted += usize::from(found && !is_mixed && noise == 0.0);
            }
            for at in (0..size.0).flat_map(|column| (0..size.1).map(move |row| (column, row))) {
                let places = (0..size.0).flat_map(|column| (0..size.1).map(move |row| (column, row)));
                let steps = places
                    .filter(|place| is_border[*place])
                    .map(|place| place.0.abs_diff(at.0) + place.1.abs_diff(at.1));
                assert_eq!(borders.distance(at) as usize, steps.min().unwrap_or(32).min(32), "{at:?}");
            }
        }
        assert!(mixed > 1000 && slanted > 1000, "{mixed} {slanted}");
    }

    #[test]
    fn neighbours_that_differ_by_the_limit_itself_are_on_one_surface() {
        for (depths, border) in [([1.0, 1.5, 1.5], false), ([1.5, 1.0, 1.0], false), ([1.0, 1.501, 1.501], true)] {
            let borders =
                Borders::new(&Image::from_pixels(3, 1, depths.to_vec()).unwrap(), &SegmentMap::filled(3, 1, 0), 0.5);
            assert_eq!([0, 1].map(|column| borders.distance((column, 0)) == 0), [border; 2], "{depths:?}");
        }
    }

    #[test]
    fn distances_end_at_the_largest() {
        for (width, height) in [(80, 1), (1, 80)] {
            let segments = SegmentMap::from_fn(width, height, |column, row| u32::from(column + row >= 40));
            let borders = Borders::new(&Image::filled(width, height, 1.0), &segments, 0.03);
            for step in 0..80 {
                let at = if height == 1 { (step, 0) } else { (0, step) };
                let expected = if step < 40 { 39 - step } else { step - 40 };
                assert_eq!(borders.distance(at) as usize, expected.min(32));
            }
        }
    }
}
