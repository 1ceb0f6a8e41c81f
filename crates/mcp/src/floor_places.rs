//! The rooms, free space and routes of a map's floor plan.

use crate::facts::place;
use crate::places::{Destination, PlaceRoom, Places};
use glam::{DVec2, DVec3};
use splatseg::pipeline::NamedMap;
use splatseg_geometry::SegmentId;
use splatseg_objects::RoomNameSource;
use splatseg_places::{Cell, FloorPlan, PlanFrame, PlanSettings, Room, RouteError};

/// The places of a map, from its keyframes.
///
/// # Errors
/// A sentence: the map has no keyframes, or shows no floor.
pub fn floor_places(map: &NamedMap) -> Result<Box<dyn Places>, String> {
    match map.floor_plan(PlanSettings::default()) {
        Ok(plan) => Ok(Box::new(plan)),
        Err(error) => Err(error.to_string()),
    }
}

impl Places for FloorPlan {
    fn room_of(&self, object: SegmentId) -> Option<String> {
        let room = self.room_of(object)?;
        Some(room.name.clone().unwrap_or_else(|| format!("room {}", room.id)))
    }

    fn rooms(&self) -> Vec<PlaceRoom> {
        let is_in = |object: SegmentId, room: u32| self.room_of(object).is_some_and(|found| found.id == room);
        let room = |room: &Room| PlaceRoom {
            id: room.id,
            name: room.name.clone(),
            is_derived: room.name_source == Some(RoomNameSource::Derived),
            middle: self.place_of(room),
            area_m2: room.area_m2,
            doors: room.doors.iter().map(|door| door.to).collect(),
            objects: self.footprints().keys().copied().filter(|object| is_in(*object, room.id)).collect(),
        };
        FloorPlan::rooms(self).iter().map(room).collect()
    }

    fn is_free(&self, place: DVec3) -> Option<bool> {
        match self.grid().at(self.frame().to_plan(place)) {
            Cell::Free => Some(true),
            Cell::Occupied => Some(false),
            Cell::Unknown => None,
        }
    }

    fn free_place(&self, room: &PlaceRoom, radius: f64) -> Result<DVec3, String> {
        let place = self.free_place_in_room(room.id, radius).map_err(|error| explained(&error, self.frame()))?;
        let no_place = || format!("{} has no free place for a robot with a radius of {radius} m.", room.called());
        place.map(|place| self.frame().to_world(place)).ok_or_else(no_place)
    }

    fn route(&self, from: DVec3, to: Destination, radius: f64) -> Result<Vec<DVec3>, String> {
        let frame = self.frame();
        let from = frame.to_plan(from);
        let route = match to {
            Destination::Place(place) => self.route(from, frame.to_plan(place), radius),
            Destination::Object(object) => self.route_to_object(from, object, radius).map(|(route, _)| route),
        };
        let route = route.map_err(|error| explained(&error, frame))?;
        Ok(route.points.into_iter().map(|point| frame.to_world(point)).collect())
    }
}

/// The text of an error, with places in world coordinates, which are those of the tools.
fn explained(error: &RouteError, frame: &PlanFrame) -> String {
    let world = |at: DVec2| place(frame.to_world(at).to_array());
    match error {
        RouteError::NotFree { place, radius, within } => {
            format!("{} m is not free for a radius of {radius} m, nor is a place within {within} m.", world(*place))
        }
        RouteError::NoWay { from, to, radius } => {
            let (from, to) = (world(*from), world(*to));
            format!("No known free way leads from {from} to {to} m for a radius of {radius} m.")
        }
        other => other.to_string(),
    }
}
