//! A plan as a picture: rooms, walls, objects and a route, seen from above.

use crate::floor_plan::FloorPlan;
use crate::grid::Cell;
use glam::DVec2;
use splatseg_geometry::{Image, SegmentId};

const UNKNOWN: [u8; 3] = [205, 205, 205];
const OBSTACLE: [u8; 3] = [60, 60, 60];
const ROUTE: [u8; 3] = [220, 30, 40];
const END: [u8; 3] = [20, 60, 200];
/// Light colours of rooms, in turn; the first is for free cells without a room.
const ROOMS: [[u8; 3]; 7] = [
    [250, 250, 250],
    [235, 242, 252],
    [252, 243, 228],
    [232, 248, 234],
    [250, 234, 242],
    [241, 237, 252],
    [250, 248, 224],
];

/// Contents of a picture of a plan besides rooms and walls.
#[derive(Clone, Copy, Debug)]
pub struct PlanPicture<'a> {
    /// Side of a cell, pixels, 1 to 32.
    pub scale: usize,
    /// Objects to be drawn, in colours of [`FloorPlan::picture`]; all if `None`.
    pub objects: Option<&'a [SegmentId]>,
    /// Corners of a route, in the plan's coordinates; none if empty.
    pub route: &'a [DVec2],
}

impl Default for PlanPicture<'_> {
    fn default() -> Self {
        Self { scale: 4, objects: None, route: &[] }
    }
}

impl FloorPlan {
    /// A picture of the plan, north (the highest y) at the top: `[height, width]` of the grid times the scale. `color` gives
    /// the colours of objects. Large objects are below small ones; floors and what hangs above the robot are left out.
    pub fn picture(&self, content: &PlanPicture<'_>, color: impl Fn(SegmentId) -> [u8; 3]) -> Image<[u8; 3]> {
        let shape = &self.grid().shape;
        let scale = content.scale.clamp(1, 32);
        let mut cells: Vec<[u8; 3]> = (0..shape.len()).map(|cell| self.base_color(cell)).collect();
        let settings = self.settings();
        let is_shown = |id: SegmentId| content.objects.is_none_or(|objects| objects.contains(&id));
        let mut shown: Vec<_> = self
            .footprints()
            .values()
            .filter(|one| is_shown(one.id) && !one.is_flat(settings.min_height) && one.heights.0 < settings.max_height)
            .collect();
        shown.sort_by(|one, other| other.cells.len().cmp(&one.cells.len()).then(one.id.cmp(&other.id)));
        for footprint in shown {
            footprint.cells.iter().for_each(|cell| cells[*cell] = color(footprint.id));
        }
        let mut picture = Image::from_fn(shape.width * scale, shape.height * scale, |column, row| {
            cells[(shape.height - 1 - row / scale) * shape.width + column / scale]
        });
        self.draw_route(&mut picture, content.route, scale);
        picture
    }

    /// The pixel of a picture of this scale at a place, in the plan's coordinates; it may be outside.
    pub fn pixel(&self, place: DVec2, scale: usize) -> DVec2 {
        let shape = &self.grid().shape;
        let cells = (place - shape.origin) / shape.resolution;
        DVec2::new(cells.x, shape.height as f64 - cells.y) * scale as f64
    }

    fn base_color(&self, cell: usize) -> [u8; 3] {
        match self.grid().cells[cell] {
            Cell::Unknown => UNKNOWN,
            Cell::Occupied => OBSTACLE,
            Cell::Free => match self.room_of_cell(cell) {
                0 => ROOMS[0],
                room => ROOMS[1 + (room as usize - 1) % (ROOMS.len() - 1)],
            },
        }
    }

    fn draw_route(&self, picture: &mut Image<[u8; 3]>, route: &[DVec2], scale: usize) {
        let thick = (scale as f64 / 3.0).max(1.0);
        for pair in route.windows(2) {
            let (from, to) = (self.pixel(pair[0], scale), self.pixel(pair[1], scale));
            let steps = from.distance(to).ceil().clamp(1.0, 1e5) as usize;
            for step in 0..=steps {
                dot(picture, from.lerp(to, step as f64 / steps as f64), thick, ROUTE);
            }
        }
        for end in [route.first(), route.last()].into_iter().flatten() {
            dot(picture, self.pixel(*end, scale), 1.2 * scale as f64, END);
        }
    }
}

/// Draws a disc.
fn dot(picture: &mut Image<[u8; 3]>, at: DVec2, radius: f64, color: [u8; 3]) {
    let range = |at: f64, count: usize| {
        let (low, high) = ((at - radius).floor().max(0.0), (at + radius).ceil().min(count as f64 - 1.0));
        low as usize..(high.max(-1.0) + 1.0) as usize
    };
    for row in range(at.y, picture.height()) {
        for column in range(at.x, picture.width()) {
            if DVec2::new(column as f64 + 0.5, row as f64 + 0.5).distance(at) <= radius {
                picture[(column, row)] = color;
            }
        }
    }
}
