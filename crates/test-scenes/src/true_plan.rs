//! The exact plan of a scene, to compare grids of free space with.

use glam::{DVec2, DVec3, Vec2};
use splatseg_dataset::{Scene, SyntheticScene};

/// Heights between which things are obstacles, as by default in plans, metres.
pub(crate) const HEIGHTS: (f32, f32) = (0.1, 1.8);
/// Points along a side of a cell that are tested.
const POINTS: usize = 6;
/// The floor counts as seen up to this depth, metres.
const MAX_RANGE: f32 = 5.0;

/// Where something stands in a scene whose geometry is known exactly.
pub trait ExactPlan {
    /// True if something stands at a place at the heights of obstacles.
    fn is_occupied(&self, place: Vec2) -> bool;

    /// True in rooms and doorways.
    fn is_in_house(&self, place: Vec2) -> bool;

    /// The number of the room at a place.
    fn room_at(&self, place: Vec2) -> Option<usize>;
}

impl ExactPlan for SyntheticScene {
    fn is_occupied(&self, place: Vec2) -> bool {
        Self::is_occupied(self, place, HEIGHTS)
    }

    /// A room is at most a wall's thickness away.
    fn is_in_house(&self, place: Vec2) -> bool {
        let steps = [Vec2::ZERO, Vec2::X, Vec2::NEG_X, Vec2::Y, Vec2::NEG_Y];
        let rooms: Vec<usize> = steps.into_iter().filter_map(|step| Self::room_at(self, place + step * 0.17)).collect();
        Self::room_at(self, place).is_some() || rooms.iter().any(|room| *room != rooms[0])
    }

    fn room_at(&self, place: Vec2) -> Option<usize> {
        Self::room_at(self, place)
    }
}

/// The true state of a cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TrueCell {
    /// No part of it is in a thing or a wall.
    pub is_free: bool,
    /// Its centre is in a thing or a wall.
    pub is_inside: bool,
    /// The floor at its centre was in view of a frame.
    pub is_seen: bool,
    /// The room of its centre.
    pub room: Option<usize>,
}

/// Counts of a grid's cells compared with the truth.
#[derive(Clone, Copy, Debug, Default)]
pub struct PlanErrors {
    /// Cells that are free in the grid and in truth.
    pub both: usize,
    /// Truly free cells, seen, that the grid does not have as free.
    pub missed: usize,
    /// Cells that are free in the grid, and not in truth or not in any room.
    pub wrong: usize,
    /// Of these, cells whose centre is in a thing or a wall.
    pub inside: usize,
    /// Cells that are free in the grid although their floor was not in view of any frame.
    pub unseen: usize,
}

/// The truth of each cell of a grid: row-major from its lowest corner `origin`, metres. Every `stride`-th frame of `frames`,
/// whose depth is exact, was recorded.
pub fn true_cells(
    exact: &dyn ExactPlan,
    (frames, stride): (&dyn Scene, usize),
    origin: DVec2,
    (width, height): (usize, usize),
    side: f64,
) -> Vec<TrueCell> {
    let mut cells = Vec::with_capacity(width * height);
    for row in 0..height {
        for column in 0..width {
            let corner = origin + DVec2::new(column as f64, row as f64) * side;
            let center = (corner + 0.5 * side).as_vec2();
            let part = |index: usize| (index as f64 + 0.5) / POINTS as f64 * side;
            let at = |index: usize| (corner + DVec2::new(part(index % POINTS), part(index / POINTS))).as_vec2();
            let is_free = exact.is_in_house(center) && (0..POINTS * POINTS).all(|index| !exact.is_occupied(at(index)));
            let is_inside = exact.is_occupied(center);
            cells.push(TrueCell { is_free, is_inside, is_seen: false, room: exact.room_at(center) });
        }
    }
    mark_seen((frames, stride), origin, width, side, &mut cells);
    cells
}

fn mark_seen((frames, stride): (&dyn Scene, usize), origin: DVec2, width: usize, side: f64, cells: &mut [TrueCell]) {
    for frame in (0..frames.frame_count()).step_by(stride.max(1)) {
        let frame = frames.read_frame(frame).unwrap();
        let (columns, rows) = frame.depth().size();
        for (index, cell) in cells.iter_mut().enumerate().filter(|(_, cell)| cell.is_free && !cell.is_seen) {
            let place = origin + (DVec2::new((index % width) as f64, (index / width) as f64) + 0.5) * side;
            let point = frame.world_from_camera().to_camera(DVec3::new(place.x, place.y, 0.0));
            let Some(pixel) = frame.intrinsics().project(point) else { continue };
            let (column, row) = (pixel.x.round(), pixel.y.round());
            let is_in_view = column >= 0.0 && row >= 0.0 && column < columns as f32 && row < rows as f32;
            if is_in_view && point.z <= MAX_RANGE {
                // Pixels of the floor far away are long.
                let measured = frame.depth()[(column as usize, row as usize)];
                cell.is_seen = (measured - point.z).abs() < 0.02 + 0.03 * point.z;
            }
        }
    }
}

impl PlanErrors {
    /// Compares a grid's free cells with the truth.
    pub fn new(is_free: impl IntoIterator<Item = bool>, truth: &[TrueCell]) -> Self {
        let mut errors = Self::default();
        for (is_free, truth) in is_free.into_iter().zip(truth) {
            match (is_free, truth.is_free) {
                (true, true) => errors.both += 1,
                (false, true) => errors.missed += usize::from(truth.is_seen),
                (true, false) => errors.wrong += 1,
                (false, false) => {}
            }
            errors.inside += usize::from(is_free && truth.is_inside);
            errors.unseen += usize::from(is_free && truth.is_free && !truth.is_seen);
        }
        errors
    }

    /// Intersection over union of the free cells whose floor was seen.
    pub fn iou(&self) -> f64 {
        self.both as f64 / (self.both + self.missed + self.wrong).max(1) as f64
    }
}
