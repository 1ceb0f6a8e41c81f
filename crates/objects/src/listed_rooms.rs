//! The rooms of `objects.json`.

use crate::{ObjectList, RoomNameSource};
use glam::DVec3;
use serde::{Deserialize, Serialize};
use splatseg_geometry::SegmentId;
use std::collections::BTreeMap;

/// A room.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ListedRoom {
    /// Its number, from 1, which stays the same while the map is continued.
    pub id: u32,
    /// Its name; null without one.
    pub name: Option<String>,
    /// Who gave the name; null without one.
    #[serde(default)]
    pub name_source: Option<RoomNameSource>,
    /// Area of its floor, furniture included, square metres.
    pub area_m2: f64,
    /// Where it is widest: a point on the floor, world coordinates, metres.
    pub middle: DVec3,
    /// Outlines of its floor, world coordinates, metres: counter-clockwise around each part, seen from above, and clockwise
    /// around holes.
    pub outlines: Vec<Vec<DVec3>>,
    /// The objects in it that count, by id.
    #[serde(default)]
    pub objects: Vec<SegmentId>,
}

impl ObjectList {
    /// Sets the rooms, and the room of each object that is in one. [`ListedRoom::objects`] follows from that.
    pub fn set_rooms(&mut self, rooms: Vec<ListedRoom>, of_objects: &BTreeMap<SegmentId, u32>) {
        for object in self.objects.iter_mut().chain(&mut self.not_counted) {
            object.room = of_objects.get(&object.id).copied().filter(|room| rooms.iter().any(|one| one.id == *room));
        }
        self.rooms = rooms;
        for room in &mut self.rooms {
            let inside = self.objects.iter().filter(|object| object.room == Some(room.id));
            room.objects = inside.map(|object| object.id).collect();
            room.objects.sort_unstable();
        }
    }
}
