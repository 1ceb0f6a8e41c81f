//! The numbers of rooms, so that a room keeps its own from one plan of a map to the next.
//!
//! They are saved with a map as arrays:
//!
//! | Array | Type | |
//! |---|---|---|
//! | `id` | `u32 [n]` | the rooms, in increasing order |
//! | `middle` | `f64 [n, 3]` | where each is widest: a point on its floor, world coordinates, metres |

use crate::FloorPlan;
use crate::outline::outlines;
use glam::{DVec2, DVec3};
use splatseg_files::{StateBlock, StateError};
use splatseg_geometry::{KeyframeId, MapCorrection, SegmentId};
use splatseg_objects::moved_with_nearest;
use std::collections::{BTreeMap, BTreeSet};

/// The rooms of earlier plans of a map: the middle of each, world coordinates, metres. They stay known if a later plan does
/// not have them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct KnownRooms {
    middles: BTreeMap<u32, DVec3>,
}

impl KnownRooms {
    /// True if no plan had a room.
    pub fn is_empty(&self) -> bool {
        self.middles.is_empty()
    }

    /// Moves each room with the keyframe whose camera, at these world coordinates before the correction, was nearest.
    pub fn correct(&mut self, correction: &MapCorrection, cameras: &[(KeyframeId, DVec3)]) {
        for middle in self.middles.values_mut() {
            *middle = moved_with_nearest(correction, cameras, *middle);
        }
    }

    /// The rooms as arrays, to be saved; none without rooms.
    pub fn to_block(&self) -> StateBlock {
        let mut block = StateBlock::default();
        if !self.is_empty() {
            block.put("id", &[], self.middles.keys().copied());
            block.put("middle", &[3], self.middles.values().flat_map(DVec3::to_array));
        }
        block
    }

    /// The rooms from saved arrays.
    ///
    /// # Errors
    /// If an array is damaged, or a number impossible.
    pub fn from_block(block: &StateBlock) -> Result<Self, StateError> {
        let ids: Vec<u32> = block.get("id", &[])?;
        let middles: Vec<f64> = block.get_rows("middle", ids.len(), &[3])?;
        let mut rooms = Self::default();
        for (id, middle) in ids.into_iter().zip(middles.as_chunks::<3>().0) {
            let middle = DVec3::from_array(*middle);
            // The next room must get a number, too.
            let is_possible = middle.is_finite() && id != 0 && id < u32::MAX;
            if !is_possible || rooms.middles.insert(id, middle).is_some() {
                let (name, found) = ("middle".to_owned(), format!("{middle} of room {id}"));
                return Err(StateError::Array { name, found, expected: "places of different rooms".to_owned() });
            }
        }
        Ok(rooms)
    }
}

impl FloorPlan {
    /// Gives each room the number of the known one whose middle is in it, the lowest one if there are several. Other rooms get
    /// numbers that no room had before. `known` then has all of them, where they are now.
    pub fn keep_room_ids(&mut self, known: &mut KnownRooms) {
        let mut ids: BTreeMap<u32, u32> = BTreeMap::new();
        for (id, middle) in &known.middles {
            if let Some(room) = self.room_at(self.frame().to_plan(*middle)) {
                ids.entry(room.id).or_insert(*id);
            }
        }
        let mut last = known.middles.last_key_value().map_or(0, |(id, _)| *id);
        for room in self.rooms() {
            ids.entry(room.id).or_insert_with(|| {
                last = last.saturating_add(1);
                last
            });
        }
        self.number_rooms(&ids);
        let middles = self.rooms().iter().map(|room| (room.id, self.frame().to_world(room.middle)));
        known.middles.extend(middles.collect::<Vec<_>>());
    }

    /// The outlines of a room's floor, furniture included, in the plan's coordinates, metres: counter-clockwise around each
    /// part, clockwise around holes. Empty if there is no such room.
    pub fn room_outlines(&self, room: u32) -> Vec<Vec<DVec2>> {
        let shape = &self.grid().shape;
        let is_inside = |cell: &usize| self.is_room_floor(*cell) && self.room_of_cell(*cell) == room;
        let cells: BTreeSet<usize> = (0..shape.len()).filter(is_inside).collect();
        let mut found = outlines(shape, &cells);
        // Of a hole of a few cells, less than a triangle is left.
        found.retain(|outline| outline.len() > 2);
        found
    }

    /// The room of each object that is in one.
    pub fn rooms_of_objects(&self) -> BTreeMap<SegmentId, u32> {
        self.footprints().keys().filter_map(|id| Some((*id, self.room_of(*id)?.id))).collect()
    }
}
