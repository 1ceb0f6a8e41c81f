//! `list_rooms`: the rooms and what is in them.

use crate::facts::{counted, place, rounded};
use crate::tool::{Answer, Tool, ToolError};
use crate::{Assistant, PlaceRoom};
use rmcp::schemars::{self, JsonSchema};
use serde::{Deserialize, Serialize};
use splatseg_geometry::SegmentId;

/// Maximum number of rooms in the answer.
const MAX_ROOMS: usize = 100;
/// Maximum number of objects that are listed for a room.
const MAX_OBJECTS: usize = 100;

/// The arguments of `list_rooms`.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Input {}

/// The answer of `list_rooms`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct Output {
    /// The rooms, at most 100.
    rooms: Vec<RoomFacts>,
}

/// A room.
#[derive(Debug, Serialize, JsonSchema)]
pub struct RoomFacts {
    /// Its number. Numbers may change when the map grows.
    id: u32,
    /// Its name; null if it has none.
    name: Option<String>,
    /// True if the name was told from what stands in the room; false if a person gave it.
    name_is_derived: bool,
    /// A place on its floor, where it is widest, metres.
    middle_m: [f64; 3],
    /// Area of its floor, square metres.
    area_m2: f64,
    /// Numbers of the rooms that doors lead to.
    doors: Vec<u32>,
    /// Ids of the objects in it, at most 100.
    objects: Vec<SegmentId>,
    /// Number of further objects.
    more_objects: usize,
}

/// The tool.
pub enum ListRooms {}

impl Tool for ListRooms {
    type Input = Input;
    type Output = Output;
    const NAME: &'static str = "list_rooms";
    const TITLE: &'static str = "List rooms";
    const DESCRIPTION: &'static str = "Lists the rooms: number, name, area, doors to other rooms, and the objects in each. Needs a map that shows a \
         floor.";

    fn call(_: Input, assistant: &mut Assistant) -> Result<Answer<Output>, ToolError> {
        let mut rooms = assistant.places()?.rooms();
        // Objects that do not count are not told of.
        let listed: Vec<SegmentId> = assistant.map.current().list.objects.iter().map(|object| object.id).collect();
        rooms.iter_mut().for_each(|room| room.objects.retain(|id| listed.contains(id)));
        let lines: Vec<String> = rooms.iter().take(MAX_ROOMS).map(line).collect();
        let text = match rooms.len() {
            0 => "No rooms were found.".to_owned(),
            count => format!("{}:\n{}", counted(count, "room"), lines.join("\n")),
        };
        let data = Output { rooms: rooms.into_iter().take(MAX_ROOMS).map(RoomFacts::of).collect() };
        Ok(Answer { text, data, picture: None })
    }
}

fn line(room: &PlaceRoom) -> String {
    let derived = if room.is_derived { ", named by its objects" } else { "" };
    let doors: Vec<String> = room.doors.iter().map(ToString::to_string).collect();
    let doors = if doors.is_empty() { String::new() } else { format!(", doors to {}", doors.join(", ")) };
    let middle = place(rounded(room.middle));
    format!(
        "{}{derived}: {:.1} m² around {middle}{doors}, {}",
        room.called(),
        room.area_m2,
        counted(room.objects.len(), "object")
    )
}

impl RoomFacts {
    fn of(room: PlaceRoom) -> Self {
        let PlaceRoom { id, name, is_derived, middle, area_m2, doors, mut objects } = room;
        let more_objects = objects.len().saturating_sub(MAX_OBJECTS);
        objects.truncate(MAX_OBJECTS);
        let area_m2 = (area_m2 * 10.0).round() / 10.0;
        Self { id, name, name_is_derived: is_derived, middle_m: rounded(middle), area_m2, doors, objects, more_objects }
    }
}

impl Assistant {
    /// The room of a number.
    pub(crate) fn room(&mut self, id: u32) -> Result<PlaceRoom, ToolError> {
        let rooms = self.places()?.rooms();
        let count = rooms.len();
        let found = rooms.into_iter().find(|room| room.id == id);
        found.ok_or_else(|| {
            ToolError(format!("There is no room {id}, only {}: list_rooms has them.", counted(count, "room")))
        })
    }
}
