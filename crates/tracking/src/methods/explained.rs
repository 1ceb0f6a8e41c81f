//! Where a memory of evidence overrules a frame: predictions that it explains, and leftovers of its own segments
//! (`docs/METHOD.md`, "FastSAM-Splat").
//!
//! None of this is in the paper, and none of it is applied to the paper's memory of features.

use splatseg_geometry::{Intrinsics, Mask, SegmentId, SegmentMap};
use splatseg_memory::{ABSTAIN, Recall};
use splatseg_settings::{Allowed, settings};
use std::collections::{BTreeMap, BTreeSet};

settings! {
    /// Settings of these rules; 0 switches a rule off.
    #[derive(Copy)]
    pub struct ExplanationSettings in "explanation" {
        /// A prediction is left out if smaller ones cover so much of it that less than this fraction is visible: what
        /// remains is a rim around other predictions of the same thing. 0 switches the rule off.
        min_visible_fraction: f32 = 0.3, Allowed::between(0.0, 1.0), only "memory.kind = evidence";
        /// A prediction does not match a remembered segment with which it has a smaller F-score over the pixels where the
        /// memory expects anything: there it shows other segments, whose own predictions are better. 0 switches the rule
        /// off.
        min_match_f_score: f64 = 0.1, Allowed::between(0.0, 1.0), only "memory.kind = evidence";
        /// A prediction without a match is new only if at least this fraction of it is shown after fusion with the
        /// memory. The memory explains the others by segments of which it is sure: they get no id and no vote. 0
        /// switches the rule off.
        min_new_fraction: f32 = 0.7, Allowed::between(0.0, 1.0), only "memory.kind = evidence";
        /// An explained prediction is new after all if it recurs: if the frames that have it exceed the frames that
        /// show its place without it by this number. It is an object that was first segmented as part of another. 0
        /// switches the rule off.
        recurrences: usize = 8, Allowed::between(0.0, 1e6), only "memory.kind = evidence";
        /// The same number for an explained prediction in front of the surface of what explains it. Such things are rarely
        /// errors of the segmenter. 0: as any other.
        recurrences_in_front: usize = 2, Allowed::between(0.0, 1e6), only "memory.kind = evidence";
        /// A remembered segment without a matching prediction is shown only if at least this fraction of its expected
        /// pixels is left. 0 switches the rule off.
        min_remembered_fraction: f32 = 0.5, Allowed::between(0.0, 1.0), only "memory.kind = evidence";
        /// A prediction that covers a remembered segment besides its own has no say there until this many times as many
        /// frames have shown the two as one as have shown that segment by itself, unless its colours have changed. 0
        /// switches the rule off.
        merged_per_apart: f32 = 2.0, Allowed::between(0.0, 1e6), only "memory.kind = evidence";
    }
}

impl ExplanationSettings {
    /// Every rule off: the paper's method.
    pub const NONE: Self = Self {
        min_visible_fraction: 0.0,
        min_match_f_score: 0.0,
        min_new_fraction: 0.0,
        recurrences: 0,
        recurrences_in_front: 0,
        min_remembered_fraction: 0.0,
        merged_per_apart: 0.0,
    };

    /// Whether enough of a prediction is visible.
    pub(crate) fn is_visible(&self, part: &Mask, whole: &Mask) -> bool {
        part.area() as f32 >= self.min_visible_fraction * whole.area() as f32
    }

    /// The ids of new predictions that the memory explains. `new` has the ids and areas of all new predictions, `shown`
    /// is the map after fusion.
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

    /// Whether an explained prediction may be new after all.
    pub(crate) fn lets_recur(&self) -> bool {
        self.recurrences > 0 || self.recurrences_in_front > 0
    }

    /// Whether an explained prediction that has come `times` times is new after all. `lies_in_front` tells whether it lies in
    /// front of what explains it; it is asked only if that matters.
    pub(crate) fn is_new_after(&self, times: usize, lies_in_front: impl FnOnce() -> bool) -> bool {
        let suffices = |recurrences: usize| recurrences > 0 && times >= recurrences;
        let (anywhere, in_front) = (suffices(self.recurrences), suffices(self.recurrences_in_front));
        if self.recurrences_in_front == 0 || in_front == anywhere { anywhere } else { in_front == lies_in_front() }
    }

    /// Removes what is left of overruled segments from `shown`, where predictions take their place. `pixel_areas` gives the
    /// area of the surface at each pixel, square metres.
    pub(crate) fn drop_leftovers(
        &self,
        overruled: &mut OverruledSegments,
        shown: &mut SegmentMap,
        [expected, seen]: [&SegmentMap; 2],
        pixel_areas: impl FnOnce() -> Vec<f32>,
    ) {
        if self.min_remembered_fraction == 0.0 {
            return;
        }
        let pixels = pixel_areas();
        let areas = [&*shown, expected, seen].map(|map| surface_areas(map, &pixels));
        take_in_areas(overruled, self.min_remembered_fraction, &areas);
        if overruled.is_empty() {
            return;
        }
        for (shown, seen) in shown.pixels_mut().iter_mut().zip(seen.pixels()) {
            if overruled.contains_key(shown) {
                *shown = if *seen == ABSTAIN { 0 } else { *seen };
            }
        }
    }
}

/// Remembered segments that predictions have overruled, each with the largest area expected of it since then, square metres
/// as if they faced the camera: that changes little with its distance. What remains of them in later frames stays hidden until
/// a prediction has the id again or enough of the segment is shown.
type OverruledSegments = BTreeMap<SegmentId, f32>;

/// Updates the segments by the areas of those that a frame shows, those expected in it and those predicted.
fn take_in_areas(overruled: &mut OverruledSegments, min_fraction: f32, [shown, expected, predicted]: &[Areas; 3]) {
    overruled.retain(|id, _| !predicted.contains_key(id));
    for (id, area) in expected.iter().filter(|(id, _)| !predicted.contains_key(id)) {
        let known = overruled.get(id).copied().unwrap_or(0.0).max(*area);
        let left = shown.get(id).copied().unwrap_or(0.0);
        if left < min_fraction * known {
            overruled.insert(*id, known);
        } else {
            overruled.remove(id);
        }
    }
}

/// Area by segment, square metres.
type Areas = BTreeMap<SegmentId, f32>;

/// The area of the surface that each pixel shows, square metres, as if it faced the camera. Where neither the frame nor the
/// map has a depth, it counts as 1 m away.
pub(crate) fn pixel_areas(recall: &Recall<'_>) -> Vec<f32> {
    let Intrinsics { fx, fy, .. } = *recall.frame().intrinsics();
    let depths = recall.frame().depth().pixels().iter().zip(recall.depth().pixels());
    let depth = depths.map(|(observed, rendered)| if *observed > 0.0 { *observed } else { *rendered });
    depth.map(|depth| if depth > 0.0 { depth * depth } else { 1.0 } / (fx * fy)).collect()
}

/// The area of each segment of a map.
fn surface_areas(map: &SegmentMap, pixels: &[f32]) -> Areas {
    let mut areas: BTreeMap<SegmentId, f64> = BTreeMap::new();
    let mut start = 0;
    // Neighbouring pixels mostly show one segment, so it is looked up once per run of pixels.
    for run in map.pixels().chunk_by(|one, other| one == other) {
        let end = start + run.len();
        if run[0] != 0 {
            let area: f64 = pixels[start..end].iter().map(|area| f64::from(*area)).sum();
            *areas.entry(run[0]).or_default() += area;
        }
        start = end;
    }
    areas.into_iter().map(|(id, area)| (id, area as f32)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn map(ids: &[SegmentId]) -> SegmentMap {
        SegmentMap::from_pixels(ids.len(), 1, ids.to_vec()).unwrap()
    }

    #[test]
    fn enough_of_a_prediction_must_be_visible() {
        let rules = ExplanationSettings::default().with(|rules| rules.min_visible_fraction = 0.5);
        let stripe = |to: usize| Mask::from_fn(8, 1, |column, _| column < to);
        assert_eq!([1, 2, 3].map(|visible| rules.is_visible(&stripe(visible), &stripe(4))), [false, true, true]);
        assert!(ExplanationSettings::NONE.is_visible(&stripe(0), &stripe(4)));
    }

    #[test]
    fn predictions_that_hardly_show_are_explained() {
        let rules = ExplanationSettings::default().with(|rules| rules.min_new_fraction = 0.5);
        let shown = map(&[8, 8, 1, 1, 9, 1, 1, 1]);
        let explained = rules.explained(&[(8, 4), (9, 3), (10, 1)], &shown);
        assert_eq!(explained.into_iter().collect::<Vec<_>>(), [9, 10]);
        assert!(ExplanationSettings::NONE.explained(&[(9, 3)], &shown).is_empty());
    }

    #[test]
    fn a_prediction_in_front_needs_fewer_recurrences() {
        // The number of times after which a prediction is new that lies in front, and another.
        let needed = |recurrences, recurrences_in_front| {
            let rules = ExplanationSettings { recurrences, recurrences_in_front, ..ExplanationSettings::default() };
            [true, false].map(|in_front| (1..20).find(|times| rules.is_new_after(*times, || in_front)))
        };
        assert_eq!(needed(6, 3), [Some(3), Some(6)]);
        assert_eq!(needed(3, 6), [Some(6), Some(3)]);
        assert_eq!(needed(6, 0), [Some(6), Some(6)]);
        assert_eq!(needed(0, 3), [Some(3), None]);
        assert_eq!(needed(0, 0), [None, None]);
    }

    #[test]
    fn where_a_prediction_lies_is_asked_only_if_it_matters() {
        let rules = ExplanationSettings { recurrences: 6, recurrences_in_front: 3, ..ExplanationSettings::default() };
        assert!(!rules.is_new_after(2, || panic!("2 times are too few for any")));
        assert!(rules.is_new_after(6, || panic!("6 times are enough for all")));
    }

    #[test]
    fn leftovers_give_way_to_predictions() {
        let rules = ExplanationSettings::default().with(|rules| rules.min_remembered_fraction = 0.5);
        let expected = map(&[1, 1, 1, 1, 2, 2, 3, 3]);
        let seen = map(&[4, 4, 4, 4, 4, 0, ABSTAIN, 4]);
        let mut shown = map(&[4, 4, 4, 1, 2, 2, 3, 4]);
        rules.drop_leftovers(&mut OverruledSegments::default(), &mut shown, [&expected, &seen], || vec![1e-4; 8]);
        assert_eq!(shown.pixels(), [4, 4, 4, 4, 2, 2, 3, 4], "half of 3 is left, a quarter of 1");
        let mut shown = map(&[4, 4, 4, 1, 2, 2, 3, 4]);
        ExplanationSettings::NONE.drop_leftovers(
            &mut OverruledSegments::default(),
            &mut shown,
            [&expected, &seen],
            || vec![1e-4; 8],
        );
        assert_eq!(shown.pixels()[3], 1);
    }

    #[test]
    fn islands_of_an_overruled_segment_do_not_return() {
        let rules = ExplanationSettings::default().with(|rules| rules.min_remembered_fraction = 0.5);
        let mut overruled = OverruledSegments::default();
        let mut shown_after = |shown: &[SegmentId], expected: &[SegmentId], seen: &[SegmentId]| {
            let mut shown = map(shown);
            let areas = vec![1e-4; shown.pixels().len()];
            rules.drop_leftovers(&mut overruled, &mut shown, [&map(expected), &map(seen)], || areas);
            shown.pixels().to_vec()
        };
        assert_eq!(shown_after(&[4, 4, 4, 1, 2], &[1, 1, 1, 1, 2], &[4, 4, 4, 4, 0]), [4, 4, 4, 4, 2]);
        let island = [4, 4, 4, 1, 2];
        assert_eq!(shown_after(&island, &island, &[4, 4, 4, 4, 0]), [4, 4, 4, 4, 2], "all that is expected is left");
        assert_eq!(shown_after(&island, &island, &[4, 4, 4, 1, 0]), island, "a prediction has its id");
        assert_eq!(shown_after(&island, &island, &[4, 4, 4, 4, 0]), island, "it is an equal among others again");
    }

    #[test]
    fn a_segment_stays_overruled_from_any_distance() {
        let rules = ExplanationSettings::default().with(|rules| rules.min_remembered_fraction = 0.5);
        // A third of segment 1 is left: from near, where it has six pixels, and from twice as far, where it has two.
        for distances in [[1.0, 2.0], [2.0, 1.0]] {
            let mut overruled = OverruledSegments::default();
            let mut left_at = |distance: f32| {
                let large = distance == 1.0;
                let expected = if large { map(&[1; 12]) } else { map(&[1, 1, 1]) };
                let seen = if large { map(&[4, 4, 4, 4, 4, 4, 4, 4, 0, 0, 0, 0]) } else { map(&[4, 4, 0]) };
                let mut shown = SegmentMap::from_fn(
                    expected.width(),
                    1,
                    |column, row| {
                        if seen[(column, row)] == 4 { 4 } else { 1 }
                    },
                );
                let areas = vec![1e-4 * distance * distance; expected.width()];
                rules.drop_leftovers(&mut overruled, &mut shown, [&expected, &seen], || areas);
                shown.areas().contains_key(&1)
            };
            assert_eq!(distances.map(&mut left_at), [false, false], "{distances:?}");
            let known = overruled[&1];
            assert!((known - 1.2e-3).abs() < 1e-6, "{known}");
        }
    }

    #[test]
    fn fractions_are_checked() {
        let wrong = ExplanationSettings::default().with(|rules| rules.min_new_fraction = 1.5);
        assert_eq!(wrong.validate().unwrap_err().to_string(), "explanation.min_new_fraction is 1.5, expected 0 to 1");
    }
}
