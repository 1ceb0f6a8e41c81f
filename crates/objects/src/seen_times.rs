//! When objects were first and last seen, over all runs of a map.
//!
//! They are saved with a map as arrays:
//!
//! | Array | Type | |
//! |---|---|---|
//! | `id` | `u32 [n]` | the objects, in increasing order |
//! | `time` | `f64 [n, 2]` | stamps of the first and the last frame that showed each, seconds |

use crate::{ObjectList, ObjectSighting};
use splatseg_files::{StateBlock, StateError};
use splatseg_geometry::{RemappedId, SegmentId};
use std::collections::{BTreeMap, BTreeSet};

/// The stamps of the first and the last frame that showed an object, seconds, as the scene stamps its frames.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SeenTime {
    /// The earliest stamp.
    pub first_s: f64,
    /// The latest stamp.
    pub last_s: f64,
}

impl SeenTime {
    fn join(&mut self, other: Self) {
        self.first_s = self.first_s.min(other.first_s);
        self.last_s = self.last_s.max(other.last_s);
    }
}

/// When each object was seen. Objects that only frames without a stamp showed have no entry.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SeenTimes {
    times: BTreeMap<SegmentId, SeenTime>,
}

impl SeenTimes {
    /// True if nothing is known.
    pub fn is_empty(&self) -> bool {
        self.times.is_empty()
    }

    /// When an object was seen.
    pub fn get(&self, id: SegmentId) -> Option<SeenTime> {
        self.times.get(&id).copied()
    }

    /// Records the objects of a frame with this stamp, seconds. A stamp that is not a number is left out.
    pub fn record(&mut self, time_s: f64, sightings: &[ObjectSighting]) {
        let now = SeenTime { first_s: time_s, last_s: time_s };
        for sighting in sightings.iter().filter(|_| time_s.is_finite()) {
            self.times.entry(sighting.id).or_insert(now).join(now);
        }
    }

    /// Forgets an id that is now another object's.
    pub fn forget(&mut self, id: SegmentId) {
        self.times.remove(&id);
    }

    /// Adds the times of ids that turned out to be other ids' objects to those.
    pub fn remap(&mut self, remapped: &[RemappedId]) {
        for RemappedId { from, into } in remapped.iter().filter(|remapped| remapped.from != remapped.into) {
            if let Some(time) = self.times.remove(from) {
                self.add(*into, time);
            }
        }
    }

    /// Adds a time at which an object was seen, too.
    pub fn add(&mut self, id: SegmentId, time: SeenTime) {
        self.times.entry(id).or_insert(time).join(time);
    }

    /// Adds all times of others, by the same ids.
    pub fn join(&mut self, other: &Self) {
        other.times.iter().for_each(|(id, time)| self.add(*id, *time));
    }

    /// Drops the times of all objects but these.
    pub fn keep_only(&mut self, ids: &BTreeSet<SegmentId>) {
        self.times.retain(|id, _| ids.contains(id));
    }

    /// Every time, by id.
    pub fn all(&self) -> impl Iterator<Item = (SegmentId, SeenTime)> {
        self.times.iter().map(|(id, time)| (*id, *time))
    }

    /// The times as arrays, to be saved; none if nothing is known.
    pub fn to_block(&self) -> StateBlock {
        let mut block = StateBlock::default();
        if !self.is_empty() {
            block.put("id", &[], self.times.keys().copied());
            block.put("time", &[2], self.times.values().flat_map(|time| [time.first_s, time.last_s]));
        }
        block
    }

    /// The times from saved arrays; nothing is known if there are none.
    ///
    /// # Errors
    /// If an array is damaged, or a time is impossible.
    pub fn from_block(block: &StateBlock) -> Result<Self, StateError> {
        let ids: Vec<SegmentId> = block.get("id", &[])?;
        let times: Vec<f64> = block.get_rows("time", ids.len(), &[2])?;
        let mut seen = Self::default();
        for (id, [first_s, last_s]) in ids.into_iter().zip(times.as_chunks().0) {
            let (time, name) = (SeenTime { first_s: *first_s, last_s: *last_s }, "time".to_owned());
            let is_possible = first_s.is_finite() && last_s.is_finite() && first_s <= last_s && id != 0;
            if !is_possible || seen.times.insert(id, time).is_some() {
                let found = format!("{first_s} to {last_s} of object {id}");
                return Err(StateError::Array {
                    name,
                    found,
                    expected: "increasing times of different objects".into(),
                });
            }
        }
        Ok(seen)
    }
}

impl ObjectList {
    /// Adds when each object was seen, over all runs of the map.
    pub fn add_seen_times(&mut self, seen: &SeenTimes) {
        for object in self.objects.iter_mut().chain(&mut self.not_counted) {
            let time = seen.get(object.id);
            (object.first_seen_s, object.last_seen_s) = (time.map(|time| time.first_s), time.map(|time| time.last_s));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::BoundingBox;

    fn sighting(id: SegmentId) -> ObjectSighting {
        let bounding_box = BoundingBox { x: 0, y: 0, width: 1, height: 1 };
        ObjectSighting { id, area: 1, bounding_box, confidence: 1.0, first_frame: 0, last_frame: 0 }
    }

    #[test]
    fn times_last_over_joins_and_files() {
        let mut seen = SeenTimes::default();
        seen.record(5.0, &[sighting(1), sighting(2)]);
        seen.record(4.0, &[sighting(1)]);
        seen.record(9.0, &[sighting(3)]);
        seen.record(f64::NAN, &[sighting(4)]);
        seen.remap(&[RemappedId { from: 3, into: 2 }, RemappedId { from: 8, into: 1 }]);
        let expected = [(1, SeenTime { first_s: 4.0, last_s: 5.0 }), (2, SeenTime { first_s: 5.0, last_s: 9.0 })];
        assert_eq!(seen.all().collect::<Vec<_>>(), expected);
        assert_eq!(SeenTimes::from_block(&seen.to_block()).unwrap(), seen);
        assert_eq!(SeenTimes::from_block(&StateBlock::default()).unwrap(), SeenTimes::default());
        let mut damaged = seen.to_block();
        damaged.put("time", &[2], [4.0, 5.0, 9.0, 5.0]);
        assert!(SeenTimes::from_block(&damaged).is_err());
        damaged.put("time", &[2], [4.0, 5.0]);
        assert!(SeenTimes::from_block(&damaged).is_err());
    }
}
