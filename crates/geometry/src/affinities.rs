//! How surely pairs of pixels show one object.

use crate::{Image, QuarterTurn, SegmentMap};

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
    #[inline]
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

    /// The log-odds in the turned frame. `size` (width, height) is the frame's before the turn.
    #[must_use]
    pub fn turned(&self, turn: QuarterTurn, (width, height): (usize, usize)) -> Self {
        let kept = |places: &[u32]| places.to_vec();
        let reversed = |places: &[u32], size: usize| places.iter().rev().map(|place| size as u32 - 1 - place).collect();
        let (columns, rows) = match turn {
            QuarterTurn::None => (kept(&self.columns), kept(&self.rows)),
            QuarterTurn::Right => (reversed(&self.rows, height), kept(&self.columns)),
            QuarterTurn::Half => (reversed(&self.columns, width), reversed(&self.rows, height)),
            QuarterTurn::Left => (kept(&self.rows), reversed(&self.columns, width)),
        };
        let grid = (self.columns.len(), self.rows.len());
        let planes = self.planes.iter().map(|plane| plane.turned(turn, grid)).collect();
        Self { columns, rows, planes }
    }
}

impl AffinityPlane {
    /// The plane of the turned grid; `grid` is its number of columns and rows before the turn.
    fn turned(&self, turn: QuarterTurn, grid: (usize, usize)) -> Self {
        let (right, down) = turn.vector((self.right, self.down));
        // The offset must not point upwards: then each pair is stored at its other pixel.
        let swaps = down < 0 || (down == 0 && right < 0);
        let (columns, rows) = grid;
        let Ok(log_odds) = Image::from_pixels(columns, rows, self.log_odds.clone()) else { return Self::default() };
        let turned = log_odds.turned(turn);
        if !swaps {
            return Self { right, down, log_odds: turned.into_pixels() };
        }
        let inside = |place: usize, step: i32, size: usize| {
            let place = place as i64 - i64::from(step);
            (0..size as i64).contains(&place).then_some(place as usize)
        };
        let at_other = Image::from_fn(turned.width(), turned.height(), |column, row| {
            let first = inside(column, right, turned.width()).zip(inside(row, down, turned.height()));
            first.map_or(0, |first| turned[first])
        });
        Self { right: -right, down: -down, log_odds: at_other.into_pixels() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    /// The log-odds of every pair inside the grid, by its two pixels in the frame.
    fn pairs(affinities: &Affinities) -> BTreeMap<[(u32, u32); 2], i8> {
        let (columns, rows) = (affinities.columns.len(), affinities.rows.len());
        let mut pairs = BTreeMap::new();
        for plane in &affinities.planes {
            for (index, log_odds) in plane.log_odds.iter().enumerate() {
                let (column, row) = (index % columns, index / columns);
                let (other, below) = (column as i32 + plane.right, row as i32 + plane.down);
                if (0..columns as i32).contains(&other) && (0..rows as i32).contains(&below) {
                    let pixel = |column: usize, row: usize| (affinities.columns[column], affinities.rows[row]);
                    let mut pair = [pixel(column, row), pixel(other as usize, below as usize)];
                    pair.sort_unstable();
                    pairs.insert(pair, *log_odds);
                }
            }
        }
        pairs
    }

    #[test]
    fn turned_pairs_keep_their_log_odds() {
        let (columns, rows) = (vec![1, 3, 5, 7, 8], vec![0, 2, 5]);
        let plane = |(right, down): (i32, i32)| AffinityPlane {
            right,
            down,
            log_odds: (0..15).map(|index| (index * 5 + right + 11 * down) as i8).collect(),
        };
        let planes = [(1, 0), (0, 1), (2, 2), (2, -2), (-2, 2)]
            .map(|(right, down): (i32, i32)| plane(if down < 0 { (-right, -down) } else { (right, down) }));
        let affinities = Affinities { columns, rows, planes: planes.to_vec() };
        let size = (9, 6);
        for turn in QuarterTurn::ALL {
            let turned = affinities.turned(turn, size);
            assert!(turned.fits(turn.size(size)), "{turn:?}");
            let moved = |(column, row): (u32, u32)| {
                let (column, row) = turn.pixel((column as usize, row as usize), size);
                (column as u32, row as u32)
            };
            let expected = pairs(&affinities).into_iter().map(|(pair, log_odds)| {
                let mut pair = pair.map(moved);
                pair.sort_unstable();
                (pair, log_odds)
            });
            assert_eq!(pairs(&turned), expected.collect(), "{turn:?}");
        }
    }
}
