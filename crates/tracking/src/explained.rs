//! What a memory of evidence knows better than a frame: predictions that it explains, and leftovers of its own.
//!
//! None of this is in the paper, and none of it is done for the paper's memory of features.

use serde::{Deserialize, Serialize};
use splatseg_geometry::{Mask, SegmentId, SegmentMap};
use splatseg_memory::ABSTAIN;
use std::collections::{BTreeMap, BTreeSet};

use crate::TrackingError;

/// Settings of these rules. All but one are fractions from 0 to 1; 0 switches a rule off.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ExplanationSettings {
    /// A prediction of which less than this is visible, because smaller ones lie over it, is left out: what remains are
    /// rims around other predictions of the same thing.
    pub min_visible_fraction: f32,
    /// A prediction without a match is new only if at least this much of it is shown beside what is remembered. The
    /// memory explains the others by segments that it is sure of: they get no id and have no say.
    pub min_new_fraction: f32,
    /// A prediction that was explained in this many frames more than showed its place without it is new after all: a
    /// thing that was first seen as part of another.
    pub recurrences: usize,
    /// A remembered segment that no prediction matches is shown only if at least this much of what was expected is left
    /// of it.
    pub min_remembered_fraction: f32,
}

impl Default for ExplanationSettings {
    fn default() -> Self {
        Self { min_visible_fraction: 0.3, min_new_fraction: 0.7, recurrences: 8, min_remembered_fraction: 0.5 }
    }
}

impl ExplanationSettings {
    /// No rule at all: the paper's method.
    pub const NONE: Self =
        Self { min_visible_fraction: 0.0, min_new_fraction: 0.0, recurrences: 0, min_remembered_fraction: 0.0 };

    /// The settings, if all are in range.
    ///
    /// # Errors
    /// [`TrackingError::Setting`] names the first that is not.
    pub fn validated(self) -> Result<Self, TrackingError> {
        let fractions = [
            ("explanation.min_visible_fraction", self.min_visible_fraction),
            ("explanation.min_new_fraction", self.min_new_fraction),
            ("explanation.min_remembered_fraction", self.min_remembered_fraction),
        ];
        match fractions.into_iter().find(|(_, found)| !(0.0..=1.0).contains(found)) {
            Some((field, found)) => Err(TrackingError::Setting { field, found: found.to_string(), expected: "0 to 1" }),
            None => Ok(self),
        }
    }

    /// Whether enough of a prediction is visible.
    pub(crate) fn is_visible(&self, part: &Mask, whole: &Mask) -> bool {
        part.area() as f32 >= self.min_visible_fraction * whole.area() as f32
    }

    /// The ids of new predictions that the memory explains. `new` are their ids and areas, `shown` is what memory and
    /// predictions come to.
    pub(crate) fn explained(&self, new: &[(SegmentId, usize)], shown: &SegmentMap) -> BTreeSet<SegmentId> {
        if self.min_new_fraction == 0.0 || new.is_empty() {
            return BTreeSet::new();
        }
        let shown = shown.areas();
        let is_explained = |(id, area): &&(SegmentId, usize)| {
            (shown.get(id).copied().unwrap_or(0) as f32) < self.min_new_fraction * *area as f32
        };
        new.iter().filter(is_explained).map(|(id, _)| *id).collect()
    }

    /// Takes what is left of overruled segments out of `shown`: predictions show in their place.
    pub(crate) fn drop_leftovers(
        &self,
        overruled: &mut OverruledSegments,
        shown: &mut SegmentMap,
        expected: &SegmentMap,
        seen: &SegmentMap,
    ) {
        if self.min_remembered_fraction == 0.0 {
            return;
        }
        overruled.take_in(self.min_remembered_fraction, &shown.areas(), &expected.areas(), &seen.areas());
        if overruled.0.is_empty() {
            return;
        }
        for (shown, seen) in shown.pixels_mut().iter_mut().zip(seen.pixels()) {
            if overruled.0.contains_key(shown) {
                *shown = if *seen == ABSTAIN { 0 } else { *seen };
            }
        }
    }
}

/// Remembered segments that predictions have overruled, each with the largest area expected of it since: what islands
/// are left of it in later frames stay hidden, until a prediction has its id again or enough of it shows.
#[derive(Clone, Debug, Default)]
pub(crate) struct OverruledSegments(BTreeMap<SegmentId, usize>);

impl OverruledSegments {
    /// Takes in the areas by id of what a frame shows, what was expected there, and what was predicted.
    fn take_in(&mut self, min_fraction: f32, shown: &Areas, expected: &Areas, predicted: &Areas) {
        self.0.retain(|id, _| !predicted.contains_key(id));
        for (id, area) in expected.iter().filter(|(id, _)| !predicted.contains_key(id)) {
            let known = self.0.get(id).copied().unwrap_or(0).max(*area);
            let left = shown.get(id).copied().unwrap_or(0);
            if (left as f32) < min_fraction * known as f32 {
                self.0.insert(*id, known);
            } else {
                self.0.remove(id);
            }
        }
    }
}

/// Pixels by segment.
type Areas = BTreeMap<SegmentId, usize>;

#[cfg(test)]
mod tests {
    use super::*;

    fn map(ids: &[SegmentId]) -> SegmentMap {
        SegmentMap::from_pixels(ids.len(), 1, ids.to_vec()).unwrap()
    }

    #[test]
    fn predictions_that_hardly_show_are_explained() {
        let rules = ExplanationSettings { min_new_fraction: 0.5, ..ExplanationSettings::default() };
        let shown = map(&[8, 8, 1, 1, 9, 1, 1, 1]);
        let explained = rules.explained(&[(8, 4), (9, 3), (10, 1)], &shown);
        assert_eq!(explained.into_iter().collect::<Vec<_>>(), [9, 10]);
        assert!(ExplanationSettings::NONE.explained(&[(9, 3)], &shown).is_empty());
    }

    #[test]
    fn leftovers_give_way_to_predictions() {
        let rules = ExplanationSettings { min_remembered_fraction: 0.5, ..ExplanationSettings::default() };
        let expected = map(&[1, 1, 1, 1, 2, 2, 3, 3]);
        let seen = map(&[4, 4, 4, 4, 4, 0, ABSTAIN, 4]);
        let mut shown = map(&[4, 4, 4, 1, 2, 2, 3, 4]);
        rules.drop_leftovers(&mut OverruledSegments::default(), &mut shown, &expected, &seen);
        assert_eq!(shown.pixels(), [4, 4, 4, 4, 2, 2, 3, 4], "half of 3 is left, a quarter of 1");
        let mut shown = map(&[4, 4, 4, 1, 2, 2, 3, 4]);
        ExplanationSettings::NONE.drop_leftovers(&mut OverruledSegments::default(), &mut shown, &expected, &seen);
        assert_eq!(shown.pixels()[3], 1);
    }

    #[test]
    fn islands_of_an_overruled_segment_do_not_return() {
        let rules = ExplanationSettings { min_remembered_fraction: 0.5, ..ExplanationSettings::default() };
        let mut overruled = OverruledSegments::default();
        let mut shown_after = |shown: &[SegmentId], expected: &[SegmentId], seen: &[SegmentId]| {
            let mut shown = map(shown);
            rules.drop_leftovers(&mut overruled, &mut shown, &map(expected), &map(seen));
            shown.pixels().to_vec()
        };
        assert_eq!(shown_after(&[4, 4, 4, 1, 2], &[1, 1, 1, 1, 2], &[4, 4, 4, 4, 0]), [4, 4, 4, 4, 2]);
        let island = [4, 4, 4, 1, 2];
        assert_eq!(shown_after(&island, &island, &[4, 4, 4, 4, 0]), [4, 4, 4, 4, 2], "all that is expected is left");
        assert_eq!(shown_after(&island, &island, &[4, 4, 4, 1, 0]), island, "a prediction has its id");
        assert_eq!(shown_after(&island, &island, &[4, 4, 4, 4, 0]), island, "it is an equal among others again");
    }

    #[test]
    fn fractions_are_checked() {
        let wrong = ExplanationSettings { min_new_fraction: 1.5, ..ExplanationSettings::default() };
        assert_eq!(wrong.validated().unwrap_err().to_string(), "explanation.min_new_fraction is 1.5, expected 0 to 1");
    }
}
