//! When each object was seen, for the page's timeline: stretches of time, bounded for streams without an end.

use splatseg_geometry::{RemappedId, SegmentId};
use std::collections::BTreeMap;
use std::time::Duration;

/// Maximum number of stretches of all objects. They are sent with every list of objects.
const MAX_SPANS: usize = 4096;
/// Objects unseen for less time count as seen throughout, at first, seconds. The time doubles when there are too many
/// stretches.
const FIRST_PAUSE_S: f64 = 0.5;

/// Stretches of time, `(first, last)`, seconds since the first frame.
type Spans = Vec<(f64, f64)>;

/// When each object was seen.
#[derive(Clone, Debug, PartialEq)]
pub struct SeenSpans {
    spans: BTreeMap<SegmentId, Spans>,
    count: usize,
    pause: f64,
    /// Time of the latest frame, seconds since the first one, and its stamp.
    latest: f64,
    stamp: Option<Duration>,
}

impl Default for SeenSpans {
    fn default() -> Self {
        Self { spans: BTreeMap::new(), count: 0, pause: FIRST_PAUSE_S, latest: 0.0, stamp: None }
    }
}

impl SeenSpans {
    /// Records the objects of the next frame. Where a clock was set back, time goes on from there.
    pub fn record(&mut self, stamp: Duration, ids: impl IntoIterator<Item = SegmentId>) {
        self.latest += stamp.saturating_sub(self.stamp.replace(stamp).unwrap_or(stamp)).as_secs_f64();
        for id in ids {
            let spans = self.spans.entry(id).or_default();
            match spans.last_mut().filter(|(_, last)| self.latest - *last <= self.pause) {
                Some((_, last)) => *last = self.latest,
                None => {
                    spans.push((self.latest, self.latest));
                    self.count += 1;
                }
            }
        }
        self.keep_bounded();
    }

    /// Ids turned out to be other ids' objects.
    pub fn remap(&mut self, remapped: &[RemappedId]) {
        for RemappedId { from, into } in remapped.iter().filter(|ids| ids.from != ids.into) {
            if let Some(other) = self.spans.remove(from) {
                let spans = self.spans.entry(*into).or_default();
                spans.extend(other);
                join(spans, self.pause);
            }
        }
        self.recount();
    }

    /// When an object was seen: stretches `(first, last)`, seconds since the first frame.
    pub fn of(&self, id: SegmentId) -> &[(f64, f64)] {
        self.spans.get(&id).map_or(&[], Vec::as_slice)
    }

    /// Forgets all other objects.
    pub fn keep_only(&mut self, is_kept: impl Fn(SegmentId) -> bool) {
        self.spans.retain(|id, _| is_kept(*id));
        self.recount();
    }

    fn keep_bounded(&mut self) {
        while self.count > MAX_SPANS.max(self.spans.len()) {
            self.pause *= 2.0;
            let pause = self.pause;
            self.spans.values_mut().for_each(|spans| join(spans, pause));
            self.recount();
        }
    }

    fn recount(&mut self) {
        self.count = self.spans.values().map(Vec::len).sum();
    }
}

/// Sorts stretches, and makes those one that are at most this far apart, seconds.
fn join(spans: &mut Spans, pause: f64) {
    spans.sort_by(|one, other| one.0.total_cmp(&other.0));
    spans.dedup_by(|later, kept| {
        let is_near = later.0 - kept.1 <= pause;
        if is_near {
            kept.1 = kept.1.max(later.1);
        }
        is_near
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(tenths: u64) -> Duration {
        Duration::from_millis(100 * tenths)
    }

    #[test]
    fn stretches_end_after_a_pause_and_are_joined_when_ids_turn_out_to_be_one() {
        let mut seen = SeenSpans::default();
        for (tenths, ids) in [(900, &[1][..]), (902, &[1]), (904, &[1, 2]), (910, &[2]), (912, &[1])] {
            seen.record(at(tenths), ids.iter().copied());
        }
        let tenths = |seen: &SeenSpans, id| -> Vec<(f64, f64)> {
            seen.of(id).iter().map(|(first, last)| ((10.0 * first).round(), (10.0 * last).round())).collect()
        };
        assert_eq!(tenths(&seen, 1), [(0.0, 4.0), (12.0, 12.0)]);
        assert_eq!(tenths(&seen, 2), [(4.0, 4.0), (10.0, 10.0)]);
        // A clock that was set back.
        seen.record(at(3), [2]);
        seen.record(at(4), [2]);
        assert_eq!(tenths(&seen, 2), [(4.0, 4.0), (10.0, 13.0)]);
        seen.remap(&[RemappedId { from: 2, into: 1 }]);
        assert_eq!((tenths(&seen, 1), seen.of(2)), (vec![(0.0, 4.0), (10.0, 13.0)], &[][..]));
    }

    #[test]
    fn stretches_are_bounded() {
        let mut seen = SeenSpans::default();
        for second in 0..20_000 {
            seen.record(Duration::from_secs(second), [(second % 3) as SegmentId + 1]);
        }
        let count: usize = (1..=3).map(|id| seen.of(id).len()).sum();
        assert!((3..=MAX_SPANS).contains(&count), "{count}");
        assert_eq!((seen.of(1)[0].0, seen.of(2).last().unwrap().1), (0.0, 19_999.0));
    }
}
