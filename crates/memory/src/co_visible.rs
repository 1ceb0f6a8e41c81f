//! Which ids were shown side by side in one frame: they are different objects, so no correction merges them.
//!
//! The pairs of a frame grow with the square of its ids, so their number is bounded. An id with too many partners is
//! *crowded*: its partners are not listed any more, and it counts as shown beside every other id. So the rule holds for
//! any number of ids; the price is that a crowded id keeps its copy when a loop is closed.

use splatseg_geometry::{RemappedId, SegmentId, SegmentMap};
use std::collections::{BTreeMap, BTreeSet};

/// A frame that shows more ids than this, not counting crowded ones, makes all of them crowded. Segmenters find up to 200
/// objects in a room.
const MAX_LISTED_IDS: usize = 1024;

/// Beyond this number of pairs, the ids with the most partners become crowded. They take up to 8 MB in a saved map. All
/// pairs of a frame with [`MAX_LISTED_IDS`] fit.
const MAX_PAIRS: usize = 1 << 20;

/// Number of pairs to keep then: fewer than the maximum, so that the next frames do not exceed it again.
const KEPT_PAIRS: usize = MAX_PAIRS / 16 * 15;

/// Saved form of [`CoVisibleIds`]: the pairs, the smaller id first, and the crowded ids.
pub(crate) type SavedPairs = (Vec<[SegmentId; 2]>, Vec<SegmentId>);

/// Pairs of ids that were shown side by side in one frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct CoVisibleIds {
    /// For each id the larger ones. Crowded ids are left out.
    larger: BTreeMap<SegmentId, BTreeSet<SegmentId>>,
    /// Number of these pairs.
    pairs: usize,
    /// Ids that were shown beside too many others to list them.
    crowded: BTreeSet<SegmentId>,
}

impl CoVisibleIds {
    /// Records the ids that a frame shows.
    pub fn record(&mut self, segments: &SegmentMap) {
        let ids: Vec<SegmentId> =
            segments.areas().into_keys().filter(|id| *id != 0 && !self.crowded.contains(id)).collect();
        if ids.len() > MAX_LISTED_IDS {
            self.crowd(&ids.into_iter().collect());
            return;
        }
        for (index, id) in ids.iter().enumerate() {
            if let Some(larger) = ids.get(index + 1..).filter(|larger| !larger.is_empty()) {
                let listed = self.larger.entry(*id).or_default();
                let before = listed.len();
                listed.extend(larger);
                self.pairs += listed.len() - before;
            }
        }
        self.keep_bounded();
    }

    /// True if two ids were shown side by side, or that is unknown.
    pub fn contains(&self, one: SegmentId, other: SegmentId) -> bool {
        let is_crowded = self.crowded.contains(&one) || self.crowded.contains(&other);
        is_crowded || self.larger.get(&one.min(other)).is_some_and(|larger| larger.contains(&one.max(other)))
    }

    /// Forgets ids.
    pub fn remove(&mut self, ids: &[SegmentId]) {
        if ids.is_empty() {
            return;
        }
        let ids = ids.iter().copied().collect();
        self.remove_pairs(&ids);
        self.crowded.retain(|id| !ids.contains(id));
    }

    /// Transfers what is known about an id to another one.
    pub fn remap(&mut self, RemappedId { from, into }: RemappedId) {
        let mut others = self.larger.get(&from).cloned().unwrap_or_default();
        others.extend(self.larger.iter().filter(|(_, larger)| larger.contains(&from)).map(|(id, _)| *id));
        self.remove_pairs(&BTreeSet::from([from]));
        if self.crowded.remove(&from) {
            self.crowd(&BTreeSet::from([into]));
        }
        self.add(others.into_iter().map(|other| (into, other)));
    }

    /// Adds what is known about the ids of another map, which are `names` here.
    pub fn append(&mut self, other: &Self, names: &BTreeMap<SegmentId, SegmentId>) {
        let named = |id: &SegmentId| names.get(id).copied();
        self.crowded.extend(other.crowded.iter().filter_map(named));
        for (id, larger) in &other.larger {
            let Some(id) = named(id) else { continue };
            self.add(larger.iter().filter_map(|other| Some((id, named(other)?))));
            self.keep_bounded();
        }
    }

    /// The pairs to be saved.
    pub fn saved(&self) -> SavedPairs {
        let pairs = self.larger.iter().flat_map(|(id, larger)| larger.iter().map(|other| [*id, *other]));
        (pairs.collect(), self.crowded.iter().copied().collect())
    }

    /// Restores [`Self::saved`]. Files of earlier versions may have more pairs than are kept.
    pub fn restored((pairs, crowded): SavedPairs) -> Self {
        let mut restored = Self { crowded: crowded.into_iter().collect(), ..Self::default() };
        for of_one_id in pairs.chunk_by(|[one, _], [other, _]| one == other) {
            restored.add(of_one_id.iter().map(|[one, other]| (*one, *other)));
            restored.keep_bounded();
        }
        restored
    }

    /// Lists pairs, except those of crowded ids.
    fn add(&mut self, pairs: impl Iterator<Item = (SegmentId, SegmentId)>) {
        for (one, other) in pairs {
            let is_listed = one != other && !self.crowded.contains(&one) && !self.crowded.contains(&other);
            if is_listed && self.larger.entry(one.min(other)).or_default().insert(one.max(other)) {
                self.pairs += 1;
            }
        }
    }

    fn crowd(&mut self, ids: &BTreeSet<SegmentId>) {
        self.remove_pairs(ids);
        self.crowded.extend(ids);
    }

    fn remove_pairs(&mut self, ids: &BTreeSet<SegmentId>) {
        self.larger.retain(|id, larger| {
            // The shorter way: most often one id is forgotten.
            if ids.len() < larger.len() {
                ids.iter().for_each(|gone| _ = larger.remove(gone));
            } else {
                larger.retain(|other| !ids.contains(other));
            }
            !ids.contains(id) && !larger.is_empty()
        });
        self.pairs = self.larger.values().map(BTreeSet::len).sum();
    }

    /// Makes the ids with the most partners crowded if there are too many pairs.
    fn keep_bounded(&mut self) {
        if self.pairs <= MAX_PAIRS {
            return;
        }
        while self.pairs > KEPT_PAIRS {
            let most = self.with_most_partners(self.pairs - KEPT_PAIRS);
            self.crowd(&most);
        }
    }

    /// The ids with the most partners, until these are at least so many. Pairs of two of them count twice.
    fn with_most_partners(&self, wanted: usize) -> BTreeSet<SegmentId> {
        let mut partners: BTreeMap<SegmentId, usize> = BTreeMap::new();
        for (id, larger) in &self.larger {
            *partners.entry(*id).or_default() += larger.len();
            larger.iter().for_each(|other| *partners.entry(*other).or_default() += 1);
        }
        let mut order: Vec<(usize, SegmentId)> = partners.into_iter().map(|(id, partners)| (partners, id)).collect();
        order.sort_unstable_by_key(|(partners, id)| (std::cmp::Reverse(*partners), *id));
        let mut found = 0;
        let is_needed = |(partners, _): &(usize, SegmentId)| {
            let is_needed = found < wanted;
            found += partners;
            is_needed
        };
        order.into_iter().take_while(is_needed).map(|(_, id)| id).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(ids: impl Iterator<Item = SegmentId>) -> SegmentMap {
        let ids: Vec<SegmentId> = ids.collect();
        SegmentMap::from_pixels(ids.len(), 1, ids).unwrap()
    }

    #[test]
    fn ids_of_a_frame_are_pairs_until_they_are_forgotten_or_renamed() {
        let mut together = CoVisibleIds::default();
        together.record(&frame([0, 2, 5, 9].into_iter()));
        together.record(&frame([5, 7].into_iter()));
        let listed = [(2, 5), (2, 9), (5, 7), (5, 9)];
        assert!(listed.iter().all(|(one, other)| together.contains(*other, *one)) && together.pairs == listed.len());
        assert!(!together.contains(2, 7) && !together.contains(0, 2));
        together.remap(RemappedId { from: 9, into: 7 });
        assert!(together.contains(2, 7) && together.contains(5, 7) && !together.contains(2, 9));
        assert_eq!(together.pairs, 3);
        together.remove(&[5, 3]);
        assert_eq!((together.pairs, together.contains(2, 7)), (1, true));
        assert_eq!(CoVisibleIds::restored(together.saved()), together);
    }

    #[test]
    fn crowded_ids_are_never_merged_and_take_little() {
        let mut together = CoVisibleIds::default();
        together.record(&frame(1..=10));
        let many = 3_000;
        together.record(&frame(5..=many));
        assert!(together.contains(5, many) && together.contains(77, 1_000_000) && together.contains(1, 5));
        assert!(together.contains(1, 4) && !together.contains(1, 1_000_000));
        assert_eq!((together.pairs, together.crowded.len()), (6, many as usize - 4));
        assert_eq!(CoVisibleIds::restored(together.saved()), together);
        together.remap(RemappedId { from: 5, into: 2 });
        assert!(together.contains(2, 1_000_000), "what is known of 5 is now known of 2");
        together.remove(&(1..=many).collect::<Vec<_>>());
        assert_eq!(together, CoVisibleIds::default());
    }

    #[test]
    fn however_many_ids_come_the_pairs_are_bounded_and_none_is_lost() {
        let mut together = CoVisibleIds::default();
        // One id is in every frame; the others are seen once.
        let ids = |number: SegmentId| (1..2).chain(2 + number * 1000..1002 + number * 1000);
        for number in 0..3 {
            together.record(&frame(ids(number)));
            assert!(together.pairs <= MAX_PAIRS, "{}", together.pairs);
        }
        assert!(together.crowded.contains(&1), "it has the most partners");
        for number in 0..3 {
            let ids: Vec<SegmentId> = ids(number).collect();
            let ends = [(0, 1), (0, 999), (3, 700), (999, 1000)];
            assert!(ends.iter().all(|(one, other)| together.contains(ids[*one], ids[*other])), "frame {number}");
        }
        assert!(together.crowded.len() < 3000 && together.larger.len() > 500, "{}", together.crowded.len());
    }

    #[test]
    fn the_pairs_of_older_files_are_bounded_too() {
        let all = (1..2000).flat_map(|id| (id + 1..=2000).map(move |other| [id, other])).collect();
        let restored = CoVisibleIds::restored((all, Vec::new()));
        assert!(restored.pairs <= MAX_PAIRS && restored.contains(1, 2000) && restored.contains(1200, 1300));
        assert!(!restored.contains(2001, 2002));
        // Damaged ones, too.
        let restored = CoVisibleIds::restored((vec![[5, 5], [5, 3], [5, 3]], vec![8]));
        assert!(restored.contains(3, 5) && restored.contains(8, 9) && restored.pairs == 1);
    }
}
