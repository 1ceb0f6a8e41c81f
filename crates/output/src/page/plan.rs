//! The page's data about the floor plan of a map.

use super::ids::encode_ids;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use glam::{DQuat, DVec2, DVec3};
use serde::Serialize;
use splatseg_geometry::{Image, SegmentId};
use splatseg_objects::RoomNameSource;
use splatseg_places::{Cell, FloorPlan, Footprint, Room};
use std::collections::BTreeMap;

/// Largest number of cells. A larger grid is drawn with larger cells.
const MAX_CELLS: usize = 250_000;
/// Largest number of footprints; the smallest ones are left out.
const MAX_FOOTPRINTS: usize = 2000;
/// Largest number of corners of a footprint.
const MAX_CORNERS: usize = 400;
/// Codes of cells: unknown, occupied, and from this on free, plus the number of the room, 0 for none.
const OCCUPIED: u32 = 1;
const FREE: u32 = 2;

/// A floor plan, read by `viewer/src/plan_view.js`. Places are in the plan's coordinates, metres.
#[derive(Debug, Serialize)]
pub struct PlanData {
    /// Side of a cell, metres.
    resolution: f64,
    /// Corner of the grid with the lowest x and y.
    origin: DVec2,
    /// Cells along x and y.
    width: usize,
    height: usize,
    /// State of each cell, in rows from the lowest y: 0 unknown, 1 occupied, 2 free, and 2 plus its number for free
    /// cells of a room. Encoded as the ids of a frame, in base64.
    cells: String,
    /// Rotation of plan from world: x, y, z, w.
    rotation: DQuat,
    /// The run's origin in the plan's coordinates.
    run_origin: DVec3,
    rooms: Vec<RoomData>,
    /// Footprints of objects that stand on the floor, large ones first.
    objects: Vec<FootprintData>,
}

#[derive(Debug, Serialize)]
struct RoomData {
    id: u32,
    name: Option<String>,
    name_source: Option<RoomNameSource>,
    /// Where its name stands.
    middle: DVec2,
    area_m2: f64,
}

#[derive(Debug, Serialize)]
struct FootprintData {
    id: SegmentId,
    /// For each outline, x and y of its corners in turn, whole centimetres from the grid's origin.
    outlines: Vec<Vec<i64>>,
}

impl PlanData {
    /// The data of a plan, for a run with an origin in world coordinates.
    pub fn new(plan: &FloorPlan, origin: DVec3) -> Self {
        let shape = &plan.grid().shape;
        let step = ((shape.len() as f64 / MAX_CELLS as f64).sqrt().ceil() as usize).max(1);
        let codes = codes(plan, step);
        let rotation = DQuat::from_mat3(&plan.frame().plan_from_world().rotation()).normalize();
        Self {
            resolution: shape.resolution * step as f64,
            origin: shape.origin,
            width: codes.width(),
            height: codes.height(),
            cells: STANDARD.encode(encode_ids(&codes)),
            rotation,
            run_origin: plan.frame().point_to_plan(origin),
            rooms: plan.rooms().iter().map(RoomData::of).collect(),
            objects: footprints(plan),
        }
    }
}

impl RoomData {
    fn of(room: &Room) -> Self {
        let Room { id, name, name_source, middle, area_m2, .. } = room;
        let area_m2 = (area_m2 * 10.0).round() / 10.0;
        Self { id: *id, name: name.clone(), name_source: *name_source, middle: *middle, area_m2 }
    }
}

/// The codes of blocks of `step` x `step` cells: occupied if one cell is, else free if one is.
fn codes(plan: &FloorPlan, step: usize) -> Image<u32> {
    let (grid, shape) = (plan.grid(), &plan.grid().shape);
    let code = |cell: usize| match grid.cells[cell] {
        Cell::Unknown => 0,
        Cell::Occupied => OCCUPIED,
        Cell::Free => FREE + plan.room_at(shape.center(cell)).map_or(0, |room| room.id),
    };
    Image::from_fn(shape.width.div_ceil(step), shape.height.div_ceil(step), |column, row| {
        let columns = column * step..((column + 1) * step).min(shape.width);
        let rows = row * step..((row + 1) * step).min(shape.height);
        let cells = rows.flat_map(|row| columns.clone().map(move |column| row * shape.width + column));
        let mut counts: BTreeMap<u32, usize> = BTreeMap::new();
        cells.for_each(|cell| *counts.entry(code(cell)).or_default() += 1);
        if counts.contains_key(&OCCUPIED) {
            return OCCUPIED;
        }
        counts.remove(&0);
        let most = counts.into_iter().max_by(|one, other| one.1.cmp(&other.1).then(other.0.cmp(&one.0)));
        most.map_or(0, |(code, _)| code)
    })
}

/// The footprints of all but floors and what hangs above the robot.
fn footprints(plan: &FloorPlan) -> Vec<FootprintData> {
    let settings = plan.settings();
    let stands = |one: &&Footprint| !one.is_flat(settings.min_height) && one.heights.0 < settings.max_height;
    let mut shown: Vec<&Footprint> = plan.footprints().values().filter(stands).collect();
    shown.sort_by(|one, other| other.cells.len().cmp(&one.cells.len()).then(one.id.cmp(&other.id)));
    shown.truncate(MAX_FOOTPRINTS);
    let origin = plan.grid().shape.origin;
    let flat = |outline: &Vec<DVec2>| {
        let corners = outline.iter().step_by(outline.len().div_ceil(MAX_CORNERS).max(1));
        corners.flat_map(|corner| ((*corner - origin) * 100.0).round().as_i64vec2().to_array()).collect()
    };
    let data = |one: &&Footprint| FootprintData { id: one.id, outlines: one.outlines.iter().map(flat).collect() };
    shown.iter().map(data).collect()
}
