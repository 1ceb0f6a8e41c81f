//! The evidence about pairs of patches, kept by patch: that about a patch is found without a search through all of it.

use super::{PairEvidence, pair_key, patches_of};

/// Evidence about pairs of patches.
#[derive(Clone, Debug, Default)]
pub(crate) struct PatchPairs {
    /// For each patch, the pairs with patches of higher numbers, by increasing number.
    above: Vec<Vec<(u32, PairEvidence)>>,
    /// For each patch, the patches of lower numbers that it has pairs with, by increasing number.
    below: Vec<Vec<u32>>,
    count: usize,
}

impl PartialEq for PatchPairs {
    fn eq(&self, other: &Self) -> bool {
        self.iter().eq(other.iter())
    }
}

impl PatchPairs {
    /// True if there is no evidence.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Number of pairs.
    #[cfg(test)]
    pub fn len(&self) -> usize {
        self.count
    }

    /// All pairs with their evidence, by increasing [`pair_key`].
    pub fn iter(&self) -> impl Iterator<Item = (u64, PairEvidence)> + '_ {
        self.above.iter().enumerate().flat_map(|(one, pairs)| {
            pairs.iter().map(move |(other, evidence)| (pair_key(one as u32, *other), *evidence))
        })
    }

    /// Adds evidence about a pair of two patches.
    pub fn add(&mut self, key: u64, evidence: PairEvidence) {
        let (one, other) = patches_of(key);
        let patches = other as usize + 1;
        if self.above.len() < patches {
            self.above.resize_with(patches, Vec::new);
            self.below.resize_with(patches, Vec::new);
        }
        let pairs = &mut self.above[one as usize];
        match pairs.binary_search_by_key(&other, |(other, _)| *other) {
            Ok(place) => pairs[place].1.add(evidence),
            Err(place) => {
                pairs.insert(place, (other, evidence));
                let lower = &mut self.below[other as usize];
                let place = lower.partition_point(|lower| *lower < one);
                lower.insert(place, one);
                self.count += 1;
            }
        }
    }

    /// Removes the evidence about a patch. Returns it, by increasing key.
    pub fn remove(&mut self, patch: u32) -> Vec<(u64, PairEvidence)> {
        let Some(higher) = self.above.get_mut(patch as usize).map(std::mem::take) else { return Vec::new() };
        let lower = std::mem::take(&mut self.below[patch as usize]);
        let mut removed = Vec::with_capacity(lower.len() + higher.len());
        for one in lower {
            let pairs = &mut self.above[one as usize];
            if let Ok(place) = pairs.binary_search_by_key(&patch, |(other, _)| *other) {
                removed.push((pair_key(one, patch), pairs.remove(place).1));
            }
        }
        for (other, evidence) in higher {
            let lower = &mut self.below[other as usize];
            if let Ok(place) = lower.binary_search(&patch) {
                lower.remove(place);
            }
            removed.push((pair_key(patch, other), evidence));
        }
        self.count -= removed.len();
        removed
    }
}

impl FromIterator<(u64, PairEvidence)> for PatchPairs {
    fn from_iter<T: IntoIterator<Item = (u64, PairEvidence)>>(pairs: T) -> Self {
        let mut all = Self::default();
        pairs.into_iter().for_each(|(key, evidence)| all.add(key, evidence));
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::BTreeMap;

    proptest! {
        /// The same as a map from keys to evidence.
        #[test]
        fn pairs_are_a_map(
            steps in proptest::collection::vec((0u32..12, 0u32..12, 0u32..8), 1..200),
        ) {
            let (mut pairs, mut expected) = (PatchPairs::default(), BTreeMap::<u64, PairEvidence>::new());
            for (step, (one, other, action)) in (0..).zip(steps) {
                if action == 0 {
                    let (gone, kept) = expected.into_iter().partition(|(key, _)| {
                        let (lower, higher) = patches_of(*key);
                        lower == one || higher == one
                    });
                    expected = kept;
                    let gone: BTreeMap<u64, PairEvidence> = gone;
                    prop_assert_eq!(pairs.remove(one), gone.into_iter().collect::<Vec<_>>());
                } else if one != other {
                    let evidence = PairEvidence { sum: step, count: action };
                    pairs.add(pair_key(one, other), evidence);
                    expected.entry(pair_key(one, other)).or_default().add(evidence);
                }
                prop_assert_eq!(pairs.len(), expected.len());
            }
            prop_assert_eq!(pairs.iter().collect::<Vec<_>>(), expected.into_iter().collect::<Vec<_>>());
        }
    }
}
