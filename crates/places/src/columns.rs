//! The space above the floor according to rays of depth images, in columns of small boxes.

use crate::floor_heights::FloorHeights;
use glam::{Vec2, Vec3};
use std::f32::consts::TAU;

/// Height of a box, metres.
const BOX: f32 = 0.1;
/// Columns reach at least this high above the floor, metres, to tell walls from furniture.
const LEAST_TOP: f32 = 2.0;
/// Columns of a block along x and y.
const BLOCK: usize = 16;
/// A ray says nothing about the last part before the surface, metres plus a share of its length: depth is not exact.
const MARGIN: (f32, f32) = (0.03, 0.01);
/// Rays that have passed a box that is open.
const OPEN: u16 = 4;
/// Up to this height above the lowest one of obstacles, metres, `is_open_below` asks for rays that passed.
const LOW: f32 = 0.2;
/// A hit needs a Gaussian of the map at most this far beyond the radius in which that counts as surface, metres.
const CONFIRMED_WITHIN: f32 = 0.06;
/// This many points make a box solid.
const ENOUGH: u16 = 2;
/// A box in which rays cross the height of its surface this many times, and this many times more often than they end
/// there, has nothing that stays.
const PASSED: (u32, u32) = (20, 10);
/// Fewest points of a box whose surface has a known height.
const SURE: u32 = 8;
/// The surface is at most this far above or below the points on it, metres.
const SURFACE: f32 = 0.005;

/// Sectors of the compass.
const SECTORS: u32 = 16;
/// Cosine of the angle between two directions of one side.
const SIDE: f32 = 0.5;

/// The sector of a direction.
fn sector(direction: Vec2) -> u32 {
    let part = (direction.to_angle() / TAU).rem_euclid(1.0);
    ((part * SECTORS as f32) as u32).min(SECTORS - 1)
}

/// The boxes above a cell, from the lowest height of obstacles up.
#[derive(Clone, Copy, Debug)]
struct SpaceBox {
    /// Points on a surface that the map still has.
    hits: u16,
    /// Rays that passed.
    passes: u16,
    /// Gaussians of the map.
    gaussians: u8,
    /// A Gaussian is here or close.
    is_confirmed: bool,
    /// Lowest and highest point on the surface, from the bottom of the box, in parts of [`BOX`] / 255; the lowest is above
    /// the highest if there is none.
    surface: (u8, u8),
    /// Rays that crossed it: those above a table do not, even if its top is in the same box.
    crossings: u16,
}

/// Columns of boxes above the cells of a grid. Only blocks of columns that something was seen of take memory.
pub(crate) struct Columns {
    resolution: f32,
    width: usize,
    height: usize,
    blocks_across: usize,
    /// Number of a block in `boxes`, plus 1; 0 if it has none.
    blocks: Vec<u32>,
    boxes: Vec<SpaceBox>,
    /// For each cell the compass sectors, one bit each, that its points were seen from.
    seen_from: Vec<u16>,
    levels: usize,
    base: f32,
    floor: FloorHeights,
    /// Height of the floor at the middle of each cell.
    floor_of_cell: Vec<f32>,
}

/// Contents of a column.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct ColumnContent {
    /// Something solid between the lowest and the highest height of obstacles.
    pub is_obstacle: bool,
    /// A single point there: not enough for something solid, but too much for free space.
    pub is_doubtful: bool,
    /// Rays passed everywhere just above the lowest height of obstacles.
    pub is_open_below: bool,
    /// Something solid as high as walls are, and furniture hardly is.
    pub is_tall: bool,
    /// Rays passed at that height.
    pub is_open_above: bool,
}

impl Columns {
    /// Empty columns for `width` x `height` cells of side `resolution` metres.
    pub(crate) fn new(
        (width, height): (usize, usize),
        resolution: f32,
        (min_height, max_height): (f32, f32),
        floor: FloorHeights,
    ) -> Self {
        let levels = ((max_height.max(LEAST_TOP) - min_height) / BOX).ceil().max(1.0) as usize;
        let (blocks_across, blocks_up) = (width.div_ceil(BLOCK), height.div_ceil(BLOCK));
        let blocks = vec![0; blocks_across * blocks_up];
        let (boxes, seen_from) = (Vec::new(), vec![0; width * height]);
        let middle = |cell: usize| Vec2::new((cell % width) as f32 + 0.5, (cell / width) as f32 + 0.5) * resolution;
        // Nothing is above a floor whose height is not known.
        let floor_at = |cell: usize| floor.at(middle(cell).extend(0.0)).unwrap_or(f32::INFINITY);
        let floor_of_cell = (0..width * height).map(floor_at).collect();
        Self {
            resolution,
            width,
            height,
            blocks_across,
            blocks,
            boxes,
            seen_from,
            levels,
            base: min_height,
            floor,
            floor_of_cell,
        }
    }

    /// The bytes that columns over such an area may take.
    pub(crate) fn bytes((width, height): (usize, usize), max_height: f64) -> u64 {
        let levels = (max_height.max(f64::from(LEAST_TOP)) / f64::from(BOX)).ceil() as u64 + 1;
        (width as u64 + BLOCK as u64) * (height as u64 + BLOCK as u64) * levels * size_of::<SpaceBox>() as u64
    }

    /// Height above the floor below a point; `None` outside.
    pub(crate) fn above_floor(&self, point: Vec3) -> Option<f32> {
        self.floor.at(point).map(|floor| point.z - floor)
    }

    /// The cell of a point.
    pub(crate) fn cell(&self, point: Vec3) -> Option<(usize, usize)> {
        let (column, row) = ((point.x / self.resolution).floor(), (point.y / self.resolution).floor());
        let is_inside = column >= 0.0 && row >= 0.0 && column < self.width as f32 && row < self.height as f32;
        is_inside.then_some((column as usize, row as usize))
    }

    fn first_of(&self, (column, row): (usize, usize)) -> Option<usize> {
        let block = self.blocks[row / BLOCK * self.blocks_across + column / BLOCK].checked_sub(1)? as usize;
        Some((block * BLOCK * BLOCK + row % BLOCK * BLOCK + column % BLOCK) * self.levels)
    }

    fn first_of_new(&mut self, (column, row): (usize, usize)) -> usize {
        let block = row / BLOCK * self.blocks_across + column / BLOCK;
        if self.blocks[block] == 0 {
            let per_block = BLOCK * BLOCK * self.levels;
            self.blocks[block] = (self.boxes.len() / per_block) as u32 + 1;
            self.boxes.resize(self.boxes.len() + per_block, SpaceBox::EMPTY);
        }
        self.first_of((column, row)).unwrap_or_default()
    }

    fn level(&self, above_floor: f32) -> Option<usize> {
        let level = ((above_floor - self.base) / BOX).floor();
        (level >= 0.0 && level < self.levels as f32).then_some(level as usize)
    }

    /// Height of a point above the bottom of its box, metres.
    fn height_in_box(&self, point: Vec3, level: usize) -> f32 {
        self.above_floor(point).unwrap_or_default() - self.base - level as f32 * BOX
    }

    /// Adds a Gaussian of the map: surface within `cover` metres of its centre.
    pub(crate) fn add_gaussian(&mut self, mean: Vec3, cover: f32) {
        if let (Some(cell), Some(level)) = (self.cell(mean), self.above_floor(mean).and_then(|above| self.level(above)))
        {
            let first = self.first_of_new(cell);
            let height = self.height_in_box(mean, level);
            let space = &mut self.boxes[first + level];
            space.gaussians = space.gaussians.saturating_add(1);
            space.add_surface(height);
        }
        let reach = (cover.min(0.5) + CONFIRMED_WITHIN).max(0.0);
        let Some(above) = self.above_floor(mean) else { return };
        let levels = |above: f32| ((above - self.base) / BOX).floor().clamp(-1.0, self.levels as f32) as isize;
        let (low, high) = (levels(above - reach).max(0), levels(above + reach).min(self.levels as isize - 1));
        let cells = |center: f32, count: usize| {
            let (low, high) =
                (((center - reach) / self.resolution).floor(), ((center + reach) / self.resolution).floor());
            low.clamp(0.0, count as f32) as usize..(high + 1.0).clamp(0.0, count as f32) as usize
        };
        let (columns, rows) = (cells(mean.x, self.width), cells(mean.y, self.height));
        for row in rows {
            for column in columns.clone() {
                let first = self.first_of_new((column, row));
                for level in low..=high {
                    self.boxes[first + level as usize].is_confirmed = true;
                }
            }
        }
    }

    /// Adds a point that was measured from a camera. It counts if the map has a surface there.
    pub(crate) fn add_point(&mut self, camera: Vec3, point: Vec3) {
        let (Some(cell), Some(level)) = (self.cell(point), self.above_floor(point).and_then(|above| self.level(above)))
        else {
            return;
        };
        let first = self.first_of_new(cell);
        let height = self.height_in_box(point, level);
        let space = &mut self.boxes[first + level];
        if space.is_confirmed {
            space.hits = space.hits.saturating_add(1);
            space.add_surface(height);
            self.seen_from[cell.1 * self.width + cell.0] |= 1 << sector((camera - point).truncate());
        }
    }

    /// True if a point in the column was measured from the side of `direction`: at most about 60 degrees from it, seen
    /// from above.
    pub(crate) fn is_seen_from(&self, (column, row): (usize, usize), direction: Vec2) -> bool {
        let from = self.seen_from[row * self.width + column];
        let side = |number: u32| Vec2::from_angle((number as f32 + 0.5) / SECTORS as f32 * TAU);
        (0..SECTORS).any(|number| from & (1 << number) != 0 && side(number).dot(direction) >= SIDE * direction.length())
    }

    /// Adds the ray from the camera to a measured point, after all points.
    pub(crate) fn add_ray(&mut self, camera: Vec3, point: Vec3) {
        let length = (point - camera).length();
        let margin = MARGIN.0 + MARGIN.1 * length;
        if length <= margin {
            return;
        }
        let end = camera + (point - camera) * (1.0 - margin / length);
        let (start, way) = (camera / self.resolution, (end - camera) / self.resolution);
        let mut cell = [start.x.floor(), start.y.floor()];
        let crossing = |from: f32, step: f32, cell: f32| match step {
            step if step > 0.0 => (cell + 1.0 - from) / step,
            step if step < 0.0 => (cell - from) / step,
            _ => f32::INFINITY,
        };
        let mut t = 0.0_f32;
        // No more cells than the ray can cross.
        let most = way.x.abs().min(1e5) as usize + way.y.abs().min(1e5) as usize + 3;
        for _ in 0..most {
            let next = [crossing(start.x, way.x, cell[0]), crossing(start.y, way.y, cell[1])];
            let until = next[0].min(next[1]).clamp(t, 1.0);
            let (z0, z1) = (camera.z + (end.z - camera.z) * t, camera.z + (end.z - camera.z) * until);
            self.pass((cell[0], cell[1]), z0.min(z1), z0.max(z1));
            if until >= 1.0 {
                break;
            }
            t = until;
            if next[0] <= next[1] { cell[0] += way.x.signum() } else { cell[1] += way.y.signum() }
        }
    }

    fn pass(&mut self, (column, row): (f32, f32), low: f32, high: f32) {
        let is_inside = column >= 0.0 && row >= 0.0 && column < self.width as f32 && row < self.height as f32;
        if !is_inside {
            return;
        }
        let (column, row) = (column as usize, row as usize);
        let floor = self.floor_of_cell[row * self.width + column];
        // In boxes above the lowest one.
        let [low, high] = [low, high].map(|z| (z - floor - self.base) / BOX);
        let (first_level, last_level) = (low.max(0.0) as usize, (high.max(0.0) as usize).min(self.levels - 1));
        if high < 0.0 || first_level > last_level {
            return;
        }
        let first = self.first_of_new((column, row));
        for level in first_level..=last_level {
            self.boxes[first + level].pass(low - level as f32, high - level as f32);
        }
    }

    /// The contents of the column above a cell between the lowest height of obstacles and `max_height`, and higher up.
    pub(crate) fn content(&self, cell: (usize, usize), max_height: f32, tall: (f32, f32)) -> ColumnContent {
        let mut content = ColumnContent::default();
        let Some(first) = self.first_of(cell) else { return content };
        content.is_open_below = true;
        for level in 0..self.levels {
            let space = &self.boxes[first + level];
            let low = self.base + level as f32 * BOX;
            let is_solid = space.is_solid();
            content.is_open_below &= space.passes >= OPEN || level as f32 * BOX >= LOW - 1e-4;
            let is_high = low >= tall.0 - 1e-4 && low < tall.1 - 1e-4;
            let is_in_the_way = low < max_height - 1e-4;
            content.is_obstacle |= is_solid && is_in_the_way;
            content.is_doubtful |= space.hits > 0 && !space.is_passed() && is_in_the_way;
            content.is_tall |= is_solid && is_high;
            content.is_open_above |= is_high && !is_solid && space.passes >= ENOUGH;
        }
        content
    }
}

impl SpaceBox {
    const EMPTY: Self =
        Self { hits: 0, passes: 0, gaussians: 0, is_confirmed: false, surface: (u8::MAX, 0), crossings: 0 };

    /// Adds a point on the surface this high above the bottom, metres.
    fn add_surface(&mut self, height: f32) {
        let part = |height: f32| (height / BOX * f32::from(u8::MAX)).clamp(0.0, f32::from(u8::MAX)) as u8;
        let (low, high) = self.surface;
        self.surface = (low.min(part(height - SURFACE)), high.max(part(height + SURFACE)));
    }

    fn has_surface(&self) -> bool {
        self.surface.0 <= self.surface.1
    }

    /// Adds a ray between these heights above the bottom, in boxes.
    fn pass(&mut self, low: f32, high: f32) {
        self.passes = self.passes.saturating_add(1);
        let [surface_low, surface_high] =
            [self.surface.0, self.surface.1].map(|part| f32::from(part) / f32::from(u8::MAX));
        if self.has_surface() && low <= surface_high && high >= surface_low {
            self.crossings = self.crossings.saturating_add(1);
        }
    }

    /// Few points may be noise, whose height says nothing: then all rays in the box count.
    fn is_passed(&self) -> bool {
        let seen = u32::from(self.hits) + u32::from(self.gaussians);
        let rays = u32::from(if seen < SURE { self.passes } else { self.crossings });
        rays >= PASSED.0 && rays > PASSED.1 * seen
    }

    fn is_solid(&self) -> bool {
        (self.hits >= ENOUGH || self.gaussians > 0) && !self.is_passed()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::floor_heights::FloorSamples;

    /// Columns of a plan of 1 m with a level floor at 0, and a table's top at 0.73 m above the cells from 0.4 m on.
    fn with_table() -> Columns {
        let floor = FloorSamples::new([1.0, 1.0], 0.0).heights();
        let mut columns = Columns::new((20, 20), 0.05, (0.1, 1.8), floor);
        for index in 0..144 {
            let point = Vec3::new(0.425 + (index % 12) as f32 * 0.05, 0.425 + (index / 12) as f32 * 0.05, 0.73);
            columns.add_gaussian(point, 0.02);
            (0..SURE).for_each(|_| columns.add_point(Vec3::new(0.0, 0.5, 1.5), point));
        }
        columns
    }

    fn is_obstacle(columns: &Columns, cell: (usize, usize)) -> bool {
        columns.content(cell, 1.8, (1.3, 2.0)).is_obstacle
    }

    #[test]
    fn rays_above_a_table_leave_it_and_rays_through_it_do_not() {
        let mut columns = with_table();
        let add_rays = |columns: &mut Columns, from: f32, to: f32| {
            for _ in 0..200 {
                columns.add_ray(Vec3::new(0.0, 0.525, from), Vec3::new(0.99, 0.525, to));
            }
        };
        add_rays(&mut columns, 0.79, 0.745);
        assert!(is_obstacle(&columns, (10, 10)), "in the box of the table's top, but above it");
        add_rays(&mut columns, 0.75, 0.70);
        assert!(!is_obstacle(&columns, (10, 10)) && is_obstacle(&columns, (10, 12)));
    }

    #[test]
    fn what_was_seen_has_sides() {
        let columns = with_table();
        // From the left of the plan.
        let seen = |direction: [f32; 2]| columns.is_seen_from((10, 10), Vec2::from_array(direction));
        assert!(seen([-1.0, 0.0]) && seen([-1.0, 1.0]) && seen([-3.0, -3.0]));
        assert!(!seen([1.0, 0.0]) && !seen([0.0, 1.0]) && !seen([0.0, -1.0]));
        assert!(!columns.is_seen_from((2, 2), Vec2::new(-1.0, 0.0)), "nothing is there");
        assert_eq!([sector(Vec2::X), sector(Vec2::NEG_ONE), sector(Vec2::new(1.0, -1e-9))], [0, 10, 15]);
    }
}
