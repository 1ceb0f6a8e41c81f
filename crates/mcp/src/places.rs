//! Rooms, free space and routes of a map, from whoever knows them.

use glam::DVec3;
use splatseg::pipeline::NamedMap;
use splatseg_geometry::SegmentId;

/// What is known of a map's floor. With it, the server offers the tool `route`, objects have rooms, and the plan shows free
/// space.
pub trait Places: Send {
    /// Name of the room that an object is in; `None` if it is in none.
    fn room_of(&self, object: SegmentId) -> Option<String>;

    /// True if a robot could stand at the floor below or above a place (world coordinates, metres), false if something is in
    /// its way, `None` if nobody has looked.
    fn is_free(&self, place: DVec3) -> Option<bool>;

    /// The shortest way for a robot of a radius (metres) from one place to another, or to where it faces an object: points on
    /// the floor, world coordinates, metres.
    ///
    /// # Errors
    /// A sentence: there is no way, or a place is not known.
    fn route(&self, from: DVec3, to: Destination, radius: f64) -> Result<Vec<DVec3>, String>;
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
