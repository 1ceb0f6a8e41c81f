//! The places of the frame that the network's levels look at.

/// Size of the frames (height, width) whose grids begin at the first row and column, as in training: those of the
/// paper's protocol, 320×240 pixels with a border of 5 cropped.
const REFERENCE: (usize, usize) = (230, 310);

/// The pixel (row, column) that lies on the grid of every level. It may lie outside.
///
/// Each level looks at every second row and column of the level before. Counted from the frame's corner, these would be
/// others after one row and column more is cropped on each side, and masks would change. So they are counted from the
/// centre: a frame is treated as a larger or smaller crop of a frame of the [`REFERENCE`] size.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Grid {
    row: i64,
    column: i64,
}

impl Grid {
    /// The grid of frames of size `(height, width)`.
    pub fn new((height, width): (usize, usize)) -> Self {
        let place = |size: usize, reference: usize| (size as i64 - reference as i64).div_euclid(2);
        Self { row: place(height, REFERENCE.0), column: place(width, REFERENCE.1) }
    }

    /// The first row and column, 0 or 1, of a map of size `(height, width)` that the next level looks at. The input is
    /// the map of level 0.
    pub fn start(self, level: usize, (height, width): (usize, usize)) -> [usize; 2] {
        let start = |place: i64, size: usize| match size {
            0 | 1 => 0,
            // The pixel's place is halved from level to level: its bits are the starts.
            _ => ((place >> level.min(63)) & 1) as usize,
        };
        [start(self.row, height), start(self.column, width)]
    }

    /// The first row and column of the half-size image at which a cell of `side` × `side` pixels begins.
    pub fn first_cell(self, side: usize) -> [usize; 2] {
        [self.row, self.column].map(|place| (place >> 1).rem_euclid(side as i64) as usize)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cropping_moves_no_grid() {
        // Places of the uncropped frame of 320×241 that the levels look at, and where cells of 8 pixels begin.
        let places = |border: usize| {
            let whole = (241 - 2 * border, 320 - 2 * border);
            let (grid, mut size) = (Grid::new(whole), whole);
            let (mut first, mut step) = ([border as i64; 2], 1);
            let mut places = Vec::new();
            for level in 0..5 {
                let start = grid.start(level, size);
                first = [0, 1].map(|axis| first[axis] + start[axis] as i64 * step);
                size = ((size.0 - start[0]).div_ceil(2), (size.1 - start[1]).div_ceil(2));
                step *= 2;
                places.push(first.map(|first| first.rem_euclid(step)));
            }
            let (start, cell) = (grid.start(0, whole), grid.first_cell(8));
            places.push([0, 1].map(|axis| (border + start[axis] + 2 * cell[axis]) as i64 % 16));
            places
        };
        let uncropped = places(0);
        assert_eq!(uncropped, [[1, 1], [1, 1], [5, 5], [5, 5], [5, 5], [5, 5]]);
        assert!((1..40).all(|border| places(border) == uncropped));
        assert!((0..5).all(|level| Grid::new(REFERENCE).start(level, (9, 9)) == [0, 0]));
    }
}
