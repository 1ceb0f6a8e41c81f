//! Rooms, free space and routes of a map, from whoever knows them.

use glam::DVec3;
use splatseg::pipeline::NamedMap;
use splatseg_geometry::SegmentId;

/// A map's floor. With it, the server offers the tool `route`, objects have rooms, and the plan shows free
/// space.
pub trait Places: Send {
    /// Name of the room that an object is in; `None` if it is in none.
    fn room_of(&self, object: SegmentId) -> Option<String>;

    /// The rooms, by number; none if they are not known.
    fn rooms(&self) -> Vec<PlaceRoom> {
        Vec::new()
    }

    /// True if a robot could stand at the floor below or above a place (world coordinates, metres), false if something is in
    /// its way, `None` if nobody has looked.
    fn is_free(&self, place: DVec3) -> Option<bool>;

    /// The place on the floor nearest to a room's middle, and in the room, where a robot of a radius (metres) can stand: world
    /// coordinates, metres.
    ///
    /// # Errors
    /// A sentence: there is none.
    fn free_place(&self, room: &PlaceRoom, _radius: f64) -> Result<DVec3, String> {
        Ok(room.middle)
    }

    /// The shortest way for a robot of a radius (metres) from one place to another, or to where it faces an object: points on
    /// the floor, world coordinates, metres.
    ///
    /// # Errors
    /// A sentence: there is no way, or a place is not known.
    fn route(&self, from: DVec3, to: Destination, radius: f64) -> Result<Vec<DVec3>, String>;
}

/// A room.
#[derive(Clone, Debug, PartialEq)]
pub struct PlaceRoom {
    /// Its number.
    pub id: u32,
    /// Its name.
    pub name: Option<String>,
    /// True if the name was told from its objects, not given by a person.
    pub is_derived: bool,
    /// A place on its floor, where it is widest; furniture may stand there. World coordinates, metres.
    pub middle: DVec3,
    /// Area of its floor, square metres.
    pub area_m2: f64,
    /// Rooms that doors lead to.
    pub doors: Vec<u32>,
    /// Objects in it.
    pub objects: Vec<SegmentId>,
}

impl PlaceRoom {
    /// Its name, or its number: `kitchen (room 2)`.
    pub fn called(&self) -> String {
        match &self.name {
            Some(name) => format!("{name} (room {})", self.id),
            None => format!("room {}", self.id),
        }
    }
}

/// Where a route ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Destination {
    /// At a place, or as near to it as the robot can come. World coordinates, metres.
    Place(DVec3),
    /// Before an object.
    Object(SegmentId),
}

/// Finds the places of a map each time that it is loaded. An error is a sentence that says why there are none.
pub type OpenPlaces = Box<dyn Fn(&NamedMap) -> Result<Box<dyn Places>, String> + Send>;
