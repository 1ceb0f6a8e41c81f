//! How surely pairs of pixels show one object.

use crate::SegmentMap;

/// The log-odds that pairs of pixels show one object, on a grid of the frame's pixels.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Affinities {
    /// The frame's column at each column of the grid, increasing.
    pub columns: Vec<u32>,
    /// The frame's row at each row of the grid, increasing.
    pub rows: Vec<u32>,
    /// One entry per offset between the two pixels of a pair.
    pub planes: Vec<AffinityPlane>,
}

/// The log-odds of the pairs at one offset.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct AffinityPlane {
    /// Grid columns from the first pixel of a pair to the second.
    pub right: i32,
    /// Grid rows from the first pixel of a pair to the second, at least 0.
    pub down: i32,
    /// For the first pixel of each pair, `[rows, columns]`, in units of 1 / [`Affinities::UNIT`]. Pairs that leave the grid
    /// have no meaning.
    pub log_odds: Vec<i8>,
}

impl Affinities {
    /// Log-odds are integer multiples of 1 / `UNIT`, so that sums do not depend on their order.
    pub const UNIT: f32 = 16.0;

    /// Log-odds are within ± this: larger ones only say the same more loudly.
    pub const LARGEST: f32 = 6.0;

    /// Rounds log-odds to the unit.
    pub fn quantised(log_odds: f32) -> i8 {
        (log_odds.clamp(-Self::LARGEST, Self::LARGEST) * Self::UNIT).round() as i8
    }

    /// True if the grid lies in a frame of this size (width, height), and every plane covers the grid.
    pub fn fits(&self, (width, height): (usize, usize)) -> bool {
        let lies_in = |places: &[u32], size: usize| {
            places.is_sorted_by(|one, next| one < next) && places.last().is_none_or(|last| (*last as usize) < size)
        };
        let pixels = self.columns.len() * self.rows.len();
        lies_in(&self.columns, width)
            && lies_in(&self.rows, height)
            && self.planes.iter().all(|plane| plane.log_odds.len() == pixels && plane.down >= 0)
    }

    /// The entries of an image of the frame's size at the pixels of the grid, `[rows, columns]`.
    pub fn sampled(&self, image: &SegmentMap) -> Vec<u32> {
        let row = |row: &u32| {
            let pixels = image.row(*row as usize);
            self.columns.iter().map(move |column| pixels[*column as usize])
        };
        self.rows.iter().flat_map(row).collect()
    }
}
