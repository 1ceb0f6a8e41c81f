//! A plan as JSON: frame, rooms, and where objects stand and can be reached. `docs/PLACES.md` describes each key for users.

use crate::approach::approach_points;
use crate::route::RoutePlanner;
use crate::{ApproachPoint, Cell, FloorPlan, Footprint, GridShape, PlanSettings, Room};
use glam::{DQuat, DVec2, DVec3};
use serde::{Deserialize, Serialize};
use splatseg_geometry::SegmentId;
use std::collections::BTreeMap;

/// The content of the JSON file beside an exported grid.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlanFile {
    /// [`PlanFile::FORMAT`].
    pub format: String,
    /// [`PlanFile::VERSION`]: it changes when the meaning of a key changes, not when a key is added.
    pub version: u32,
    /// How the plan was made.
    pub settings: PlanSettings,
    /// The plan's coordinates.
    pub frame: FrameData,
    /// Place and size of the grid.
    pub grid: GridShape,
    /// Areas of its cells, square metres.
    pub areas: Areas,
    /// The rooms.
    pub rooms: Vec<Room>,
    /// Radius of the robot for which approach points are given, metres.
    pub robot_radius: f64,
    /// The objects with a place in the plan, by increasing id.
    pub objects: Vec<PlannedObject>,
}

/// The transform from the map's world to the plan.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct FrameData {
    /// Translation of plan from world, metres.
    pub translation: DVec3,
    /// Rotation of plan from world: x, y, z, w.
    pub rotation: DQuat,
    /// z of the floor in the plan, metres.
    pub floor_height: f64,
    /// Lowest and highest z of the floor from place to place, metres.
    pub floor_heights: (f64, f64),
}

/// Areas of the grid's cells, square metres.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Areas {
    /// Free.
    pub free_m2: f64,
    /// Occupied.
    pub occupied_m2: f64,
}

/// An object on the plan.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlannedObject {
    /// Its id.
    pub id: SegmentId,
    /// Its label, if it was named.
    pub label: Option<String>,
    /// Number of its room; null if it is in none.
    pub room: Option<u32>,
    /// Mean of its footprint.
    pub center: DVec2,
    /// Outlines of its footprint: counter-clockwise around each part, clockwise around holes.
    pub footprint: Vec<Vec<DVec2>>,
    /// Height of its lowest and its highest point above the floor below it, metres.
    pub heights: (f64, f64),
    /// Area of its footprint, square metres.
    pub area_m2: f64,
    /// Places for the robot that face it, the best first; empty for floors, and if there is none.
    pub approach: Vec<ApproachPoint>,
}

impl PlanFile {
    /// Value of `format`.
    pub const FORMAT: &str = "splatseg-plan";
    /// Value of `version`.
    pub const VERSION: u32 = 1;

    /// The file of a plan, with the objects of `ids` or, if `None`, all, and approach points for a robot of that radius, metres.
    pub fn new(
        plan: &FloorPlan,
        labels: &BTreeMap<SegmentId, String>,
        ids: Option<&[SegmentId]>,
        robot_radius: f64,
    ) -> Self {
        let transform = plan.frame().plan_from_world();
        let rotation = DQuat::from_mat3(&transform.rotation()).normalize();
        let frame = FrameData {
            translation: transform.translation(),
            rotation,
            floor_height: plan.frame().floor_height(),
            floor_heights: plan.floor_heights(),
        };
        // One for all objects: it looks at every cell of the grid.
        let planner = RoutePlanner::new(plan.grid(), robot_radius).ok();
        let object = |footprint: &Footprint| {
            let planner = planner.as_ref().filter(|_| !footprint.is_flat(plan.settings().min_height));
            let points = planner.and_then(|planner| approach_points(planner, footprint).ok());
            PlannedObject {
                id: footprint.id,
                label: labels.get(&footprint.id).cloned(),
                room: plan.room_of(footprint.id).map(|room| room.id),
                center: footprint.center,
                footprint: footprint.outlines.clone(),
                heights: footprint.heights,
                area_m2: footprint.area_m2,
                approach: points.unwrap_or_default(),
            }
        };
        let is_wanted = |footprint: &&Footprint| ids.is_none_or(|ids| ids.contains(&footprint.id));
        let areas = Areas { free_m2: plan.grid().area(Cell::Free), occupied_m2: plan.grid().area(Cell::Occupied) };
        Self {
            format: Self::FORMAT.to_owned(),
            version: Self::VERSION,
            settings: *plan.settings(),
            frame,
            grid: plan.grid().shape,
            areas,
            rooms: plan.rooms().to_vec(),
            robot_radius,
            objects: plan.footprints().values().filter(is_wanted).map(object).collect(),
        }
    }

    /// The text of the file.
    ///
    /// # Errors
    /// If a number is not finite.
    pub fn to_json(&self) -> serde_json::Result<String> {
        Ok(serde_json::to_string(self)? + "\n")
    }
}
