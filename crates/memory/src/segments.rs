//! The ids that a memory has given.

use crate::{ABSTAIN, MAX_SEGMENT_ID, MemoryError};
use splatseg_geometry::{SegmentId, SegmentMap};
use std::collections::BTreeSet;

/// Ids 1, 2, 3, … and what became of each.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Segments {
    /// Frames in which a prediction had the id, by id − 1.
    sightings: Vec<u32>,
    /// Whether anything carried the id when that was last looked at, by id − 1.
    carried: Vec<bool>,
    /// Ids that were taken back before anything was seen under them: they are given again.
    free: BTreeSet<SegmentId>,
}

impl Segments {
    /// The ids that an earlier run gave, and what it knew of each: both have one entry per id.
    pub fn given(sightings: Vec<u32>, carried: Vec<bool>) -> Self {
        let is_free = |(_, sightings): &(usize, &u32)| **sightings == 0;
        let free = sightings.iter().enumerate().filter(is_free).map(|(index, _)| index as SegmentId + 1).collect();
        Self { sightings, carried, free }
    }

    /// Number of ids given.
    pub fn len(&self) -> usize {
        self.sightings.len()
    }

    /// An id under which nothing was ever seen.
    pub fn add(&mut self) -> Result<SegmentId, MemoryError> {
        if let Some(id) = self.free.pop_first() {
            return Ok(id);
        }
        if self.len() >= MAX_SEGMENT_ID as usize {
            return Err(MemoryError::OutOfIds);
        }
        self.sightings.push(0);
        self.carried.push(false);
        Ok(self.len() as SegmentId)
    }

    /// Takes an id back if nothing was seen under it yet.
    pub fn take_back(&mut self, id: SegmentId) {
        if id != 0 && id as usize <= self.len() && self.sightings(id) == 0 {
            self.free.insert(id);
        }
    }

    /// Counts the ids that a frame's predictions have.
    pub fn note_sightings(&mut self, seen: &SegmentMap) {
        for id in seen.areas().into_keys().filter(|id| *id != ABSTAIN) {
            let count = &mut self.sightings[id as usize - 1];
            *count = count.saturating_add(1);
        }
    }

    /// Frames in which a prediction had the id.
    pub fn sightings(&self, id: SegmentId) -> u32 {
        self.sightings.get((id as usize).wrapping_sub(1)).copied().unwrap_or(0)
    }

    /// Whether anything carried each id when that was last looked at, by id − 1.
    pub fn carried(&self) -> &[bool] {
        &self.carried
    }

    /// Takes note of which ids are carried, by id (0 included), and returns those that were and are not any more.
    pub fn note_carried(&mut self, carried: &[bool]) -> Vec<SegmentId> {
        let mut forgotten = Vec::new();
        for (index, (before, now)) in self.carried.iter_mut().zip(&carried[1..]).enumerate() {
            if *before && !now {
                forgotten.push(index as SegmentId + 1);
            }
            *before = *now;
        }
        forgotten
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seen(ids: &[SegmentId]) -> SegmentMap {
        SegmentMap::from_pixels(ids.len(), 1, ids.to_vec()).unwrap()
    }

    #[test]
    fn ids_count_up_and_are_given_again_only_if_nothing_was_seen_under_them() {
        let mut segments = Segments::default();
        assert_eq!([(); 3].map(|()| segments.add().unwrap()), [1, 2, 3]);
        segments.note_sightings(&seen(&[0, 2, 2, ABSTAIN]));
        // Neither 0, nor an id that was seen, nor one that was never given.
        [0, 2, 4, 3, 1].into_iter().for_each(|id| segments.take_back(id));
        assert_eq!([(); 3].map(|()| segments.add().unwrap()), [1, 3, 4]);
        assert_eq!(segments.len(), 4);
    }

    #[test]
    fn a_frame_counts_once_for_each_id_that_it_shows() {
        let mut segments = Segments::given(vec![5, 0, u32::MAX], vec![false; 3]);
        segments.note_sightings(&seen(&[1, 1, 0, 3, ABSTAIN]));
        assert_eq!([0, 1, 2, 3, 4].map(|id| segments.sightings(id)), [0, 6, 0, u32::MAX, 0]);
        assert_eq!(segments.add().unwrap(), 2, "an earlier run gave it and saw nothing under it");
        assert_eq!(segments.add().unwrap(), 4);
    }

    #[test]
    fn an_id_is_forgotten_when_it_was_carried_and_is_not_any_more() {
        let mut segments = Segments::given(vec![1; 4], vec![true, true, false, false]);
        // By id, 0 included.
        assert_eq!(segments.note_carried(&[true, true, false, true, false]), [2]);
        assert_eq!(segments.carried(), [true, false, true, false]);
        assert_eq!(segments.note_carried(&[false, true, false, false, false]), [3]);
    }

    #[test]
    fn no_more_ids_are_given_than_a_16_bit_image_can_hold() {
        let mut segments =
            Segments::given(vec![1; MAX_SEGMENT_ID as usize - 1], vec![false; MAX_SEGMENT_ID as usize - 1]);
        assert_eq!(segments.add().unwrap(), 65535);
        assert!(matches!(segments.add(), Err(MemoryError::OutOfIds)));
    }
}
