//! Pairing of measurements by time.

use std::cmp::{Ordering, Reverse};
use std::collections::BinaryHeap;

/// Pairs two lists of times, seconds, both increasing: the two closest first, then the two closest of the rest, while
/// they are less than `max_seconds` apart (`associate.py` of the TUM RGB-D tools). Returns pairs of indices, sorted by
/// index in `first`.
///
/// `associate.py` sorts all pairs of times. But the closest remaining pair is always adjacent in time order, so
/// comparing neighbours is enough: O(n log n) instead of O(n²).
pub(crate) fn associate(first: &[f64], second: &[f64], max_seconds: f64) -> Vec<(usize, usize)> {
    let mut line = TimeLine::merge(first, second);
    let mut open: BinaryHeap<Reverse<Candidate>> = BinaryHeap::new();
    for left in 0..line.events.len() {
        open.extend(line.candidate(left, line.next[left], max_seconds).map(Reverse));
    }
    let mut pairs = Vec::new();
    while let Some(Reverse(candidate)) = open.pop() {
        let (left, right) = (candidate.left, candidate.right);
        if line.taken[left] || line.taken[right] {
            continue;
        }
        pairs.push(line.indices(left, right));
        let (before, after) = line.take(left, right);
        if let Some(before) = before {
            open.extend(line.candidate(before, after, max_seconds).map(Reverse));
        }
    }
    pairs.sort_unstable();
    pairs
}

/// Returns the index of the time nearest to `at` (the earlier of two), if it is less than `max_seconds` away. `times`
/// must be increasing.
pub(crate) fn nearest(times: &[f64], at: f64, max_seconds: f64) -> Option<usize> {
    let after = times.partition_point(|time| *time < at);
    let distance = |index: &usize| (times[*index] - at).abs();
    let candidates = [after.checked_sub(1), (after < times.len()).then_some(after)];
    candidates
        .into_iter()
        .flatten()
        .min_by(|left, right| distance(left).total_cmp(&distance(right)))
        .filter(|index| distance(index) < max_seconds)
}

/// A time and its list and index.
#[derive(Clone, Copy, Debug)]
struct Event {
    seconds: f64,
    is_first: bool,
    index: usize,
}

/// Both lists merged in time order, as a linked list from which pairs are removed.
struct TimeLine {
    events: Vec<Event>,
    previous: Vec<Option<usize>>,
    next: Vec<Option<usize>>,
    taken: Vec<bool>,
}

impl TimeLine {
    fn merge(first: &[f64], second: &[f64]) -> Self {
        let events_of = |times: &[f64], is_first| {
            times
                .iter()
                .enumerate()
                .map(|(index, seconds)| Event { seconds: *seconds, is_first, index })
                .collect::<Vec<_>>()
        };
        let mut events = events_of(first, true);
        events.extend(events_of(second, false));
        events.sort_by(|left, right| left.seconds.total_cmp(&right.seconds));
        let count = events.len();
        Self {
            previous: (0..count).map(|place| place.checked_sub(1)).collect(),
            next: (0..count).map(|place| (place + 1 < count).then_some(place + 1)).collect(),
            taken: vec![false; count],
            events,
        }
    }

    /// Returns two neighbours as a pair, if they come from different lists and are close enough.
    fn candidate(&self, left: usize, right: Option<usize>, max_seconds: f64) -> Option<Candidate> {
        let right = right?;
        let (a, b) = (self.events[left], self.events[right]);
        let seconds_apart = (a.seconds - b.seconds).abs();
        let fits = a.is_first != b.is_first && seconds_apart < max_seconds;
        fits.then_some(Candidate { seconds_apart, left, right })
    }

    /// Returns a pair's indices in the first and second list.
    fn indices(&self, left: usize, right: usize) -> (usize, usize) {
        let (a, b) = (self.events[left], self.events[right]);
        if a.is_first { (a.index, b.index) } else { (b.index, a.index) }
    }

    /// Removes two neighbours. Returns the events before and after them, which become neighbours.
    fn take(&mut self, left: usize, right: usize) -> (Option<usize>, Option<usize>) {
        self.taken[left] = true;
        self.taken[right] = true;
        let (before, after) = (self.previous[left], self.next[right]);
        if let Some(before) = before {
            self.next[before] = after;
        }
        if let Some(after) = after {
            self.previous[after] = before;
        }
        (before, after)
    }
}

/// A pair of neighbours, ordered by distance in time, then by position.
#[derive(Clone, Copy, Debug)]
struct Candidate {
    seconds_apart: f64,
    left: usize,
    right: usize,
}

impl Ord for Candidate {
    fn cmp(&self, other: &Self) -> Ordering {
        self.seconds_apart.total_cmp(&other.seconds_apart).then(self.left.cmp(&other.left))
    }
}

impl PartialOrd for Candidate {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Candidate {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Candidate {}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::BTreeSet;

    /// Sorts all pairs and takes each if both elements are free.
    fn as_associate_py(first: &[f64], second: &[f64], max_seconds: f64) -> Vec<(usize, usize)> {
        let mut open = Vec::new();
        for (i, a) in first.iter().enumerate() {
            open.extend(second.iter().enumerate().map(|(j, b)| ((a - b).abs(), i, j)));
        }
        open.retain(|(apart, ..)| *apart < max_seconds);
        open.sort_by(|left, right| left.0.total_cmp(&right.0).then((left.1, left.2).cmp(&(right.1, right.2))));
        let (mut used_first, mut used_second) = (BTreeSet::new(), BTreeSet::new());
        let mut pairs = Vec::new();
        for (_, i, j) in open {
            if !used_first.contains(&i) && !used_second.contains(&j) {
                used_first.insert(i);
                used_second.insert(j);
                pairs.push((i, j));
            }
        }
        pairs.sort_unstable();
        pairs
    }

    proptest! {
        #[test]
        fn agrees_with_all_pairs_sorted(
            first in prop::collection::btree_set(0u32..100_000, 0..30),
            second in prop::collection::btree_set(0u32..100_000, 0..30),
            max_seconds in 0.0f64..0.5,
        ) {
            // Uneven steps, because equally close pairs would be taken in another order.
            let times = |numbers: &BTreeSet<u32>| -> Vec<f64> {
                numbers.iter().map(|n| f64::from(*n).sqrt() * 0.013).collect()
            };
            let (first, second) = (times(&first), times(&second));
            prop_assert_eq!(associate(&first, &second, max_seconds), as_associate_py(&first, &second, max_seconds));
        }

        #[test]
        fn nearest_is_the_nearest(times in prop::collection::btree_set(0u32..1000, 0..20), at in 0.0f64..10.0) {
            let times: Vec<f64> = times.into_iter().map(|n| f64::from(n) * 0.01).collect();
            let slow = (0..times.len())
                .min_by(|i, j| (times[*i] - at).abs().total_cmp(&(times[*j] - at).abs()))
                .filter(|i| (times[*i] - at).abs() < 0.5);
            prop_assert_eq!(nearest(&times, at, 0.5), slow);
        }
    }

    #[test]
    fn a_close_pair_keeps_its_neighbours_apart() {
        assert_eq!(associate(&[0.0, 0.010], &[0.009, 0.031], 0.02), [(1, 0)]);
        assert_eq!(associate(&[0.0, 0.010], &[0.009, 0.027], 0.04), [(0, 1), (1, 0)]);
    }
}
