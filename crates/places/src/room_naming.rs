//! Names of rooms: those that a person gave, and those that their objects tell.

use crate::room_kinds::room_kind;
use crate::{FloorPlan, Room};
use glam::DVec3;
use splatseg_geometry::SegmentId;
use splatseg_objects::{ObjectName, ObjectNames, RoomNameSource};
use std::collections::BTreeMap;

/// A named place that is in no room any more names the nearest room at most this far away, metres: maps are corrected.
const NEAR: f64 = 1.0;
/// A label that a network gave tells what a room is from this score on.
const CERTAIN: f32 = 0.5;

impl FloorPlan {
    /// Names the rooms: by the names that a person gave, else by what is certain from their objects' labels. Names of
    /// before are forgotten.
    pub fn name_rooms(&mut self, names: &ObjectNames) {
        let mut found: BTreeMap<u32, (String, RoomNameSource)> = BTreeMap::new();
        let mut labels: BTreeMap<u32, Vec<&str>> = BTreeMap::new();
        for (id, label) in certain_labels(names) {
            if let Some(room) = self.room_of(id) {
                labels.entry(room.id).or_default().push(label);
            }
        }
        for (room, labels) in labels {
            if let Some(kind) = room_kind(labels.into_iter()) {
                found.insert(room, (kind.to_owned(), RoomNameSource::Derived));
            }
        }
        // Of two names, the later one holds.
        for given in names.rooms().iter() {
            if let Some(room) = self.room_around(given.place) {
                found.insert(room.id, (given.name.clone(), RoomNameSource::ByHand));
            }
        }
        for room in self.rooms_mut() {
            (room.name, room.name_source) = found.remove(&room.id).unzip();
        }
    }

    /// The room of a place of the world, metres; the nearest one within a metre if it is in none.
    pub fn room_around(&self, point_world: DVec3) -> Option<&Room> {
        let place = self.frame().to_plan(point_world);
        self.room_at(place).or_else(|| {
            let shape = &self.grid().shape;
            let apart = |cell: &usize| shape.center(*cell).distance(place);
            let near = shape.within(place, NEAR).into_iter().filter(|cell| self.room_of_cell(*cell) != 0);
            let nearest = near.min_by(|one, other| apart(one).total_cmp(&apart(other)).then(one.cmp(other)))?;
            self.room_at(shape.center(nearest))
        })
    }

    /// A place of the world by which a room is found again: where it is widest, on the floor.
    pub fn place_of(&self, room: &Room) -> DVec3 {
        self.frame().to_world(room.middle)
    }
}

/// The labels that a person gave, or a network that was sure.
fn certain_labels(names: &ObjectNames) -> impl Iterator<Item = (SegmentId, &str)> {
    let is_certain = |name: &ObjectName| name.by_hand || name.score.is_none_or(|score| score >= CERTAIN);
    let certain = names.all().filter(move |(_, name, _)| is_certain(name));
    certain.filter_map(|(id, name, _)| Some((id, name.label.as_deref()?)))
}
