//! Kinds of synthetic scenes.

use serde::{Deserialize, Serialize};
use std::fmt;

/// Doors of a corridor.
pub(super) const DOORS: std::ops::RangeInclusive<usize> = 1..=100;

/// Layout of a synthetic scene and the camera's path through it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Layout {
    /// A furnished room of 6 × 5.2 m. The camera walks around its centre in 48 frames at speed 1, and looks across it.
    #[default]
    Room,
    /// Written `tour=4` or `tour=1`: this number of furnished rooms, as seen by a camera that walks through at 30 frames
    /// per second, at most 1.5 cm and 1.5 degrees per frame at speed 1. Every round has the same poses as the first.
    ///
    /// With 4, rooms of 4.5 × 4.5 m lie in a ring and are joined by open doorways; a round takes 1800 frames. They
    /// share the textures of floor and ceiling and the pattern of the walls, in slightly different tints. Two fifths of
    /// the things are twins of others, in the same and in other rooms: equal in shape, size and texture. With 1, a round
    /// through the only room, of 6 × 6 m, takes 600 frames.
    Tour(usize),
    /// Written `corridor=20`: a corridor, 1.8 m wide and 2.5 m high, with 1 to 100 identical doors on one side, 1.5 m
    /// apart. Walls, floor and ceiling repeat at this distance too. Only the ends are unique: their walls, and a thing
    /// beside each. The camera walks along it at 30 frames per second, 1.2 cm per frame at speed 1, looking obliquely at
    /// the doors, and stands still at the end.
    Corridor(usize),
}

impl Layout {
    /// Returns the setting's name, value, and description of the allowed values if the value is not allowed.
    pub(super) fn wrong_count(self) -> Option<(&'static str, usize, &'static str)> {
        match self {
            Self::Tour(rooms) if rooms != 1 && rooms != 4 => Some(("tour", rooms, "1 or 4 rooms")),
            Self::Corridor(doors) if !DOORS.contains(&doors) => Some(("corridor", doors, "1 to 100 doors")),
            _ => None,
        }
    }
}

impl fmt::Display for Layout {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Room => formatter.write_str("room"),
            Self::Tour(rooms) => write!(formatter, "tour={rooms}"),
            Self::Corridor(doors) => write!(formatter, "corridor={doors}"),
        }
    }
}
