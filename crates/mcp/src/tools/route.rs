//! `route`: a way for a robot from one object or place to another.

use super::what_is_near::point_box;
use crate::facts::{place, rounded, thousandths};
use crate::object_reference::ObjectReference;
use crate::plan::{Shown, draw};
use crate::tool::{Answer, Tool, ToolError};
use crate::{Assistant, Destination};
use glam::DVec3;
use rmcp::schemars::{self, JsonSchema};
use serde::{Deserialize, Serialize};
use splatseg_geometry::SegmentId;

const DEFAULT_RADIUS: f64 = 0.25;
const MAX_RADIUS: f64 = 5.0;
/// Maximum number of points of a route in the answer.
const MAX_POINTS: usize = 200;

/// Where a route begins or ends: an object, a room, or a point in the map's coordinates, metres.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(
    untagged,
    expecting = "expected an object (an id or words), a room, e.g. {\"room\": 2}, or a point, e.g. [1.0, 2.0, 0.0]"
)]
pub enum Stop {
    /// A point in the map's coordinates, metres.
    Point([f64; 3]),
    /// A room: the free place nearest to its middle.
    Room {
        /// Its number, from list_rooms.
        room: u32,
    },
    /// An object; the route ends beside it.
    Object(ObjectReference),
}

/// The arguments of `route`.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Input {
    /// Where it begins.
    from: Stop,
    /// Where it ends.
    to: Stop,
    /// Radius of the robot, metres; 0.25 if not given.
    radius_m: Option<f64>,
}

/// The answer of `route`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct Output {
    /// Length of the way, metres.
    length_m: f64,
    /// The way, map coordinates, metres; at most 200 points.
    points_m: Vec<[f64; 3]>,
}

/// The tool.
pub enum Route {}

impl Tool for Route {
    type Input = Input;
    type Output = Output;
    const NAME: &'static str = "route";
    const TITLE: &'static str = "Find a way";
    const DESCRIPTION: &'static str = "Finds the shortest free way on the floor for a robot of a radius between two \
                                       objects, rooms or places, as points, length and a picture. It does not move the \
                                       robot. Needs a map that shows a floor.";

    fn call(input: Input, assistant: &mut Assistant) -> Result<Answer<Output>, ToolError> {
        let radius = input.radius_m.unwrap_or(DEFAULT_RADIUS);
        if !(0.0..=MAX_RADIUS).contains(&radius) {
            return Err(ToolError(format!("radius_m: found {radius}, expected 0 to {MAX_RADIUS}.")));
        }
        let ((from, from_words, one), (to, to_words, other)) =
            (assistant.stop(&input.from, radius)?, assistant.stop(&input.to, radius)?);
        let destination = other.map_or(Destination::Place(to), Destination::Object);
        let route = assistant.places()?.route(from, destination, radius)?;
        // The sum of nothing would be -0.
        let length = route.windows(2).fold(0.0, |length, part| length + part[0].distance(part[1]));
        let shown = Shown { objects: one.into_iter().chain(other).collect(), route: &route };
        let (picture, _) = draw(assistant.map.current(), &shown)?;
        let step = route.len().div_ceil(MAX_POINTS - 1).max(1);
        let last = route.last().filter(|_| !(route.len() - 1).is_multiple_of(step)).copied();
        let points_m: Vec<[f64; 3]> = route.iter().step_by(step).copied().chain(last).map(rounded).collect();
        let text = format!("From {from_words} to {to_words}: {length:.2} m for a robot with a radius of {radius} m.");
        let data = Output { length_m: thousandths(length), points_m };
        Ok(Answer { text, data, picture: Some(picture) })
    }
}

impl Assistant {
    /// Place, name and id of where the route of a robot of a radius begins or ends.
    fn stop(&mut self, stop: &Stop, radius: f64) -> Result<(DVec3, String, Option<SegmentId>), ToolError> {
        match stop {
            Stop::Point(point) => Ok((point_box(*point)?.center(), place(*point), None)),
            Stop::Room { room } => {
                let room = self.room(*room)?;
                let place = self.places()?.free_place(&room, radius)?;
                Ok((place, room.called(), None))
            }
            Stop::Object(object) => {
                let id = self.meant(object)?;
                Ok((self.solid(id)?.center(), self.called(id), Some(id)))
            }
        }
    }
}
