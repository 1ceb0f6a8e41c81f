//! Places from which a robot faces an object.

use crate::RouteError;
use crate::footprints::Footprint;
use crate::grid::{Cell, OccupancyGrid};
use crate::route::RoutePlanner;
use glam::DVec2;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

/// Distance between the robot's edge and the object that is best, metres.
const BEST_GAP: f64 = 0.25;
/// Largest distance between its edge and the object, metres.
const LARGEST_GAP: f64 = 1.0;
/// Places that are returned are at least this far apart, metres.
const APART: f64 = 0.4;
/// At most this many are returned.
const MOST: usize = 8;

/// A place for a robot, and where it looks.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ApproachPoint {
    /// Where the robot's centre stands, in the plan's coordinates, metres.
    pub place: DVec2,
    /// Direction to the object's nearest part, radians, counter-clockwise from x.
    pub yaw: f64,
    /// Distance from the centre to the object's footprint, metres.
    pub distance_m: f64,
    /// Free distance around the centre, metres.
    pub clearance_m: f64,
}

/// Free places near an object from which nothing hides it, the best first.
pub(crate) fn approach_points(
    planner: &RoutePlanner<'_>,
    footprint: &Footprint,
) -> Result<Vec<ApproachPoint>, RouteError> {
    let (grid, radius) = (planner.grid, planner.radius);
    let shape = &grid.shape;
    let own: BTreeSet<usize> = footprint.cells.iter().copied().collect();
    let reach = radius + LARGEST_GAP;
    let nearby: BTreeSet<usize> = edge(footprint, grid)
        .into_iter()
        .flat_map(|cell| shape.within(shape.center(cell), reach))
        .filter(|cell| planner.has_space(*cell) && !own.contains(cell))
        .collect();
    let edge: Vec<DVec2> = edge(footprint, grid).into_iter().map(|cell| shape.center(cell)).collect();
    let mut found: Vec<(f64, ApproachPoint)> = nearby
        .into_iter()
        .filter_map(|cell| {
            let place = shape.center(cell);
            let distance = |point: &DVec2| point.distance(place);
            let nearest = edge.iter().min_by(|one, other| distance(one).total_cmp(&distance(other)))?;
            let distance_m = (distance(nearest) - 0.5 * shape.resolution).max(0.0);
            let sees = distance_m <= reach && is_in_sight(grid, &own, place, *nearest);
            let way = *nearest - place;
            let clearance_m = planner.clearance(cell);
            let point = ApproachPoint { place, yaw: way.y.atan2(way.x), distance_m, clearance_m };
            let cost = (distance_m - radius - BEST_GAP).abs() - 0.3 * (clearance_m - radius).min(0.3);
            sees.then_some((cost, point))
        })
        .collect();
    found.sort_by(|(one, _), (other, _)| one.total_cmp(other));
    let mut points: Vec<ApproachPoint> = Vec::new();
    for (_, point) in found {
        if points.len() < MOST && points.iter().all(|other| other.place.distance(point.place) >= APART) {
            points.push(point);
        }
    }
    if points.is_empty() {
        return Err(RouteError::NoApproach { id: footprint.id, radius, within: reach });
    }
    Ok(points)
}

/// The cells of a footprint with a neighbour outside it.
fn edge(footprint: &Footprint, grid: &OccupancyGrid) -> Vec<usize> {
    let is_own = |cell: usize| footprint.cells.binary_search(&cell).is_ok();
    let is_edge = |cell: &usize| {
        let mut beside = grid.shape.beside(*cell);
        beside.any(|other| !is_own(other)) || grid.shape.beside(*cell).count() < 4
    };
    footprint.cells.iter().copied().filter(is_edge).collect()
}

/// True if all cells between a place and a point of the object are free or the object's, up to those beside it: the
/// object's edge is not known to a cell.
fn is_in_sight(grid: &OccupancyGrid, own: &BTreeSet<usize>, place: DVec2, point: DVec2) -> bool {
    let shape = &grid.shape;
    let steps = (place.distance(point) / shape.resolution * 3.0).ceil().max(1.0) as usize;
    (0..=steps).all(|step| {
        let at = place.lerp(point, step as f64 / steps as f64);
        let is_near = at.distance(point) <= 2.0 * shape.resolution;
        is_near || shape.cell_at(at).is_some_and(|cell| grid.cells[cell] == Cell::Free || own.contains(&cell))
    })
}
