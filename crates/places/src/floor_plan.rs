//! The plan of a map.

use crate::approach::{ApproachPoint, approach_points};
use crate::floor_heights::FloorHeights;
use crate::footprints::{Footprint, footprints};
use crate::occupancy::Occupancy;
use crate::rooms::{Room, Rooms};
use crate::route::{Route, RoutePlanner};
use crate::{OccupancyGrid, PlanError, PlanFrame, PlanSettings, RouteError};
use glam::DVec2;
use splatseg_geometry::{MapView, SegmentId};
use splatseg_objects::{DepthView, ObjectSurfaces};
use std::collections::BTreeMap;

/// The plan of a map: its floor, what stands on it, and its rooms.
#[derive(Clone, Debug)]
pub struct FloorPlan {
    settings: PlanSettings,
    frame: PlanFrame,
    grid: OccupancyGrid,
    floor: FloorHeights,
    footprints: BTreeMap<SegmentId, Footprint>,
    rooms: Rooms,
}

impl FloorPlan {
    /// Makes the plan of a map from the depth of its keyframes. Surfaces that the map does not have any more, of things
    /// that moved or were taken away, are no obstacles.
    ///
    /// # Errors
    /// [`PlanError`] if a setting is out of range, there are no keyframes, no floor is found, or the plan is too large.
    pub fn new(map: &MapView<'_>, keyframes: &[DepthView], settings: PlanSettings) -> Result<Self, PlanError> {
        let mut plan = Self::without_objects(map, keyframes, settings)?;
        plan.look_for_objects(map, &ObjectSurfaces::of(map));
        Ok(plan)
    }

    /// As [`Self::new`], without the places of objects: [`Self::look_for_objects`] adds them.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn without_objects(
        map: &MapView<'_>,
        keyframes: &[DepthView],
        settings: PlanSettings,
    ) -> Result<Self, PlanError> {
        let Occupancy { frame, grid, columns, floor } = Occupancy::new(map, keyframes, &settings)?;
        let rooms = Rooms::new(&grid, &columns);
        Ok(Self { settings, frame, grid, floor, footprints: BTreeMap::new(), rooms })
    }

    /// Looks where the objects with these surfaces are, in the map that the plan was made of: for the first time, or again
    /// after what its Gaussians show has changed.
    pub fn look_for_objects(&mut self, map: &MapView<'_>, surfaces: &ObjectSurfaces) {
        self.footprints = footprints(map, surfaces, &self.frame, &self.grid.shape, &self.floor);
    }

    /// The settings that it was made with.
    pub fn settings(&self) -> &PlanSettings {
        &self.settings
    }

    /// Where it lies in the world. Routes, rooms and footprints are in the plan's coordinates: [`PlanFrame::to_plan`] and
    /// [`PlanFrame::to_world`] convert.
    pub fn frame(&self) -> &PlanFrame {
        &self.frame
    }

    /// Free, occupied and unknown cells.
    pub fn grid(&self) -> &OccupancyGrid {
        &self.grid
    }

    /// The lowest and the highest z of the floor, in the plan's coordinates, metres.
    pub fn floor_heights(&self) -> (f64, f64) {
        let (low, high) = self.floor.range();
        (self.frame.floor_height() + f64::from(low), self.frame.floor_height() + f64::from(high))
    }

    /// The footprints of all objects with a place in the plan, floors and walls included.
    pub fn footprints(&self) -> &BTreeMap<SegmentId, Footprint> {
        &self.footprints
    }

    /// The rooms, by increasing number.
    pub fn rooms(&self) -> &[Room] {
        &self.rooms.rooms
    }

    pub(crate) fn rooms_mut(&mut self) -> &mut [Room] {
        &mut self.rooms.rooms
    }

    /// The room at a place, in the plan's coordinates.
    pub fn room_at(&self, place: DVec2) -> Option<&Room> {
        self.room(self.room_of_cell(self.grid.shape.cell_at(place)?))
    }

    /// The room in which most of an object's footprint is.
    pub fn room_of(&self, object: SegmentId) -> Option<&Room> {
        let mut counts: BTreeMap<u32, usize> = BTreeMap::new();
        for cell in &self.footprints.get(&object)?.cells {
            *counts.entry(self.room_of_cell(*cell)).or_default() += 1;
        }
        counts.remove(&0);
        let most = counts.into_iter().max_by(|one, other| one.1.cmp(&other.1).then(other.0.cmp(&one.0)));
        self.room(most?.0)
    }

    fn room(&self, id: u32) -> Option<&Room> {
        self.rooms.rooms.iter().find(|room| room.id == id)
    }

    /// Gives rooms other numbers: `ids` has the new one for each.
    pub(crate) fn number_rooms(&mut self, ids: &BTreeMap<u32, u32>) {
        self.rooms.number(ids);
    }

    /// True if a cell is a part of a room's floor, and not only beside one.
    pub(crate) fn is_room_floor(&self, cell: usize) -> bool {
        self.rooms.is_floor[cell]
    }

    /// The number of a cell's room; 0 if it has none.
    pub(crate) fn room_of_cell(&self, cell: usize) -> u32 {
        self.rooms.of_cell[cell]
    }

    /// The way of a robot of this radius, metres, between two places, in the plan's coordinates. Its ends are the free
    /// places nearest to the given ones. It stays off everything that is not known to be free, and keeps more distance
    /// where there is space.
    ///
    /// # Errors
    /// [`RouteError`] if there is no free place near an end, or no way between them.
    pub fn route(&self, from: DVec2, to: DVec2, radius: f64) -> Result<Route, RouteError> {
        RoutePlanner::new(&self.grid, radius)?.route(from, to)
    }

    /// Places for a robot of this radius, metres, from which it faces an object, the best first: near it, in the open, and
    /// with nothing between.
    ///
    /// # Errors
    /// [`RouteError::NoObject`] if the object has no footprint, [`RouteError::NoApproach`] if no such place is free.
    pub fn approach(&self, object: SegmentId, radius: f64) -> Result<Vec<ApproachPoint>, RouteError> {
        let footprint = self.footprints.get(&object).ok_or(RouteError::NoObject(object))?;
        approach_points(&RoutePlanner::new(&self.grid, radius)?, footprint)
    }

    /// The way of a robot of this radius, metres, from a place to where it faces an object, and that place: the best one
    /// that can be reached.
    ///
    /// # Errors
    /// As [`Self::approach`] and [`Self::route`].
    pub fn route_to_object(
        &self,
        from: DVec2,
        object: SegmentId,
        radius: f64,
    ) -> Result<(Route, ApproachPoint), RouteError> {
        let footprint = self.footprints.get(&object).ok_or(RouteError::NoObject(object))?;
        let planner = RoutePlanner::new(&self.grid, radius)?;
        let mut failed = None;
        for point in approach_points(&planner, footprint)? {
            match planner.route(from, point.place) {
                Ok(route) => return Ok((route, point)),
                Err(error) => failed = failed.or(Some(error)),
            }
        }
        Err(failed.unwrap_or(RouteError::NoObject(object)))
    }
}
