//! One-to-one matching of expected and predicted segments (`docs/PAPER.md`, "FastSAM-Splat", step 3).

mod painting;
mod regions;

pub(crate) use painting::{painted, painted_parts, visible_parts};
pub(crate) use regions::decided_by_regions;

use rayon::prelude::*;
use splatseg_geometry::{Candidate, Image, Mask, Ratio, SegmentId, SegmentMap, best_assignment};
use std::collections::BTreeMap;

/// Matches each prediction with an expected segment, if possible. Returns one entry per prediction.
///
/// The matching is one-to-one and maximises the summed F-score, `2 |A ∩ B| / (|A| + |B|)`. Pairs are not matched if
/// they do not overlap, or if their F-score over the pixels with an expected segment is below `min_known_f_score`.
pub fn match_segments(expected: &SegmentMap, predictions: &[&Mask], min_known_f_score: f64) -> Vec<Option<SegmentId>> {
    match_possible(expected, predictions, min_known_f_score, None, |_, _| true)
}

/// As [`match_segments`], of the pairs of a segment and the index of a prediction for which `is_possible` returns true. Also
/// counts the pixels that are `known` to show something else, `[height, width]`.
pub(crate) fn match_possible(
    expected: &SegmentMap,
    predictions: &[&Mask],
    min_known_f_score: f64,
    known: Option<&Image<bool>>,
    is_possible: impl Fn(SegmentId, usize) -> bool + Sync,
) -> Vec<Option<SegmentId>> {
    let areas = expected.areas();
    let known_area = |mask: &Mask, overlaps: &BTreeMap<SegmentId, usize>| {
        let is_other = |known: &Image<bool>, pixel: usize| known.pixels()[pixel] && expected.pixels()[pixel] == 0;
        let others = known.map_or(0, |known| mask.pixel_indices().filter(|pixel| is_other(known, *pixel)).count());
        others + overlaps.values().sum::<usize>()
    };
    let candidates: Vec<Candidate> = predictions
        .par_iter()
        .enumerate()
        .flat_map_iter(|(prediction, mask)| {
            let overlaps = overlaps(expected, mask);
            let (area, known) = (mask.area(), known_area(mask, &overlaps));
            let (areas, is_possible) = (&areas, &is_possible);
            overlaps.into_iter().filter_map(move |(segment, shared)| {
                let f_score = |area: usize| Ratio::f_score(shared as u64, areas[&segment] as u64, area as u64);
                let is_possible = f_score(known).to_f64() >= min_known_f_score && is_possible(segment, prediction);
                is_possible.then(|| Candidate::new(u64::from(segment), prediction as u64, f_score(area), None))
            })
        })
        .collect();
    let mut matched = vec![None; predictions.len()];
    for index in best_assignment(&candidates) {
        matched[candidates[index].column as usize] = Some(candidates[index].row as SegmentId);
    }
    matched
}

/// Returns the expected segments under a mask and the number of pixels of each, by increasing id.
pub(crate) fn overlaps(expected: &SegmentMap, mask: &Mask) -> BTreeMap<SegmentId, usize> {
    let mut counts = BTreeMap::new();
    let (mut current, mut run) = (0, 0);
    for index in mask.pixel_indices() {
        let segment = expected.pixels()[index];
        if segment != current {
            if current != 0 {
                *counts.entry(current).or_insert(0) += run;
            }
            (current, run) = (segment, 0);
        }
        run += 1;
    }
    if current != 0 {
        *counts.entry(current).or_insert(0) += run;
    }
    counts
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const WIDTH: usize = 12;

    fn map(ids: &[u32]) -> SegmentMap {
        SegmentMap::from_pixels(WIDTH, ids.len() / WIDTH, ids.to_vec()).unwrap()
    }

    fn summed_f_score(expected: &SegmentMap, predictions: &[Mask], matched: &[Option<SegmentId>]) -> f64 {
        predictions
            .iter()
            .zip(matched)
            .filter_map(|(mask, segment)| segment.map(|segment| (mask, expected.mask_of(segment))))
            .map(|(mask, segment)| {
                2.0 * mask.intersection_area(&segment) as f64 / (mask.area() + segment.area()) as f64
            })
            .sum()
    }

    /// Best sum over all one-to-one matchings, by enumeration.
    fn best_by_enumeration(expected: &SegmentMap, predictions: &[Mask], taken: &mut Vec<Option<SegmentId>>) -> f64 {
        if taken.len() == predictions.len() {
            return summed_f_score(expected, predictions, taken);
        }
        let mut choices: Vec<Option<SegmentId>> = expected.areas().into_keys().map(Some).collect();
        choices.retain(|choice| !taken.contains(choice));
        choices.push(None);
        choices
            .into_iter()
            .map(|choice| {
                taken.push(choice);
                let best = best_by_enumeration(expected, predictions, taken);
                taken.pop();
                best
            })
            .fold(0.0, f64::max)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(60))]

        #[test]
        fn no_matching_has_a_larger_sum(expected in prop::collection::vec(0u32..5, 96..=96),
                                        predicted in prop::collection::vec(0u32..5, 96..=96)) {
            let expected = map(&expected);
            let predicted = Mask::of_segments(&map(&predicted));
            let predictions: Vec<Mask> = predicted.into_iter().map(|(_, mask)| mask).collect();
            let matched = match_segments(&expected, &predictions.iter().collect::<Vec<_>>(), 0.0);
            let mut ids: Vec<_> = matched.iter().flatten().collect();
            ids.sort_unstable();
            ids.dedup();
            prop_assert_eq!(ids.len(), matched.iter().flatten().count(), "one-to-one");
            let best = best_by_enumeration(&expected, &predictions, &mut Vec::new());
            prop_assert!((summed_f_score(&expected, &predictions, &matched) - best).abs() < 1e-9);
        }
    }

    #[test]
    fn pairs_without_enough_overlap_are_not_matched() {
        let expected = map(&[[1; 6], [0; 6]].concat());
        let apart = Mask::from_fn(WIDTH, 1, |column, _| column > 7);
        assert_eq!(match_segments(&expected, &[&apart], 0.0), [None]);
        let grazing = Mask::from_fn(WIDTH, 1, |column, _| column > 4);
        assert_eq!(match_segments(&expected, &[&grazing], 0.0), [Some(1)]);
        assert_eq!(match_segments(&expected, &[&grazing], 0.2), [Some(1)], "2 · 1 / (6 + 1) of the known pixels");
        assert_eq!(match_segments(&expected, &[&grazing], 0.3), [None]);
        assert!(match_segments(&expected, &[], 0.0).is_empty());
    }
}
