//! Predictions that remembered segments explain, but that recur in the same place: they are objects of their own after
//! all, such as a book that was first segmented as part of its table.
//!
//! A prediction is recognised by the Gaussians under it, from any viewpoint. Each Gaussian belongs to at most one
//! recurring prediction. A frame that shows its place without it lowers its count.

use crate::ABSTAIN;
use crate::backend::VisibleGaussian;
use crate::map::retain;
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

    /// Whether nothing changes if a frame explains nothing.
    pub fn is_empty(&self) -> bool {
        self.counts.is_empty() && self.of_gaussian.iter().all(|number| *number == 0)
    }

    /// Takes note of the predictions of a frame that the memory explains: `explained` has their ids, 0 elsewhere.
    ///
    /// `visible` are the Gaussians in view. `is_new(id, times)` tells whether the prediction with an id, which has now come
    /// so many times, is new after all. Returns those that are, each with the Gaussians under it.
    pub fn note(
        &mut self,
        visible: &[VisibleGaussian],
        explained: &SegmentMap,
        is_new: &dyn Fn(SegmentId, usize) -> bool,
    ) -> BTreeMap<SegmentId, Vec<u32>> {
        let known = visible.last().map_or(0, |last| last.gaussian as usize + 1);
        self.of_gaussian.resize(self.of_gaussian.len().max(known), 0);
        let mut under: BTreeMap<SegmentId, Vec<u32>> = BTreeMap::new();
        let mut in_view: BTreeMap<u32, usize> = BTreeMap::new();
        let mut shared: BTreeMap<(SegmentId, u32), usize> = BTreeMap::new();
        for VisibleGaussian { gaussian, seen_at } in visible {
            let Some(pixel) = seen_at else { continue };
            let number = self.of_gaussian[*gaussian as usize];
            let id = explained.pixels()[*pixel as usize];
            if number != 0 {
                *in_view.entry(number).or_default() += 1;
            }
            if id != 0 && id != ABSTAIN {
                under.entry(id).or_default().push(*gaussian);
                if number != 0 {
                    *shared.entry((id, number)).or_default() += 1;
                }
            }
        }
        let found = Self::found_again(&under, &in_view, &shared);
        self.count(&found, &in_view);
        let again: BTreeSet<u32> = found.values().copied().collect();
        for splat in visible {
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
            let is_new = is_new(id, self.counts[&number]);
            if is_new {
                self.counts.remove(&number);
            }
            for gaussian in &gaussians {
                self.of_gaussian[*gaussian as usize] = if is_new { 0 } else { number };
            }
            if is_new {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{MemorySettings, Recall, SplatMemory};
    use splatseg_geometry::{Image, Intrinsics, Pose, RgbdFrame};

    const SIZE: (usize, usize) = (96, 40);

    /// A wall, `depth` metres ahead.
    fn wall(depth: f32) -> RgbdFrame<'static> {
        let (width, height) = SIZE;
        let camera = Intrinsics { fx: 80.0, fy: 80.0, cx: 47.5, cy: 19.5, width, height };
        let (color, depth) = (Image::filled(width, height, [0; 3]), Image::filled(width, height, depth));
        RgbdFrame::new("0", color, depth, camera, Pose::IDENTITY).unwrap()
    }

    /// A memory of the wall 2 m ahead, in which Gaussian `i` is that of pixel `i`.
    fn memory() -> SplatMemory {
        let settings = MemorySettings::default().with(|settings| settings.growth_spacing = 1);
        let mut memory = SplatMemory::new(settings, 0, &mut |_| {}).unwrap();
        let frame = wall(2.0);
        memory.update(memory.recall(&frame), &SegmentMap::filled(SIZE.0, SIZE.1, 0)).unwrap();
        assert_eq!(memory.gaussian_count(), SIZE.0 * SIZE.1);
        memory
    }

    fn visible(memory: &SplatMemory, recall: &Recall<'_>) -> Vec<VisibleGaussian> {
        memory.backend.visible_gaussians(recall).unwrap()
    }

    /// A prediction 5 of 20 columns from `left` on, and its pixels.
    fn explained(left: usize) -> (SegmentMap, Vec<u32>) {
        let is_inside = |column: usize, row: usize| (left..left + 20).contains(&column) && (10..30).contains(&row);
        let map = SegmentMap::from_fn(SIZE.0, SIZE.1, |column, row| 5 * u32::from(is_inside(column, row)));
        let pixels = map.pixels().iter().zip(0..).filter(|(id, _)| **id == 5).map(|(_, pixel)| pixel).collect();
        (map, pixels)
    }

    /// Predictions are new once they came so many times.
    fn after(needed: usize) -> impl Fn(SegmentId, usize) -> bool {
        move |_, times| times >= needed
    }

    /// How often each prediction has come.
    fn counts(recurring: &RecurringPredictions) -> Vec<usize> {
        recurring.counts.values().copied().collect()
    }

    #[test]
    fn a_prediction_recurs_with_the_gaussians_under_it() {
        let (memory, frame) = (memory(), wall(2.0));
        let recall = memory.recall(&frame);
        let (map, pixels) = explained(2);
        let mut recurring = RecurringPredictions::default();
        for _ in 0..2 {
            for time in 1..=3 {
                let mut found = recurring.note(&visible(&memory, &recall), &map, &after(3));
                found.values_mut().for_each(|gaussians| gaussians.sort_unstable());
                let expected = if time == 3 { BTreeMap::from([(5, pixels.clone())]) } else { BTreeMap::new() };
                assert_eq!(found, expected, "time {time}");
            }
            assert!(recurring.counts.is_empty() && recurring.of_gaussian.iter().all(|number| *number == 0));
        }
        assert_eq!(RecurringPredictions::default().note(&visible(&memory, &recall), &map, &after(1)).len(), 1);
        assert_eq!(RecurringPredictions::default().note(&visible(&memory, &recall), &map, &|_, _| false).len(), 0);
    }

    #[test]
    fn it_is_the_same_if_half_of_it_is_and_has_its_new_extent_from_then_on() {
        let (memory, frame) = (memory(), wall(2.0));
        let recall = memory.recall(&frame);
        let mut recurring = RecurringPredictions::default();
        for (left, expected) in [(2, vec![1]), (12, vec![2]), (22, vec![3]), (33, vec![2, 1]), (44, vec![1, 1])] {
            assert!(recurring.note(&visible(&memory, &recall), &explained(left).0, &after(100)).is_empty());
            assert_eq!(counts(&recurring), expected, "from column {left} on");
            let newest = recurring.last;
            let of_newest = recurring.of_gaussian.iter().zip(0..).filter(|(number, _)| **number == newest);
            assert_eq!(of_newest.map(|(_, gaussian)| gaussian).collect::<Vec<u32>>(), explained(left).1);
        }
    }

    #[test]
    fn what_is_not_in_sight_is_not_counted() {
        let memory = memory();
        let mut recurring = RecurringPredictions::default();
        let (map, _) = explained(30);
        let frame = wall(2.0);
        recurring.note(&visible(&memory, &memory.recall(&frame)), &map, &after(100));
        // Something hides the wall: then nothing is known of it.
        let hidden = wall(1.0);
        let recall = memory.recall(&hidden);
        for explained in [&map, &SegmentMap::filled(SIZE.0, SIZE.1, 0)] {
            recurring.note(&visible(&memory, &recall), explained, &after(100));
            assert_eq!(counts(&recurring), [1]);
        }
        recurring.note(&visible(&memory, &memory.recall(&frame)), &map.map(|_| ABSTAIN), &after(100));
        assert_eq!(counts(&recurring), [0; 0], "its place without it");
    }

    #[test]
    fn one_gaussian_is_too_few_and_only_the_last_predictions_are_kept() {
        let (memory, frame) = (memory(), wall(2.0));
        let recall = memory.recall(&frame);
        // Predictions of so many pixels each, side by side; nothing is told of the outermost pixels.
        let in_order = |pixels: usize, count: usize| {
            SegmentMap::from_fn(SIZE.0, SIZE.1, |column, row| {
                let is_inner = (1..SIZE.0 - 1).contains(&column) && (1..SIZE.1 - 1).contains(&row);
                if !is_inner {
                    return 0;
                }
                let place = (row - 1) * (SIZE.0 - 2) + column - 1;
                if place < pixels * count { (place / pixels) as u32 + 1 } else { 0 }
            })
        };
        let mut recurring = RecurringPredictions::default();
        recurring.note(&visible(&memory, &recall), &in_order(1, 50), &after(100));
        assert_eq!(counts(&recurring), [0; 0]);
        recurring.note(&visible(&memory, &recall), &in_order(2, 50), &after(100));
        assert_eq!(counts(&recurring), [1; 50]);
        let mut many = RecurringPredictions::default();
        many.note(&visible(&memory, &recall), &in_order(2, MAX_PREDICTIONS + 1), &after(100));
        assert_eq!(
            many.counts.keys().copied().collect::<Vec<_>>(),
            (2..=MAX_PREDICTIONS as u32 + 1).collect::<Vec<_>>()
        );
    }

    #[test]
    fn a_prediction_is_found_again_by_its_f_score() {
        let under = BTreeMap::from([(1, vec![0; 4]), (2, vec![0; 4])]);
        let found = |in_view: &[(u32, usize)], shared: &[((SegmentId, u32), usize)]| {
            let (in_view, shared) = (in_view.iter().copied().collect(), shared.iter().copied().collect());
            RecurringPredictions::found_again(&under, &in_view, &shared).into_iter().collect::<Vec<_>>()
        };
        assert_eq!(found(&[(7, 4)], &[((1, 7), 2)]), [(1, 7)], "2 · 2 / (4 + 4)");
        assert_eq!(found(&[(7, 5)], &[((1, 7), 2)]), [], "2 · 2 / (4 + 5)");
        let in_view = [(7, 4), (8, 4)];
        assert_eq!(found(&in_view, &[((1, 7), 3), ((2, 7), 4), ((2, 8), 1)]), [(2, 7)], "each belongs to one");
        assert_eq!(found(&in_view, &[((1, 7), 3), ((2, 8), 2)]), [(1, 7), (2, 8)]);
        assert_eq!(found(&in_view, &[((1, 7), 2), ((1, 8), 3)]), [(1, 8)], "the better one");
        assert_eq!(found(&in_view, &[((1, 7), 2), ((2, 7), 2)]), [(1, 7)], "of equal ones the smaller id");
        assert_eq!(found(&in_view, &[((1, 7), 2), ((1, 8), 2)]), [(1, 7)], "of equal ones the first number");
    }

    #[test]
    fn removed_gaussians_are_forgotten() {
        let mut recurring = RecurringPredictions { of_gaussian: vec![1, 2, 3], ..RecurringPredictions::default() };
        recurring.retain(&[true, false, true, true]);
        assert_eq!(recurring.of_gaussian, [1, 3, 0]);
    }

    #[test]
    fn only_what_a_memory_can_have_is_restored() {
        let saved = |of_gaussian: &[(u32, u32)], counts: &[(u32, usize)], last| SavedRecurringPredictions {
            of_gaussian: of_gaussian.to_vec(),
            counts: counts.iter().copied().collect(),
            last,
        };
        let restored = |saved: SavedRecurringPredictions| RecurringPredictions::restored(saved, 10);
        let good = saved(&[(0, 3), (9, 5)], &[(3, 1), (5, 2)], 5);
        let recurring = restored(good.clone()).unwrap();
        assert_eq!((recurring.of_gaussian[0], recurring.of_gaussian[9], recurring.last), (3, 5, 5));
        assert_eq!(recurring.saved(), good);
        let full: Vec<(u32, usize)> = (1..=MAX_PREDICTIONS as u32).map(|number| (number, 1)).collect();
        let more: Vec<(u32, usize)> = (1..=MAX_PREDICTIONS as u32 + 1).map(|number| (number, 1)).collect();
        assert!(restored(saved(&[], &full, 2000)).is_ok() && restored(saved(&[], &more, 2000)).is_err());
        let largest = u32::MAX / 2;
        assert!(restored(saved(&[], &[], largest)).is_ok() && restored(saved(&[], &[], largest + 1)).is_err());
        for (of_gaussian, counts) in [
            (&[(10, 3)][..], &[][..]),
            (&[(0, 6)], &[]),
            (&[(0, 0)], &[]),
            (&[], &[(0, 1)]),
            (&[], &[(6, 1)]),
            (&[], &[(3, 0)]),
        ] {
            assert!(restored(saved(of_gaussian, counts, 5)).is_err(), "{of_gaussian:?} {counts:?}");
        }
    }
}
