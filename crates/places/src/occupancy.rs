//! From the depth of a map's keyframes to free, occupied and unknown cells.

use crate::clearance::distances;
use crate::columns::{ColumnContent, Columns};
use crate::depth_points::DepthPoints;
use crate::floor::Floor;
use crate::floor_heights::{FloorHeights, FloorSamples};
use crate::floor_seen::FloorSeen;
use crate::free_path::{camera_path, free_path};
use crate::grid::{Cell, GridShape, OccupancyGrid};
use crate::{PlanError, PlanFrame, PlanSettings};
use glam::{DVec2, DVec3, Vec3};
use rayon::prelude::*;
use splatseg_files::MemoryLimit;
use splatseg_geometry::MapView;
use splatseg_objects::DepthView;

/// Views whose points are computed at the same time.
const VIEWS: usize = 32;
/// Pixels between two rays.
const RAYS: usize = 2;
/// Cells around everything that was seen.
const BORDER: f64 = 2.0;
/// Distance from obstacles within which a part of them may hide above a floor that was seen, metres.
const HIDDEN: f64 = 0.3;
/// Space between obstacles that is smaller than this, square metres, has no free cells: a disc of 0.15 m radius.
const GAP: f64 = 0.07;
/// Heights above the floor at which walls are, and furniture hardly is, metres.
const TALL: (f32, f32) = (1.3, 2.0);

/// The grid and what it was made of.
pub(crate) struct Occupancy {
    pub frame: PlanFrame,
    pub grid: OccupancyGrid,
    /// Contents of the column above each cell.
    pub columns: Vec<ColumnContent>,
    /// Height of the floor from place to place, from that of the plan's frame.
    pub floor: FloorHeights,
}

impl Occupancy {
    pub(crate) fn new(map: &MapView<'_>, views: &[DepthView], settings: &PlanSettings) -> Result<Self, PlanError> {
        let settings = settings.validated()?;
        let max_range = settings.max_range as f32;
        let frame = PlanFrame::of_floor(&Floor::find(views, max_range)?).map_err(|_| PlanError::NoFloor)?;
        let shape = shape(views, &frame, &settings)?;
        let corner = shape.origin.extend(frame.floor_height());
        let points = Points { views, frame: &frame, corner, max_range };
        let size = [shape.width, shape.height].map(|cells| (cells as f64 * shape.resolution) as f32);
        let mut samples = FloorSamples::new(size, 0.0);
        points.for_each(|points| samples.add(points));
        let floor = samples.heights();
        let cells = (shape.width, shape.height);
        let resolution = shape.resolution as f32;
        let heights = (settings.min_height as f32, settings.max_height as f32);
        let mut columns = Columns::new(cells, resolution, heights, floor.clone());
        add_gaussians(&mut columns, map, &frame, corner);
        points.for_each(|points| add_points(&mut columns, points));
        let mut seen = FloorSeen::new(cells, resolution);
        points.for_each(|points| {
            seen.add(points, &columns, heights.0);
            add_rays(&mut columns, points);
        });
        let content: Vec<ColumnContent> = (0..shape.len())
            .into_par_iter()
            .map(|cell| columns.content(shape.column_row(cell), heights.1, TALL))
            .collect();
        let mut cells = cells_of(&shape, &content, &seen, &columns);
        remove_gaps(&mut cells, &shape);
        if settings.free_path > 0.0 {
            free_path(&mut cells, &shape, &content, &camera_path(views, &frame), settings.free_path);
        }
        Ok(Self { frame, grid: OccupancyGrid { shape, cells }, columns: content, floor })
    }
}

/// The state of each cell. Near obstacles, rays must have passed above the floor, too: it is also seen below the far
/// side of things whose near side hides how far they reach. And a thing beside the cell must have been seen from there:
/// the far side of a ball may reach above the floor that was seen.
fn cells_of(shape: &GridShape, columns: &[ColumnContent], seen: &FloorSeen, space: &Columns) -> Vec<Cell> {
    let apart = distances(shape, |cell| columns[cell].is_obstacle);
    let is_hidden = |cell: usize| {
        let mut things = shape.beside(cell).filter(|other| columns[*other].is_obstacle).peekable();
        let side = |thing: usize| (shape.center(cell) - shape.center(thing)).as_vec2();
        things.peek().is_some() && !things.any(|thing| space.is_seen_from(shape.column_row(thing), side(thing)))
    };
    let kind = |cell: usize| {
        let (content, near) = (&columns[cell], apart[cell] * shape.resolution <= HIDDEN);
        let is_doubtful = content.is_doubtful || near && !content.is_open_below || is_hidden(cell);
        match (content.is_obstacle, seen.seen[cell] > 0 && !is_doubtful) {
            (true, _) => Cell::Occupied,
            (false, true) => Cell::Free,
            (false, false) => Cell::Unknown,
        }
    };
    (0..shape.len()).map(kind).collect()
}

/// Small space with obstacles all around is a gap in what was seen of a thing, or a hollow of it, and no place for a robot.
fn remove_gaps(cells: &mut [Cell], shape: &GridShape) {
    let mut is_visited = vec![false; cells.len()];
    for start in 0..cells.len() {
        if is_visited[start] || cells[start] == Cell::Occupied {
            continue;
        }
        let size = (shape.width, shape.height);
        let gap = splatseg_geometry::flood_fill(start, size, &mut is_visited, |cell| cells[cell] != Cell::Occupied);
        if gap.len() as f64 * shape.resolution * shape.resolution < GAP {
            gap.into_iter().for_each(|cell| cells[cell] = Cell::Unknown);
        }
    }
}

/// The points of all views, relative to a corner of the plan.
struct Points<'a> {
    views: &'a [DepthView],
    frame: &'a PlanFrame,
    corner: DVec3,
    max_range: f32,
}

impl Points<'_> {
    /// Calls a function for each view, in order.
    fn for_each(&self, mut each: impl FnMut(&DepthPoints)) {
        let transform = self.frame.plan_from_world();
        for views in self.views.chunks(VIEWS) {
            let points: Vec<DepthPoints> =
                views.par_iter().map(|view| DepthPoints::new(view, &transform, self.corner, self.max_range)).collect();
            points.iter().for_each(&mut each);
        }
    }
}

/// The grid around all points near which something was measured.
fn shape(views: &[DepthView], frame: &PlanFrame, settings: &PlanSettings) -> Result<GridShape, PlanError> {
    let near = views.first().ok_or(PlanError::NoKeyframes)?.world_from_camera.translation();
    let near = frame.point_to_plan(near);
    let points = Points { views, frame, corner: near, max_range: settings.max_range as f32 };
    let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    points.for_each(|points| {
        for row in 0..points.height {
            for point in (0..points.width).filter_map(|column| points.at(column, row)) {
                (low, high) = (low.min(point), high.max(point));
            }
        }
    });
    if !low.cmple(high).all() {
        return Err(PlanError::NoFloor);
    }
    let cell = settings.resolution;
    let place = |point: Vec3| DVec2::new(near.x + f64::from(point.x), near.y + f64::from(point.y)) / cell;
    let (first, last) = (place(low).floor() - BORDER, place(high).floor() + BORDER);
    let size = last - first + 1.0;
    let (width, height) = (size.x as usize, size.y as usize);
    // Beyond the columns: content, distances, rooms and searches, per cell.
    let bytes =
        Columns::bytes((width, height), settings.max_height) + 100 * (width as u64).saturating_mul(height as u64);
    if bytes > MemoryLimit::in_force() {
        return Err(PlanError::TooLarge { width, height });
    }
    Ok(GridShape { resolution: cell, origin: first * cell, width, height })
}

/// Marks where the map has a surface.
fn add_gaussians(columns: &mut Columns, map: &MapView<'_>, frame: &PlanFrame, corner: DVec3) {
    let gaussians = map.means.iter().zip(map.radii).zip(map.surfaces);
    for ((mean, radius), _) in gaussians.filter(|(_, surface)| surface.has_place()) {
        let point = frame.point_to_plan(map.origin + mean.as_dvec3()) - corner;
        columns.add_gaussian(point.as_vec3(), radius * map.patch.cover);
    }
}

fn add_points(columns: &mut Columns, points: &DepthPoints) {
    points.edges.iter().for_each(|point| columns.add_point(points.camera, *point));
    let measured =
        (0..points.height).flat_map(|row| (0..points.width).filter_map(move |column| points.at(column, row)));
    measured.for_each(|point| columns.add_point(points.camera, point));
}

fn add_rays(columns: &mut Columns, points: &DepthPoints) {
    for row in (0..points.height).step_by(RAYS) {
        for point in (0..points.width).step_by(RAYS).filter_map(|column| points.at(column, row)) {
            columns.add_ray(points.camera, point);
        }
    }
}
