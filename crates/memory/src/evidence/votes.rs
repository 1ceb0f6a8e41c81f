//! The votes of one Gaussian.

use splatseg_geometry::SegmentId;

/// Votes below this are dropped to make room.
const NEGLIGIBLE: f32 = 0.02;

/// Votes of one Gaussian: up to four segments and the votes for each.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Votes {
    ids: [SegmentId; Self::SLOTS],
    /// 0 where the slot is empty.
    votes: [f32; Self::SLOTS],
}

impl Votes {
    /// Maximum number of segments that a Gaussian has votes for.
    pub const SLOTS: usize = 4;

    /// Votes for one segment.
    pub fn one(id: SegmentId, votes: f32) -> Self {
        let mut one = Self::default();
        one.ids[0] = id;
        one.votes[0] = votes;
        one
    }

    /// Creates votes from slots: segment and votes. An empty slot has 0 votes, and its segment is ignored.
    pub fn from_slots(slots: [(SegmentId, f32); Self::SLOTS]) -> Self {
        Self { ids: slots.map(|(id, _)| id), votes: slots.map(|(_, votes)| votes) }
    }

    /// Returns the slots in the form of [`Votes::from_slots`].
    pub fn slots(&self) -> [(SegmentId, f32); Self::SLOTS] {
        std::array::from_fn(|slot| (self.ids[slot], self.votes[slot]))
    }

    /// Iterates over the segments with votes and their votes.
    #[inline(always)]
    pub fn iter(&self) -> impl Iterator<Item = (SegmentId, f32)> + '_ {
        self.ids.iter().copied().zip(self.votes).filter(|(_, votes)| *votes > 0.0)
    }

    /// Adds votes for a segment. If all slots belong to other segments, it replaces the weakest one if it has more
    /// votes.
    pub fn add(&mut self, id: SegmentId, votes: f32) {
        let known = (0..Self::SLOTS).find(|slot| self.votes[*slot] > 0.0 && self.ids[*slot] == id);
        if let Some(slot) = known {
            self.votes[slot] += votes;
            return;
        }
        let mut weakest = 0;
        for slot in 1..Self::SLOTS {
            if self.votes[slot] < self.votes[weakest] {
                weakest = slot;
            }
        }
        if votes > self.votes[weakest] {
            self.ids[weakest] = id;
            self.votes[weakest] = votes;
        }
    }

    /// The same votes for other ids; votes for ids with the same new name are added up.
    pub(super) fn renamed(&self, name: impl Fn(SegmentId) -> SegmentId) -> Self {
        let mut renamed = Self::default();
        self.iter().for_each(|(id, votes)| renamed.add(name(id), votes));
        renamed
    }

    /// Scales the votes down to a sum of at most `max`, so that new ones keep their weight, and drops negligible ones.
    pub fn cap(&mut self, max: f32) {
        let sum: f32 = self.votes.iter().sum();
        let scale = if sum > max { max / sum } else { 1.0 };
        for votes in &mut self.votes {
            *votes *= scale;
            if *votes < NEGLIGIBLE {
                *votes = 0.0;
            }
        }
    }

    /// True if the same slots have votes for the same segments.
    pub(super) fn has_same_ids(&self, other: &Self) -> bool {
        self.slots().into_iter().zip(other.slots()).all(|((id, votes), (other_id, other_votes))| {
            (votes > 0.0) == (other_votes > 0.0) && (id == other_id || votes <= 0.0)
        })
    }

    /// Returns the segment with the most votes, the smallest id of equals; 0 without votes.
    pub fn winner(&self) -> SegmentId {
        let best = self.iter().max_by(|a, b| a.1.total_cmp(&b.1).then(b.0.cmp(&a.0)));
        best.map_or(0, |(id, _)| id)
    }

    /// Returns the votes for the segment with the most; 0 without votes.
    pub fn most(&self) -> f32 {
        self.iter().map(|(_, votes)| votes).fold(0.0, f32::max)
    }

    /// Returns the share, 0 to 1, of all votes that are for a segment; 0 without votes.
    pub fn share(&self, id: SegmentId) -> f32 {
        let (own, all) = self
            .iter()
            .fold((0.0, 0.0), |(own, all), (other, votes)| (if other == id { own + votes } else { own }, all + votes));
        if all > 0.0 { own / all } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_share_is_of_all_votes() {
        let mut votes = Votes::one(7, 3.0);
        votes.add(2, 1.0);
        assert_eq!([7, 2, 5].map(|id| votes.share(id)), [0.75, 0.25, 0.0]);
        assert_eq!(Votes::default().share(0), 0.0);
    }

    #[test]
    fn many_votes_outweigh_one_wrong_mask() {
        let mut votes = Votes::one(7, 1.0);
        (0..9).for_each(|_| votes.add(7, 1.0));
        votes.cap(4.0);
        votes.add(3, 1.0);
        assert_eq!(votes.winner(), 7);
    }

    #[test]
    fn new_votes_outweigh_capped_ones() {
        let mut votes = Votes::one(7, 1.0);
        for _ in 0..1000 {
            votes.add(7, 1.0);
            votes.cap(4.0);
        }
        let frames = (1..=5).find(|_| {
            votes.add(3, 1.0);
            votes.cap(4.0);
            votes.winner() == 3
        });
        assert!(frames.is_some(), "{votes:?}");
    }

    #[test]
    fn the_weakest_makes_room_for_a_stronger_one() {
        let mut votes = Votes::default();
        for (id, count) in [(1, 0.5), (2, 0.4), (3, 0.3), (4, 0.2)] {
            votes.add(id, count);
        }
        votes.add(5, 0.1);
        assert_eq!(votes.iter().map(|(id, _)| id).collect::<Vec<_>>(), [1, 2, 3, 4]);
        votes.add(5, 1.0);
        assert_eq!(votes.iter().map(|(id, _)| id).collect::<Vec<_>>(), [1, 2, 3, 5]);
        assert_eq!(votes.winner(), 5);
        assert_eq!((Votes::one(1, 0.2).winner(), Votes::default().winner()), (1, 0));
    }
}
