//! The ids of a run that turned out to be the same object, and when.

use serde::{Deserialize, Serialize};
use splatseg_geometry::{RemappedId, SegmentId};
use std::collections::BTreeMap;

/// Ids that turned out to be the same object as another id, in the order in which this was found.
///
/// Numbers of ids can be reused, so each entry applies only to the frames before the one that brought it.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct RemapLog {
    entries: Vec<(usize, RemappedId)>,
}

impl RemapLog {
    /// Adds the ids that turned out to be the same object just before frame `frame`. Frames must not decrease.
    pub fn add(&mut self, frame: usize, remapped: &[RemappedId]) {
        self.entries.extend(remapped.iter().map(|remapped| (frame, *remapped)));
    }

    /// True if no ids turned out to be the same object.
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// Every pair of ids, with the frame that brought it, in order.
    pub fn entries(&self) -> &[(usize, RemappedId)] {
        &self.entries
    }

    /// The final ids of the ids in frame `frame` that changed later.
    pub fn final_ids(&self, frame: usize) -> BTreeMap<SegmentId, SegmentId> {
        let mut ids = BTreeMap::new();
        for (_, RemappedId { from, into }) in self.entries.iter().rev().take_while(|(found, _)| *found > frame) {
            let last = ids.get(into).copied().unwrap_or(*into);
            ids.insert(*from, last);
        }
        ids.retain(|from, into| from != into);
        ids
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chains_are_followed_and_only_earlier_frames_change() {
        let mut log = RemapLog::default();
        assert!(log.is_empty() && log.final_ids(0).is_empty());
        log.add(10, &[RemappedId { from: 9, into: 5 }]);
        log.add(20, &[RemappedId { from: 5, into: 3 }, RemappedId { from: 8, into: 5 }]);
        assert_eq!(log.final_ids(9), BTreeMap::from([(9, 3), (5, 3), (8, 5)]));
        assert_eq!(log.final_ids(10), BTreeMap::from([(5, 3), (8, 5)]));
        assert_eq!(log.final_ids(20), BTreeMap::new());
    }

    #[test]
    fn a_reused_number_is_a_different_object() {
        let mut log = RemapLog::default();
        log.add(10, &[RemappedId { from: 9, into: 5 }]);
        // 9 was given to a new object after frame 10.
        log.add(30, &[RemappedId { from: 9, into: 7 }]);
        assert_eq!(log.final_ids(2), BTreeMap::from([(9, 5)]));
        assert_eq!(log.final_ids(15), BTreeMap::from([(9, 7)]));
    }
}
