//! Number of Gaussians that hold each id, updated where votes change.

use super::Votes;
use crate::SegmentHold;
use splatseg_geometry::SegmentId;
use std::collections::{BTreeMap, BTreeSet};

/// Number of Gaussians that hold an id, or a change of that number.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Holders {
    /// Gaussians that show the id by themselves.
    showing: i64,
    /// Gaussians with votes for the id.
    voting: i64,
}

/// Changes in how Gaussians hold ids.
#[derive(Clone, Debug, Default)]
pub(super) struct CensusChanges(BTreeMap<SegmentId, Holders>);

/// Numbers of holders of all ids that any Gaussian has votes for.
#[derive(Clone, Debug, Default)]
pub(super) struct Census {
    holders: BTreeMap<SegmentId, Holders>,
    /// Ids whose counts have changed since [`Census::take_changes`].
    changed: BTreeSet<SegmentId>,
}

impl CensusChanges {
    /// Adds a Gaussian.
    pub fn add(&mut self, votes: &Votes) {
        self.count(votes, 1);
    }

    /// Removes a Gaussian.
    pub fn remove(&mut self, votes: &Votes) {
        self.count(votes, -1);
    }

    /// Replaces the votes of a Gaussian.
    pub fn replace(&mut self, before: &Votes, after: &Votes) {
        if before.has_same_ids(after) && before.winner() == after.winner() {
            return;
        }
        self.remove(before);
        self.add(after);
    }

    fn count(&mut self, votes: &Votes, by: i64) {
        let shown = votes.winner();
        for (id, _) in votes.iter().filter(|(id, _)| *id != 0) {
            let holders = self.0.entry(id).or_default();
            holders.voting += by;
            holders.showing += if id == shown { by } else { 0 };
        }
    }

    /// Adds the changes in other Gaussians.
    pub fn merge(&mut self, other: Self) {
        for (id, change) in other.0 {
            let holders = self.0.entry(id).or_default();
            holders.showing += change.showing;
            holders.voting += change.voting;
        }
    }
}

impl Census {
    /// Applies changes.
    pub fn apply(&mut self, changes: CensusChanges) {
        for (id, change) in changes.0.into_iter().filter(|(_, change)| *change != Holders::default()) {
            let holders = self.holders.entry(id).or_default();
            holders.showing += change.showing;
            holders.voting += change.voting;
            if *holders == Holders::default() {
                self.holders.remove(&id);
            }
            self.changed.insert(id);
        }
    }

    /// Returns the ids whose counts have changed since the last call, and how they are held now.
    pub fn take_changes(&mut self) -> Vec<(SegmentId, SegmentHold)> {
        let hold = |id: SegmentId| match self.holders.get(&id) {
            Some(holders) if holders.showing > 0 => (id, SegmentHold::Shown),
            Some(_) => (id, SegmentHold::Votes),
            None => (id, SegmentHold::Nothing),
        };
        std::mem::take(&mut self.changed).into_iter().map(hold).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::super::EvidenceStore;
    use super::*;
    use crate::segment_store::SegmentStore;
    use crate::{GrowthRule, MemorySettings, SplatMemory};
    use proptest::prelude::*;
    use splatseg_geometry::{Image, Intrinsics, Pose, RgbdFrame, SegmentMap};

    const SIZE: (usize, usize) = (24, 16);

    fn wall(depth: f32) -> RgbdFrame<'static> {
        let (width, height) = SIZE;
        let camera = Intrinsics { fx: 20.0, fy: 20.0, cx: 11.5, cy: 7.5, width, height };
        let (color, depth) = (Image::filled(width, height, [0; 3]), Image::filled(width, height, depth));
        RgbdFrame::new("0", color, depth, camera, Pose::IDENTITY).unwrap()
    }

    /// Counts from scratch how the map holds ids.
    fn counted(memory: &SplatMemory) -> BTreeMap<SegmentId, SegmentHold> {
        let Some(crate::SplatContentView::Evidence { votes }) = memory.store.content() else { panic!("no votes") };
        let mut store = EvidenceStore::restored(memory.settings.clone(), votes.to_vec());
        store.changed_holds().unwrap().into_iter().collect()
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 24, failure_persistence: None, ..ProptestConfig::default() })]

        #[test]
        fn counted_changes_equal_a_census_of_the_whole_map(
            frames in proptest::collection::vec((0usize..24, 1usize..9, prop_oneof![Just(2.0f32), Just(3.0)]), 4..24),
            max_gaussians in prop_oneof![Just(1_000_000usize), Just(60)],
            growth in prop_oneof![Just(GrowthRule::Missing), Just(GrowthRule::Paper)],
        ) {
            let settings = MemorySettings::default().with(|settings| {
                settings.max_gaussians = max_gaussians;
                settings.growth = growth;
                settings.max_votes = 3.0;
            });
            let mut memory = SplatMemory::new(settings, 0, &mut |_| {}).unwrap();
            let (mut carried, mut holds) = (BTreeSet::new(), BTreeMap::new());
            for (shift, stripe, depth) in frames {
                let frame = wall(depth);
                let base = memory.new_segment().unwrap();
                let ids = |column: usize| {
                    let id = (column + shift) / stripe % 6;
                    if id == 0 { 0 } else { (base + 1).saturating_sub(id as SegmentId).max(1) }
                };
                let predicted = SegmentMap::from_fn(SIZE.0, SIZE.1, |column, _| ids(column));
                let recall = memory.recall(&frame);
                let update = memory.update(recall, &predicted, &BTreeSet::from([base])).unwrap();
                if growth != GrowthRule::Paper || update.removed > 0 {
                    let now = memory.map().carried_ids();
                    let forgotten: Vec<SegmentId> = carried.difference(&now).copied().collect();
                    prop_assert_eq!(&update.forgotten, &forgotten);
                    carried = now;
                }
                holds = counted(&memory);
                for id in memory.segments.live() {
                    let hold = holds.get(&id).copied().unwrap_or_default();
                    prop_assert_eq!(memory.segments.hold(id), hold, "id {}", id);
                }
            }
            let live: BTreeSet<SegmentId> = memory.segments.live().collect();
            prop_assert!(holds.keys().all(|id| live.contains(id)));
        }
    }
}
