//! The grid of a plan: which cells are free.

use glam::DVec2;
use serde::{Deserialize, Serialize};

/// State of a cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Cell {
    /// Its floor was seen, and nothing stands in it at the heights of the robot.
    Free,
    /// Something stands in it.
    Occupied,
    /// Not seen.
    Unknown,
}

/// Place and size of a grid. Cell 0 is the one at the lowest x and y; x grows within a row, y from row to row.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct GridShape {
    /// Side of a cell, metres.
    pub resolution: f64,
    /// The corner of cell 0 with the lowest x and y, in the plan's coordinates, metres. A multiple of the resolution.
    pub origin: DVec2,
    /// Cells along x.
    pub width: usize,
    /// Cells along y.
    pub height: usize,
}

/// Free, occupied and unknown cells, as in `nav_msgs/OccupancyGrid`.
#[derive(Clone, Debug, PartialEq)]
pub struct OccupancyGrid {
    /// Place and size.
    pub shape: GridShape,
    /// Row-major, `[height, width]`, from the lowest y.
    pub cells: Vec<Cell>,
}

impl GridShape {
    /// Number of cells.
    pub fn len(&self) -> usize {
        self.width * self.height
    }

    /// True if there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The cell at a place, in the plan's coordinates; `None` outside.
    pub fn cell_at(&self, place: DVec2) -> Option<usize> {
        let cell = ((place - self.origin) / self.resolution).floor();
        let is_inside = cell.cmpge(DVec2::ZERO).all() && cell.x < self.width as f64 && cell.y < self.height as f64;
        is_inside.then(|| cell.y as usize * self.width + cell.x as usize)
    }

    /// Column and row of a cell.
    pub fn column_row(&self, cell: usize) -> (usize, usize) {
        (cell % self.width, cell / self.width)
    }

    /// The centre of a cell, in the plan's coordinates.
    pub fn center(&self, cell: usize) -> DVec2 {
        let (column, row) = self.column_row(cell);
        self.origin + (DVec2::new(column as f64, row as f64) + 0.5) * self.resolution
    }

    /// The four neighbours of a cell that are in the grid.
    pub(crate) fn beside(&self, cell: usize) -> impl Iterator<Item = usize> + use<> {
        let (column, row) = self.column_row(cell);
        let (width, height) = (self.width, self.height);
        [
            (column > 0).then(|| cell - 1),
            (column + 1 < width).then_some(cell + 1),
            (row > 0).then(|| cell - width),
            (row + 1 < height).then_some(cell + width),
        ]
        .into_iter()
        .flatten()
    }

    /// The cells whose centre is at most `distance` metres from a place.
    pub(crate) fn within(&self, place: DVec2, distance: f64) -> Vec<usize> {
        let reach = (distance / self.resolution).ceil() + 1.0;
        let middle = ((place - self.origin) / self.resolution).floor();
        let range = |middle: f64, count: usize| {
            let low = (middle - reach).clamp(0.0, count as f64) as usize;
            low..((middle + reach + 1.0).clamp(0.0, count as f64) as usize)
        };
        let rows = range(middle.y, self.height);
        let columns = range(middle.x, self.width);
        let all = rows.flat_map(|row| columns.clone().map(move |column| row * self.width + column));
        all.filter(|cell| self.center(*cell).distance(place) <= distance).collect()
    }
}

impl OccupancyGrid {
    /// The state of the cell at a place in the plan's coordinates; unknown outside the grid.
    pub fn at(&self, place: DVec2) -> Cell {
        self.shape.cell_at(place).map_or(Cell::Unknown, |cell| self.cells[cell])
    }

    /// Number of cells of a kind.
    pub fn count(&self, kind: Cell) -> usize {
        self.cells.iter().filter(|cell| **cell == kind).count()
    }

    /// Area of the cells of a kind, square metres.
    pub fn area(&self, kind: Cell) -> f64 {
        self.count(kind) as f64 * self.shape.resolution * self.shape.resolution
    }

    /// The values of a `nav_msgs/OccupancyGrid`: 0 free, 100 occupied, -1 unknown, in the grid's order.
    pub fn ros_values(&self) -> Vec<i8> {
        let value = |cell: &Cell| match cell {
            Cell::Free => 0,
            Cell::Occupied => 100,
            Cell::Unknown => -1,
        };
        self.cells.iter().map(value).collect()
    }
}
