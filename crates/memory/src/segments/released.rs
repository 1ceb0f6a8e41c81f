//! Ids of mistakes and of objects seen only once, to be reused.

use splatseg_geometry::SegmentId;
use std::collections::BTreeMap;

/// Maximum number of released ids. It exceeds the ids that fit a 16-bit image. Further ids are not reused before
/// counting restarts from 1.
const MAX_RELEASED: usize = 1 << 16;

/// Released ids in the order in which they are reused.
#[derive(Clone, Debug, Default)]
pub(super) struct ReleasedIds {
    /// Ids by place in the order.
    order: BTreeMap<i64, SegmentId>,
    /// Place of each id, and the number of frames in which it was predicted: 0 or 1.
    places: BTreeMap<SegmentId, (i64, u32)>,
}

/// A released id as it is saved, and the number of frames in which it was predicted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct SavedRelease(pub SegmentId, pub u32);

impl ReleasedIds {
    /// Restores saved ids.
    ///
    /// # Errors
    /// If there are too many ids, an id occurs twice, or an id was predicted in more than one frame.
    pub fn restored(saved: Vec<SavedRelease>) -> Result<Self, String> {
        if saved.len() > MAX_RELEASED {
            return Err(format!("{} released ids, expected at most {MAX_RELEASED}", saved.len()));
        }
        let mut released = Self::default();
        for SavedRelease(id, sightings) in saved {
            if released.places.contains_key(&id) || sightings > 1 {
                return Err(format!("the released id {id} occurs twice or was seen {sightings} times"));
            }
            released.push_last(id, sightings);
        }
        Ok(released)
    }

    /// Returns the ids to be saved.
    pub fn saved(&self) -> Vec<SavedRelease> {
        let sightings = |id: &SegmentId| self.sightings(*id).unwrap_or_default();
        self.order.values().map(|id| SavedRelease(*id, sightings(id))).collect()
    }

    /// All ids.
    pub fn ids(&self) -> impl Iterator<Item = SegmentId> + '_ {
        self.order.values().copied()
    }

    /// Number of frames in which a released id was predicted; `None` for an id that is not released.
    pub fn sightings(&self, id: SegmentId) -> Option<u32> {
        self.places.get(&id).map(|(_, sightings)| *sightings)
    }

    /// Adds an id that is reused after all others. It must not be released already.
    pub fn push_last(&mut self, id: SegmentId, sightings: u32) {
        if self.order.len() < MAX_RELEASED {
            let place = self.order.last_key_value().map_or(0, |(place, _)| place + 1);
            self.insert(place, id, sightings);
        }
    }

    fn insert(&mut self, place: i64, id: SegmentId, sightings: u32) {
        self.order.insert(place, id);
        self.places.insert(id, (place, sightings));
    }

    /// Removes and returns the id that is reused next.
    pub fn pop_first(&mut self) -> Option<SegmentId> {
        let (_, id) = self.order.pop_first()?;
        self.places.remove(&id);
        Some(id)
    }

    /// Removes an id. Returns the number of frames in which it was predicted, if it was released.
    pub fn remove(&mut self, id: SegmentId) -> Option<u32> {
        let (place, sightings) = self.places.remove(&id)?;
        self.order.remove(&place);
        Some(sightings)
    }
}
