//! The height of the floor from place to place: rooms may differ, and the poses of a long walk drift.

use crate::depth_points::{DepthPoints, surface_pieces};
use glam::Vec3;

/// Side of the squares in which the floor has one height, metres.
const SQUARE: f32 = 0.5;
/// Largest difference between neighbouring squares, metres.
const STEP: f32 = 0.06;
/// Pixels between the pieces of surface that are looked at.
const PIXELS: usize = 3;
/// Area of level surface that decides the height of a square, square metres; the neighbours' height has this weight.
const ENOUGH: f32 = 0.01;
/// A piece of surface is level if its normal's z is at least this.
const LEVEL: f32 = 0.95;

/// Level pieces of surface, by square.
pub(crate) struct FloorSamples {
    columns: usize,
    rows: usize,
    /// z and area of pieces.
    squares: Vec<Vec<(f32, f32)>>,
    /// z of the floor in general.
    floor: f32,
}

/// Height of the floor in each square.
#[derive(Clone, Debug)]
pub(crate) struct FloorHeights {
    columns: usize,
    rows: usize,
    heights: Vec<f32>,
}

impl FloorSamples {
    /// For a plan of `size` metres with the floor at `floor`; points are relative to the plan's corner.
    pub(crate) fn new(size: [f32; 2], floor: f32) -> Self {
        let [columns, rows] = size.map(|side| (side / SQUARE).ceil().max(1.0) as usize);
        Self { columns, rows, squares: vec![Vec::new(); columns * rows], floor }
    }

    /// Adds the level surfaces of a view that may be floor.
    pub(crate) fn add(&mut self, points: &DepthPoints) {
        for (point, normal, area) in surface_pieces(points, PIXELS) {
            let is_low = (point.z - self.floor).abs() < 0.4;
            if is_low
                && normal.z >= LEVEL
                && let Some(square) = index(point, self.columns, self.rows)
            {
                self.squares[square].push((point.z, area));
            }
        }
    }

    /// The heights, from the square with the most floor outwards, each near those of its neighbours.
    pub(crate) fn heights(&self) -> FloorHeights {
        let area_near = |samples: &[(f32, f32)], height: f32| -> f32 {
            samples.iter().filter(|(z, _)| (z - height).abs() <= STEP).map(|(_, area)| area).sum()
        };
        let mut heights = vec![f32::NAN; self.squares.len()];
        let start = (0..self.squares.len()).max_by(|one, other| {
            let area = |square: &usize| area_near(&self.squares[*square], self.floor);
            area(one).total_cmp(&area(other)).then(other.cmp(one))
        });
        let mut reached: std::collections::VecDeque<usize> = start.into_iter().collect();
        let mut is_reached = vec![false; self.squares.len()];
        start.into_iter().for_each(|square| is_reached[square] = true);
        while let Some(square) = reached.pop_front() {
            let around: Vec<usize> = self.neighbours(square).collect();
            let known: Vec<f32> =
                around.iter().map(|other| heights[*other]).filter(|height| !height.is_nan()).collect();
            let expected = if known.is_empty() { self.floor } else { known.iter().sum::<f32>() / known.len() as f32 };
            let (mut moment, mut total) = (expected * ENOUGH, ENOUGH);
            for (z, area) in self.squares[square].iter().filter(|(z, _)| (z - expected).abs() <= STEP) {
                (moment, total) = (moment + z * area, total + area);
            }
            heights[square] = moment / total;
            for other in around {
                if !std::mem::replace(&mut is_reached[other], true) {
                    reached.push_back(other);
                }
            }
        }
        FloorHeights { columns: self.columns, rows: self.rows, heights }
    }

    fn neighbours(&self, square: usize) -> impl Iterator<Item = usize> {
        let (column, row) = (square % self.columns, square / self.columns);
        let columns = self.columns;
        [
            (column > 0).then(|| square - 1),
            (column + 1 < self.columns).then_some(square + 1),
            (row > 0).then(|| square - columns),
            (row + 1 < self.rows).then_some(square + columns),
        ]
        .into_iter()
        .flatten()
    }
}

impl FloorHeights {
    /// Height of the floor at a point, by its x and y relative to the plan's corner; `None` outside.
    pub(crate) fn at(&self, point: Vec3) -> Option<f32> {
        index(point, self.columns, self.rows).map(|square| self.heights[square])
    }

    /// The lowest and the highest.
    pub(crate) fn range(&self) -> (f32, f32) {
        let low = self.heights.iter().copied().fold(f32::INFINITY, f32::min);
        (low, self.heights.iter().copied().fold(f32::NEG_INFINITY, f32::max))
    }
}

fn index(point: Vec3, columns: usize, rows: usize) -> Option<usize> {
    let (column, row) = ((point.x / SQUARE).floor(), (point.y / SQUARE).floor());
    let is_inside = column >= 0.0 && row >= 0.0 && column < columns as f32 && row < rows as f32;
    is_inside.then(|| row as usize * columns + column as usize)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn heights_follow_a_slope_and_skip_low_furniture() {
        let mut samples = FloorSamples::new([10.0, 1.0], 0.0);
        for column in 0..20 {
            for row in 0..2 {
                // A slope of 1.5 cm per square, a box of 12 cm in squares 8 and 9, nothing at the end.
                let z = match column {
                    8 | 9 => 0.015 * column as f32 + 0.12,
                    18.. => continue,
                    _ => 0.015 * column as f32,
                };
                samples.squares[row * 20 + column].push((z, 0.2));
            }
        }
        let heights = samples.heights();
        for column in 0..18 {
            let found = heights.at(Vec3::new(0.25 + 0.5 * column as f32, 0.3, 0.0)).unwrap();
            assert!((found - 0.015 * column as f32).abs() < 0.035, "{column}: {found}");
        }
        assert!(heights.at(Vec3::new(9.9, 0.0, 0.0)).unwrap() > 0.2 && heights.at(Vec3::new(10.1, 0.0, 0.0)).is_none());
    }
}
