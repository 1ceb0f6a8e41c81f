//! Predictions that remembered segments explain, but that recur in the same place: they are objects of their own after
//! all, such as a book that was first segmented as part of its table.
//!
//! A prediction is recognised by the Gaussians under it, from any viewpoint. Each Gaussian belongs to at most one
//! recurring prediction. A frame that shows its place without it lowers its count.

use crate::ABSTAIN;
use crate::map::retain;
use crate::recall::Recall;
use crate::removal::Sight;
use serde::{Deserialize, Serialize};
use splatseg_geometry::{SegmentId, SegmentMap};
use std::collections::{BTreeMap, BTreeSet};

/// Two predictions are the same if the F-score of the Gaussians under them is at least this.
const MIN_F_SCORE: f32 = 0.5;

/// Gaussians that a prediction needs to be found again by.
const MIN_GAUSSIANS: usize = 2;

/// Predictions that are remembered at most; the first ones go.
const MAX_PREDICTIONS: usize = 1024;

/// What has been explained so far.
#[derive(Debug, Default)]
pub(crate) struct RecurringPredictions {
    /// The number of the prediction that each Gaussian belongs to, 0 for none.
    of_gaussian: Vec<u32>,
    /// Frames that showed each prediction, less those that showed its place without it.
    counts: BTreeMap<u32, usize>,
    /// The last number given.
    last: u32,
}

/// [`RecurringPredictions`] as it is saved.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct SavedRecurringPredictions {
    /// Each Gaussian that belongs to a prediction, and the prediction's number.
    of_gaussian: Vec<(u32, u32)>,
    counts: BTreeMap<u32, usize>,
    last: u32,
}

impl RecurringPredictions {
    /// What is saved.
    pub fn saved(&self) -> SavedRecurringPredictions {
        let of_gaussian = (0..).zip(self.of_gaussian.iter().copied()).filter(|(_, number)| *number != 0).collect();
        SavedRecurringPredictions { of_gaussian, counts: self.counts.clone(), last: self.last }
    }

    /// What was saved, of a map with so many Gaussians.
    ///
    /// # Errors
    /// If no memory can have it.
    pub fn restored(saved: SavedRecurringPredictions, gaussians: usize) -> Result<Self, String> {
        let SavedRecurringPredictions { of_gaussian: numbers, counts, last } = saved;
        let is_number = |number: &u32| (1..=last).contains(number);
        if last > u32::MAX / 2 || counts.len() > MAX_PREDICTIONS {
            return Err(format!("{} recurring predictions, the last of number {last}", counts.len()));
        }
        if let Some((number, count)) = counts.iter().find(|(number, count)| !is_number(number) || **count == 0) {
            return Err(format!("the recurring prediction {number} was seen {count} times"));
        }
        let mut of_gaussian = vec![0; gaussians];
        for (gaussian, number) in numbers {
            match of_gaussian.get_mut(gaussian as usize) {
                Some(place) if is_number(&number) => *place = number,
                _ => return Err(format!("the Gaussian {gaussian} belongs to the recurring prediction {number}")),
            }
        }
        Ok(Self { of_gaussian, counts, last })
    }

    /// Takes note of the predictions of a frame that the memory explains: `explained` has their ids, 0 elsewhere.
    ///
    /// Returns those that have now come `needed` times, each with the Gaussians under it.
    pub fn note(
        &mut self,
        recall: &Recall<'_>,
        explained: &SegmentMap,
        needed: usize,
    ) -> BTreeMap<SegmentId, Vec<u32>> {
        self.of_gaussian.resize(recall.sights.len(), 0);
        let (width, height) = explained.size();
        let mut under: BTreeMap<SegmentId, Vec<u32>> = BTreeMap::new();
        let mut in_view: BTreeMap<u32, usize> = BTreeMap::new();
        let mut shared: BTreeMap<(SegmentId, u32), usize> = BTreeMap::new();
        for splat in recall.view.projected() {
            let (column, row) = (splat.mean.x.round(), splat.mean.y.round());
            let is_inside = column >= 0.0 && row >= 0.0 && column < width as f32 && row < height as f32;
            if !is_inside || recall.sights[splat.gaussian as usize] != Sight::Seen {
                continue;
            }
            let number = self.of_gaussian[splat.gaussian as usize];
            let id = explained[(column as usize, row as usize)];
            if number != 0 {
                *in_view.entry(number).or_default() += 1;
            }
            if id != 0 && id != ABSTAIN {
                under.entry(id).or_default().push(splat.gaussian);
                if number != 0 {
                    *shared.entry((id, number)).or_default() += 1;
                }
            }
        }
        let found = Self::found_again(&under, &in_view, &shared);
        self.count(&found, &in_view);
        let again: BTreeSet<u32> = found.values().copied().collect();
        for splat in recall.view.projected() {
            // What is seen again gets its new extent below.
            let number = &mut self.of_gaussian[splat.gaussian as usize];
            if *number != 0 && (again.contains(number) || !self.counts.contains_key(number)) {
                *number = 0;
            }
        }
        let mut recurring = BTreeMap::new();
        for (id, gaussians) in under.into_iter().filter(|(_, gaussians)| gaussians.len() >= MIN_GAUSSIANS) {
            let number = found.get(&id).copied().unwrap_or_else(|| {
                self.last += 1;
                self.counts.insert(self.last, 1);
                self.last
            });
            let is_recurring = self.counts[&number] >= needed;
            if is_recurring {
                self.counts.remove(&number);
            }
            for gaussian in &gaussians {
                self.of_gaussian[*gaussian as usize] = if is_recurring { 0 } else { number };
            }
            if is_recurring {
                recurring.insert(id, gaussians);
            }
        }
        while self.counts.len() > MAX_PREDICTIONS {
            self.counts.pop_first();
        }
        recurring
    }

    /// The number of each prediction that was seen before.
    fn found_again(
        under: &BTreeMap<SegmentId, Vec<u32>>,
        in_view: &BTreeMap<u32, usize>,
        shared: &BTreeMap<(SegmentId, u32), usize>,
    ) -> BTreeMap<SegmentId, u32> {
        // An F-score of at least a half with two predictions is possible: the better one is it.
        let mut scored: Vec<(f32, SegmentId, u32)> = shared
            .iter()
            .map(|((id, number), both)| (2.0 * *both as f32 / (under[id].len() + in_view[number]) as f32, *id, *number))
            .filter(|(score, ..)| *score >= MIN_F_SCORE)
            .collect();
        scored.sort_by(|one, other| other.0.total_cmp(&one.0).then(one.1.cmp(&other.1)).then(one.2.cmp(&other.2)));
        let (mut found, mut taken) = (BTreeMap::new(), BTreeSet::new());
        for (_, id, number) in scored {
            if !found.contains_key(&id) && taken.insert(number) {
                found.insert(id, number);
            }
        }
        found
    }

    fn count(&mut self, found: &BTreeMap<SegmentId, u32>, in_view: &BTreeMap<u32, usize>) {
        for number in found.values() {
            *self.counts.entry(*number).or_default() += 1;
        }
        let found: BTreeSet<u32> = found.values().copied().collect();
        for number in in_view.keys().filter(|number| !found.contains(number)) {
            if let Some(count) = self.counts.get_mut(number) {
                *count -= 1;
                if *count == 0 {
                    self.counts.remove(number);
                }
            }
        }
    }

    /// Keeps the Gaussians for which `keep` holds, in their order.
    pub fn retain(&mut self, keep: &[bool]) {
        self.of_gaussian.resize(keep.len(), 0);
        retain(&mut self.of_gaussian, keep);
    }
}
