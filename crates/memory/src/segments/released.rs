//! Ids of mistakes and of things that were seen once, to be given again.

use serde::{Deserialize, Serialize};
use splatseg_geometry::SegmentId;
use std::collections::BTreeMap;

/// At most this many are kept. All ids that fit a 16-bit image are fewer; others are not given again before the ids start
/// from 1.
const MAX_RELEASED: usize = 1 << 16;

/// Released ids in the order in which they are given again.
#[derive(Clone, Debug, Default)]
pub(super) struct ReleasedIds {
    /// By place in the order.
    order: BTreeMap<i64, SegmentId>,
    /// Place, and the number of frames that showed the thing: 0 or 1.
    places: BTreeMap<SegmentId, (i64, u32)>,
}

/// A released id as it is saved.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct SavedRelease(SegmentId, u32);

impl ReleasedIds {
    /// The ids that were saved.
    ///
    /// # Errors
    /// If there are too many, or one comes twice.
    pub fn restored(saved: Vec<SavedRelease>) -> Result<Self, String> {
        if saved.len() > MAX_RELEASED {
            return Err(format!("{} released ids, expected at most {MAX_RELEASED}", saved.len()));
        }
        let mut released = Self::default();
        for SavedRelease(id, sightings) in saved {
            if released.places.contains_key(&id) || sightings > 1 {
                return Err(format!("the released id {id} was seen {sightings} times"));
            }
            released.push_last(id, sightings);
        }
        Ok(released)
    }

    /// What is saved.
    pub fn saved(&self) -> Vec<SavedRelease> {
        let sightings = |id: &SegmentId| self.sightings(*id).unwrap_or_default();
        self.order.values().map(|id| SavedRelease(*id, sightings(id))).collect()
    }

    /// All ids.
    pub fn ids(&self) -> impl Iterator<Item = SegmentId> + '_ {
        self.order.values().copied()
    }

    /// In how many frames the thing of a released id was seen.
    pub fn sightings(&self, id: SegmentId) -> Option<u32> {
        self.places.get(&id).map(|(_, sightings)| *sightings)
    }

    /// Adds an id that is given again after all others; it must not be released yet.
    pub fn push_last(&mut self, id: SegmentId, sightings: u32) {
        if self.order.len() < MAX_RELEASED {
            let place = self.order.last_key_value().map_or(0, |(place, _)| place + 1);
            self.insert(place, id, sightings);
        }
    }

    /// Adds an id that is given again before all others; it must not be released yet.
    pub fn push_first(&mut self, id: SegmentId, sightings: u32) {
        let place = self.order.first_key_value().map_or(0, |(place, _)| place - 1);
        self.insert(place, id, sightings);
    }

    fn insert(&mut self, place: i64, id: SegmentId, sightings: u32) {
        self.order.insert(place, id);
        self.places.insert(id, (place, sightings));
    }

    /// The id that is given again next, and the number of frames that showed its thing.
    pub fn pop_first(&mut self) -> Option<(SegmentId, u32)> {
        let (_, id) = self.order.pop_first()?;
        self.places.remove(&id).map(|(_, sightings)| (id, sightings))
    }

    /// Removes an id; returns the number of frames that showed its thing if it was there.
    pub fn remove(&mut self, id: SegmentId) -> Option<u32> {
        let (place, sightings) = self.places.remove(&id)?;
        self.order.remove(&place);
        Some(sightings)
    }
}
