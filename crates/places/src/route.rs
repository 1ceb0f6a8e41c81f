//! Routes of a robot on the free cells, by A*.

use crate::clearance::clearances;
use crate::grid::{Cell, OccupancyGrid};
use crate::{FloorPlan, RouteError};
use glam::DVec2;
use serde::{Deserialize, Serialize};
use std::cmp::Ordering;
use std::collections::BinaryHeap;

/// Largest radius of a robot, metres.
const MAX_RADIUS: f64 = 5.0;
/// Start and end may be this far from a free place, metres: a person points at a chair, or a robot stands beside a wall.
const SNAP: f64 = 0.6;
/// Closer than this to its radius, a way costs more, metres.
const COMFORT: f64 = 0.3;
/// How much more, at most.
const COMFORT_COST: f64 = 2.0;

/// A way on the plan.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Route {
    /// Its corners from start to end, in the plan's coordinates, metres. The robot goes straight from each to the next.
    pub points: Vec<DVec2>,
    /// Its length, metres.
    pub length_m: f64,
    /// The least distance of its centre line from anything that is not known to be free, metres: at least the radius.
    pub clearance_m: f64,
    /// Radius of the robot, metres.
    pub radius_m: f64,
}

/// The cells in which the centre of a robot may be.
pub(crate) struct RoutePlanner<'a> {
    pub grid: &'a OccupancyGrid,
    clearances: Vec<f64>,
    /// Radius of the robot, metres.
    pub radius: f64,
}

impl FloorPlan {
    /// The place nearest to the middle of a room, and in the room, in which a robot of this radius, metres, has space: the
    /// middle may be under a table. In the plan's coordinates; `None` if there is none, or no such room.
    ///
    /// # Errors
    /// [`RouteError::Radius`].
    pub fn free_place_in_room(&self, room: u32, radius: f64) -> Result<Option<DVec2>, RouteError> {
        let planner = RoutePlanner::new(self.grid(), radius)?;
        let Some(room) = self.rooms().iter().find(|other| other.id == room) else { return Ok(None) };
        let in_room = (0..self.grid().shape.len()).filter(|cell| self.room_of_cell(*cell) == room.id);
        Ok(planner.nearest_of(in_room, room.middle).map(|cell| self.grid().shape.center(cell)))
    }
}

/// A cell to be looked at, the cheapest first.
#[derive(PartialEq)]
struct Open {
    cost: f64,
    cell: usize,
}

impl Eq for Open {}

impl Ord for Open {
    fn cmp(&self, other: &Self) -> Ordering {
        other.cost.total_cmp(&self.cost).then_with(|| other.cell.cmp(&self.cell))
    }
}

impl PartialOrd for Open {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl<'a> RoutePlanner<'a> {
    pub(crate) fn new(grid: &'a OccupancyGrid, radius: f64) -> Result<Self, RouteError> {
        if !(0.0..=MAX_RADIUS).contains(&radius) {
            return Err(RouteError::Radius(radius));
        }
        let clearances = clearances(&grid.shape, |cell| grid.cells[cell] != Cell::Free);
        Ok(Self { grid, clearances, radius })
    }

    /// True if the robot has space with its centre in a cell.
    pub(crate) fn has_space(&self, cell: usize) -> bool {
        self.grid.cells[cell] == Cell::Free && self.clearances[cell] >= self.radius
    }

    /// Free distance around a cell's centre, metres.
    pub(crate) fn clearance(&self, cell: usize) -> f64 {
        self.clearances[cell]
    }

    /// The cell nearest to a place in which the robot has space.
    fn nearest(&self, place: DVec2) -> Result<usize, RouteError> {
        let shape = &self.grid.shape;
        let mut near: Vec<usize> = if place.is_finite() { shape.within(place, SNAP) } else { Vec::new() };
        near.extend(shape.cell_at(place));
        let nearest = self.nearest_of(near.into_iter(), place);
        nearest.ok_or(RouteError::NotFree { place, radius: self.radius, within: SNAP })
    }

    /// The one of these cells nearest to a place in which the robot has space.
    fn nearest_of(&self, cells: impl Iterator<Item = usize>, place: DVec2) -> Option<usize> {
        let apart = |cell: &usize| self.grid.shape.center(*cell).distance_squared(place);
        let free = cells.filter(|cell| self.has_space(*cell));
        free.min_by(|one, other| apart(one).total_cmp(&apart(other)).then(one.cmp(other)))
    }

    /// The cheapest way between two places, in the plan's coordinates.
    pub(crate) fn route(&self, from: DVec2, to: DVec2) -> Result<Route, RouteError> {
        let (start, end) = (self.nearest(from)?, self.nearest(to)?);
        let cells = self.search(start, end).ok_or(RouteError::NoWay { from, to, radius: self.radius })?;
        let shape = &self.grid.shape;
        let points: Vec<DVec2> = self.straightened(&cells).into_iter().map(|cell| shape.center(cell)).collect();
        // The sum of nothing would be -0.
        let length_m = points.windows(2).fold(0.0, |length, pair| length + pair[0].distance(pair[1]));
        let clearance_m = points
            .windows(2)
            .flat_map(|pair| self.cells_between(pair[0], pair[1]))
            .chain([start, end])
            .map(|cell| self.clearances[cell])
            .fold(f64::INFINITY, f64::min);
        Ok(Route { points, length_m, clearance_m, radius_m: self.radius })
    }

    /// The cells of the cheapest way.
    fn search(&self, start: usize, end: usize) -> Option<Vec<usize>> {
        let shape = &self.grid.shape;
        let goal = shape.center(end);
        let ahead = |cell: usize| shape.center(cell).distance(goal);
        let mut costs = vec![f64::INFINITY; shape.len()];
        let mut from = vec![usize::MAX; shape.len()];
        let mut is_done = vec![false; shape.len()];
        let mut open = BinaryHeap::from([Open { cost: ahead(start), cell: start }]);
        costs[start] = 0.0;
        while let Some(Open { cell, .. }) = open.pop() {
            if std::mem::replace(&mut is_done[cell], true) {
                continue;
            }
            if cell == end {
                let back = std::iter::successors(Some(end), |cell| (*cell != start).then(|| from[*cell]));
                let mut cells: Vec<usize> = back.collect();
                cells.reverse();
                return Some(cells);
            }
            for (next, step) in self.steps(cell) {
                let cost = costs[cell] + step * shape.resolution * self.cost_factor(next);
                if cost < costs[next] {
                    (costs[next], from[next]) = (cost, cell);
                    open.push(Open { cost: cost + ahead(next), cell: next });
                }
            }
        }
        None
    }

    /// The neighbours in which the robot has space, and how far they are, in cells. It does not cut corners.
    fn steps(&self, cell: usize) -> Vec<(usize, f64)> {
        let shape = &self.grid.shape;
        let (column, row) = shape.column_row(cell);
        let at = |right: isize, up: isize| {
            let (column, row) = (column.checked_add_signed(right)?, row.checked_add_signed(up)?);
            let is_inside = column < shape.width && row < shape.height;
            let cell = row * shape.width + column;
            (is_inside && self.has_space(cell)).then_some(cell)
        };
        let straight = [(1, 0), (0, 1), (-1, 0), (0, -1)].into_iter().filter_map(|(right, up)| at(right, up));
        let diagonal = [(1, 1), (-1, 1), (-1, -1), (1, -1)].into_iter().filter_map(|(right, up)| {
            at(right, 0)?;
            at(0, up)?;
            at(right, up)
        });
        let diagonal = diagonal.map(|cell| (cell, std::f64::consts::SQRT_2));
        straight.map(|cell| (cell, 1.0)).chain(diagonal).collect()
    }

    fn cost_factor(&self, cell: usize) -> f64 {
        let spare = (self.clearances[cell] - self.radius) / COMFORT;
        1.0 + COMFORT_COST * (1.0 - spare).clamp(0.0, 1.0)
    }

    /// The corners that are left when straight ways that are as free replace the steps.
    fn straightened(&self, cells: &[usize]) -> Vec<usize> {
        let shape = &self.grid.shape;
        let mut corners: Vec<usize> = cells.first().copied().into_iter().collect();
        let mut from = 0;
        while from + 1 < cells.len() {
            // A longer straight way must not come closer to obstacles than the steps do, within comfort.
            let least = |to: usize| {
                let steps = cells[from..=to].iter().map(|cell| self.clearances[*cell]);
                steps.fold(self.radius + COMFORT, f64::min).max(self.radius)
            };
            let is_free = |to: usize| {
                let least = least(to);
                let mut between = self.cells_between(shape.center(cells[from]), shape.center(cells[to])).into_iter();
                between.all(|cell| self.has_space(cell) && self.clearances[cell] >= least - 1e-9)
            };
            let mut to = from + 1;
            while to + 1 < cells.len() && is_free(to + 1) {
                to += 1;
            }
            corners.push(cells[to]);
            from = to;
        }
        corners
    }

    /// The cells on a straight way, at distances of a fifth of a cell.
    fn cells_between(&self, from: DVec2, to: DVec2) -> Vec<usize> {
        let shape = &self.grid.shape;
        let steps = (from.distance(to) / shape.resolution * 5.0).ceil().max(1.0) as usize;
        let at = |step: usize| shape.cell_at(from.lerp(to, step as f64 / steps as f64));
        let mut cells: Vec<usize> = (0..=steps).filter_map(at).collect();
        cells.dedup();
        cells
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::GridShape;

    /// Cells of 0.1 m, 40 in a row, free but for a table in the middle.
    fn around_a_table() -> OccupancyGrid {
        let shape = GridShape { origin: DVec2::ZERO, resolution: 0.1, width: 40, height: 40 };
        let is_table = |cell: usize| (shape.center(cell) - DVec2::splat(2.0)).abs().max_element() < 1.0;
        let cells = (0..shape.len()).map(|cell| if is_table(cell) { Cell::Occupied } else { Cell::Free }).collect();
        OccupancyGrid { shape, cells }
    }

    #[test]
    fn the_nearest_free_place_may_be_farther_than_a_robot_is_moved() {
        let grid = around_a_table();
        let planner = RoutePlanner::new(&grid, 0.2).unwrap();
        let middle = DVec2::splat(2.0);
        planner.nearest(middle).unwrap_err();
        let right = (0..grid.shape.len()).filter(|cell| grid.shape.center(*cell).x > 2.0);
        let place = grid.shape.center(planner.nearest_of(right, middle).unwrap());
        assert!(place.x > 2.0 && (1.1..1.4).contains(&place.distance(middle)), "{place}");
        assert_eq!(planner.nearest_of(std::iter::empty(), middle), None);
    }

    #[test]
    fn a_way_to_the_same_place_has_no_length() {
        let grid = around_a_table();
        let place = DVec2::splat(0.5);
        let route = RoutePlanner::new(&grid, 0.2).unwrap().route(place, place).unwrap();
        assert_eq!((route.points.len(), route.length_m), (1, 0.0));
        assert!(route.length_m.is_sign_positive());
    }
}
