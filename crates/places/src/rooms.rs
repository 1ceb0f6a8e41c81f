//! Rooms: the space between walls, parted where it is narrow.
//!
//! Furniture does not part rooms, so they are found in the space that walls leave: columns that are occupied as high as
//! furniture hardly is, or whose top was not seen. The distance to them has a maximum in each room. From the highest
//! maximum down, basins grow until they meet (a watershed). Where they meet is a door if the way is narrow there and
//! clearly wider in both; else the basins are one room.

use crate::clearance::distances;
use crate::columns::ColumnContent;
use crate::grid::{Cell, GridShape, OccupancyGrid};
use glam::DVec2;
use serde::{Deserialize, Serialize};
use splatseg_objects::RoomNameSource;
use std::collections::{BTreeMap, VecDeque};

/// Widest door, half its width, metres.
const DOOR_HALF: f64 = 0.8;
/// A room is wider than its door by this factor at least.
const WIDER: f64 = 1.35;
/// The smallest room, square metres.
const SMALLEST: f64 = 1.5;
/// An unseen area up to this size counts as part of the room around it, square metres.
const LARGEST_HOLE: f64 = 2.0;
/// Free cells that are no room's, as parts of the floor that were seen through a door, belong to one at most this far away
/// with no obstacle between, metres.
const APART: f64 = 1.5;
/// Cells that are no room's, as walls and things at them are, belong to one at most this far away, metres.
const BESIDE: f64 = 0.5;

/// A room of the plan.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Room {
    /// Its number, from 1: rooms are numbered by their middle, from low x to high x, then by y. A known room keeps its
    /// number, see [`FloorPlan::keep_room_ids`](crate::FloorPlan::keep_room_ids).
    pub id: u32,
    /// Its name, if it has one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// Who gave the name.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name_source: Option<RoomNameSource>,
    /// Where it is widest, in the plan's coordinates, metres.
    pub middle: DVec2,
    /// Area of its floor, furniture included, square metres.
    pub area_m2: f64,
    /// Rooms that a door joins it with, and where the door is, in the plan's coordinates.
    pub doors: Vec<Door>,
}

/// A way into another room.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Door {
    /// The other room.
    pub to: u32,
    /// The middle of the way.
    pub place: DVec2,
    /// Its width as far as it was seen, metres.
    pub width_m: f64,
}

/// The rooms, and the room of each cell: 0 for none.
#[derive(Clone, Debug)]
pub(crate) struct Rooms {
    pub rooms: Vec<Room>,
    pub of_cell: Vec<u32>,
    /// True for the cells of a room's floor, furniture included; the others with a room are beside it.
    pub is_floor: Vec<bool>,
}

impl Rooms {
    pub(crate) fn new(grid: &OccupancyGrid, columns: &[ColumnContent]) -> Self {
        let shape = &grid.shape;
        let is_inside = interior(grid, columns);
        let width: Vec<f64> =
            distances(shape, |cell| !is_inside[cell]).into_iter().map(|cells| cells * shape.resolution).collect();
        let basins = Basins::new(shape, &width, &is_inside);
        basins.rooms(grid, &width)
    }

    /// Gives rooms other numbers: `ids` has the new one for each.
    pub(crate) fn number(&mut self, ids: &BTreeMap<u32, u32>) {
        let new = |id: &mut u32| *id = ids.get(id).copied().unwrap_or(*id);
        self.of_cell.iter_mut().for_each(new);
        for room in &mut self.rooms {
            new(&mut room.id);
            room.doors.iter_mut().for_each(|door| new(&mut door.to));
        }
        self.rooms.sort_by_key(|room| room.id);
    }
}

/// Space without walls that was seen: free cells, those below low things, and small holes between.
fn interior(grid: &OccupancyGrid, columns: &[ColumnContent]) -> Vec<bool> {
    let shape = &grid.shape;
    let is_wall = |content: &ColumnContent| content.is_tall || content.is_obstacle && !content.is_open_above;
    let mut inside: Vec<bool> = (0..shape.len())
        .map(|cell| match grid.cells[cell] {
            Cell::Free => !columns[cell].is_tall,
            Cell::Occupied => !is_wall(&columns[cell]),
            Cell::Unknown => false,
        })
        .collect();
    let is_hole = |cell: usize| grid.cells[cell] == Cell::Unknown && !columns[cell].is_tall;
    let mut is_visited = vec![false; shape.len()];
    for start in 0..shape.len() {
        if is_visited[start] || !is_hole(start) {
            continue;
        }
        let hole = splatseg_geometry::flood_fill(start, (shape.width, shape.height), &mut is_visited, is_hole);
        let is_small = hole.len() as f64 * shape.resolution * shape.resolution <= LARGEST_HOLE;
        let is_at_border = hole.iter().any(|cell| shape.beside(*cell).count() < 4);
        // Small unseen space behind furniture, but not the space between two walls.
        let rim = || hole.iter().flat_map(|cell| shape.beside(*cell)).filter(|cell| !is_hole(*cell));
        let open = rim().filter(|cell| inside[*cell]).count();
        if is_small && !is_at_border && 2 * open > rim().count() {
            hole.into_iter().for_each(|cell| inside[cell] = true);
        }
    }
    inside
}

/// The basins of the watershed, joined as rooms.
struct Basins {
    /// Basin of each cell; `usize::MAX` outside.
    of_cell: Vec<usize>,
    /// For each basin the one it was joined with; itself if it stands alone.
    joined: Vec<usize>,
    /// Cell of each basin's maximum.
    peak: Vec<usize>,
    /// Cells of each basin.
    size: Vec<usize>,
}

impl Basins {
    fn new(shape: &GridShape, width: &[f64], is_inside: &[bool]) -> Self {
        let mut order: Vec<usize> = (0..shape.len()).filter(|cell| is_inside[*cell]).collect();
        order.sort_by(|one, other| width[*other].total_cmp(&width[*one]).then(one.cmp(other)));
        let mut basins =
            Self { of_cell: vec![usize::MAX; shape.len()], joined: Vec::new(), peak: Vec::new(), size: Vec::new() };
        for cell in order {
            let around = shape.beside(cell).filter(|other| basins.of_cell[*other] != usize::MAX);
            let mut near: Vec<usize> = around.map(|other| basins.root(basins.of_cell[other])).collect();
            near.sort_by(|one, other| {
                width[basins.peak[*other]].total_cmp(&width[basins.peak[*one]]).then(one.cmp(other))
            });
            near.dedup();
            let Some(first) = near.first().copied() else {
                basins.start(cell);
                continue;
            };
            basins.of_cell[cell] = first;
            basins.size[first] += 1;
            for other in &near[1..] {
                if !basins.is_door(shape, width, width[cell], first, *other) {
                    basins.joined[*other] = first;
                    basins.size[first] += basins.size[*other];
                }
            }
        }
        basins
    }

    fn start(&mut self, cell: usize) {
        self.of_cell[cell] = self.joined.len();
        self.joined.push(self.joined.len());
        self.peak.push(cell);
        self.size.push(1);
    }

    fn root(&self, mut basin: usize) -> usize {
        while self.joined[basin] != basin {
            basin = self.joined[basin];
        }
        basin
    }

    /// True if a way of half width `half` between two basins is a door.
    fn is_door(&self, shape: &GridShape, width: &[f64], half: f64, one: usize, other: usize) -> bool {
        let area = |basin: usize| self.size[basin] as f64 * shape.resolution * shape.resolution;
        let is_room = |basin: usize| width[self.peak[basin]] >= WIDER * half && area(basin) >= 0.5 * SMALLEST;
        half <= DOOR_HALF && is_room(one) && is_room(other)
    }

    /// The rooms. Basins that have stayed too small are no rooms.
    fn rooms(&self, grid: &OccupancyGrid, width: &[f64]) -> Rooms {
        let shape = &grid.shape;
        let cell_area = shape.resolution * shape.resolution;
        let mut cells: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
        for (cell, basin) in self.of_cell.iter().enumerate().filter(|(_, basin)| **basin != usize::MAX) {
            cells.entry(self.root(*basin)).or_default().push(cell);
        }
        cells.retain(|_, cells| cells.len() as f64 * cell_area >= SMALLEST);
        let mut order: Vec<usize> = cells.keys().copied().collect();
        order.sort_by(|one, other| {
            let middle = |basin: &usize| shape.center(self.peak[*basin]);
            let (one, other) = (middle(one), middle(other));
            one.x.total_cmp(&other.x).then(one.y.total_cmp(&other.y))
        });
        let mut of_cell = vec![0; shape.len()];
        let mut rooms = Vec::new();
        for (basin, id) in order.iter().zip(1..) {
            cells[basin].iter().for_each(|cell| of_cell[*cell] = id);
            let (middle, area_m2) = (shape.center(self.peak[*basin]), cells[basin].len() as f64 * cell_area);
            rooms.push(Room { id, name: None, name_source: None, middle, area_m2, doors: Vec::new() });
        }
        add_doors(shape, width, &of_cell, &mut rooms);
        let is_floor = of_cell.iter().map(|room| *room != 0).collect();
        spread(shape, &mut of_cell, APART, |cell| grid.cells[cell] != Cell::Occupied);
        spread(shape, &mut of_cell, BESIDE, |_| true);
        Rooms { rooms, of_cell, is_floor }
    }
}

/// Adds the widest way between each pair of rooms that touch.
fn add_doors(shape: &GridShape, width: &[f64], of_cell: &[u32], rooms: &mut [Room]) {
    let mut ways: BTreeMap<(u32, u32), usize> = BTreeMap::new();
    for (cell, room) in of_cell.iter().enumerate().filter(|(_, room)| **room != 0) {
        for other in shape.beside(cell).filter(|other| of_cell[*other] > *room) {
            let widest = ways.entry((*room, of_cell[other])).or_insert(cell);
            if width[cell] > width[*widest] {
                *widest = cell;
            }
        }
    }
    for ((one, other), cell) in ways {
        let (place, width_m) = (shape.center(cell), 2.0 * width[cell]);
        rooms[one as usize - 1].doors.push(Door { to: other, place, width_m });
        rooms[other as usize - 1].doors.push(Door { to: one, place, width_m });
    }
}

/// Gives cells at most `distance` metres from a room to the nearest one, over cells with `is_open`.
fn spread(shape: &GridShape, of_cell: &mut [u32], distance: f64, is_open: impl Fn(usize) -> bool) {
    let most = (distance / shape.resolution).ceil() as usize;
    let mut reached: VecDeque<(usize, usize)> =
        (0..of_cell.len()).filter(|cell| of_cell[*cell] != 0).map(|cell| (cell, 0)).collect();
    while let Some((cell, steps)) = reached.pop_front() {
        if steps == most {
            continue;
        }
        for other in shape.beside(cell) {
            if of_cell[other] == 0 && is_open(other) {
                of_cell[other] = of_cell[cell];
                reached.push_back((other, steps + 1));
            }
        }
    }
}
