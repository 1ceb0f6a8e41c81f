//! The clock of a recording: stamps that do not fit those of their neighbours, and clocks that are set back.
//!
//! A stamp may be wrong, and a clock may be set: by NTP, or because a simulation restarts. So the messages of a topic
//! are divided into stretches. Within a stretch the clock does not go back. Across stretches nothing is paired or
//! interpolated. A clock set forward leaves a gap, as if the recorder had paused.

use super::stream_clock::StreamClock;
use std::cmp::Ordering;

/// Stamps that go back by less than this are messages recorded slightly out of order, nanoseconds.
pub(crate) const OUT_OF_ORDER: i64 = 1_000_000_000;

/// Costs of leaving out a message and of starting a stretch. A new stretch is worthwhile if it saves four messages.
/// A shorter run of deviating stamps counts as wrong.
const LEFT_OUT: u32 = 4;
const NEW_STRETCH: u32 = 14;

/// Cost of keeping a message recorded after later ones. A clock set back by less than [`OUT_OF_ORDER`] causes many of
/// them.
const LATE: u32 = 3;

/// Number of messages to look back for the last good one. Leaving out more costs more than two new stretches.
const REACH: usize = 11;

/// Recording time of a message.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Recorded {
    /// Time by the recorder's clock, nanoseconds.
    pub(crate) log_time: i64,
    /// Number of the message in the file.
    pub(crate) number: i64,
}

/// A message with a stamp.
pub(crate) trait Stamped {
    /// True to keep the last of several messages with the same stamp, which may correct the others. Otherwise the
    /// first.
    const KEEPS_LAST: bool = false;
    /// Stamp, nanoseconds.
    fn stamp(&self) -> i64;
    fn recorded(&self) -> Recorded;
}

/// Selects the time in [`Recorded`] for comparing messages of several topics.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum Order {
    /// The log time. The recorder's clock never goes back.
    #[default]
    LogTime,
    /// The number in the file. The recorder's clock goes back or stands still.
    Number,
}

impl Order {
    pub(crate) fn of(self, recorded: Recorded) -> i64 {
        match self {
            Self::LogTime => recorded.log_time,
            Self::Number => recorded.number,
        }
    }
}

/// A stretch of messages during which the clock was not set back, sorted by stamp, all stamps different.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Stretch<T> {
    /// At least one.
    pub(crate) messages: Vec<T>,
    /// Latest recording time.
    pub(crate) last_recorded: i64,
}

/// The messages of a topic, divided into stretches.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Timeline<T> {
    pub(crate) order: Order,
    pub(crate) stretches: Vec<Stretch<T>>,
    /// Number of messages whose stamps do not fit those of their neighbours.
    pub(crate) misfits: usize,
    /// Number of messages with the same stamp as another.
    pub(crate) duplicates: usize,
    /// For messages that arrive one by one.
    pub(crate) clock: StreamClock<T>,
}

impl<T> Default for Timeline<T> {
    fn default() -> Self {
        Self {
            order: Order::default(),
            stretches: Vec::new(),
            misfits: 0,
            duplicates: 0,
            clock: StreamClock::default(),
        }
    }
}

impl<T: Stamped> Timeline<T> {
    /// Divides the messages of a topic, given in file order, into stretches.
    pub(crate) fn new(messages: Vec<T>, order: Order) -> Self {
        let kept = fitting(&messages);
        let misfits = kept.iter().filter(|kept| kept.is_none()).count();
        let fitting = messages.len() - misfits;
        let mut groups: Vec<Vec<T>> = Vec::new();
        for (message, kept) in messages.into_iter().zip(kept) {
            match (kept, groups.last_mut()) {
                (Some(false), Some(group)) => group.push(message),
                (Some(_), _) => groups.push(vec![message]),
                (None, _) => {}
            }
        }
        let stretches: Vec<Stretch<T>> = groups.into_iter().map(|group| Stretch::new(group, order)).collect();
        let duplicates = fitting - stretches.iter().map(|stretch| stretch.messages.len()).sum::<usize>();
        Self { order, stretches, misfits, duplicates, clock: StreamClock::default() }
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.stretches.is_empty()
    }

    /// Returns the number of messages.
    pub(crate) fn len(&self) -> usize {
        self.stretches.iter().map(|stretch| stretch.messages.len()).sum()
    }

    /// Returns the stretch that matches a message of another topic.
    pub(crate) fn stretch_of(&self, message: &impl Stamped) -> Option<&Stretch<T>> {
        self.stretches.get(self.index_of_stretch(message)?)
    }

    /// Returns the index of that stretch: of those recorded at about the same time, the one with the most similar
    /// stamps.
    pub(crate) fn index_of_stretch(&self, message: &impl Stamped) -> Option<usize> {
        let time = self.order.of(message.recorded());
        // First stretch that does not end before.
        let next = self.stretches.partition_point(|stretch| stretch.last_recorded < time);
        let candidates = next.saturating_sub(1)..(next + 2).min(self.stretches.len());
        let apart = |index: &usize| self.stretches.get(*index).map(|stretch| stretch.distance(message, self.order));
        candidates.min_by_key(apart)
    }
}

impl<T: Stamped> Stretch<T> {
    fn new(mut messages: Vec<T>, order: Order) -> Self {
        let last_recorded = messages.iter().map(|message| order.of(message.recorded())).max().unwrap_or(0);
        if T::KEEPS_LAST {
            messages.reverse();
        }
        messages.sort_by_key(Stamped::stamp);
        messages.dedup_by_key(|message| message.stamp());
        messages.shrink_to_fit();
        Self { messages, last_recorded }
    }

    /// Returns the distance of a message from the one with the nearest stamp: first by stamp, beyond the usual disorder
    /// of a recording, then by recording time.
    fn distance(&self, message: &impl Stamped, order: Order) -> (u64, u64) {
        let stamp = message.stamp();
        let after = self.messages.partition_point(|other| other.stamp() < stamp);
        let neighbours = [after.checked_sub(1), Some(after)].into_iter().flatten();
        let neighbours = neighbours.filter_map(|index| self.messages.get(index));
        let nearest = neighbours.min_by_key(|other| other.stamp().abs_diff(stamp));
        nearest.map_or((u64::MAX, u64::MAX), |nearest| {
            let apart = nearest.stamp().abs_diff(stamp).saturating_sub(OUT_OF_ORDER.unsigned_abs());
            (apart, order.of(nearest.recorded()).abs_diff(order.of(message.recorded())))
        })
    }
}

/// Cost of left-out and late messages and new stretches, then of gaps, as a tie-break: the sum of the gaps' binary
/// digits, in tenths of a second.
type Cost = (u32, u32);

/// Best sequence of kept messages that ends at a message.
#[derive(Clone, Copy, Debug)]
struct Path {
    cost: Cost,
    /// Index of the path to the previous kept message.
    before: Option<usize>,
    begins_stretch: bool,
    /// Latest stamp of the stretch so far.
    latest: i64,
}

impl Path {
    /// Extends the path to a message, leaving out `skipped` in between, in the same stretch or in a new one. `place` is
    /// the index of `self`.
    fn then(&self, place: usize, stamp: i64, skipped: usize, same_stretch: bool) -> Option<Self> {
        if same_stretch && stamp < self.latest.saturating_sub(OUT_OF_ORDER) {
            return None;
        }
        let step = match (same_stretch, stamp.cmp(&self.latest)) {
            (false, _) => NEW_STRETCH,
            (true, Ordering::Less) => LATE,
            // Only one of equal stamps is kept.
            (true, Ordering::Equal) => LEFT_OUT,
            (true, Ordering::Greater) => 0,
        };
        let gap = if same_stretch { digits(stamp.saturating_sub(self.latest)) } else { 0 };
        let cost =
            (self.cost.0.saturating_add(left_out(skipped)).saturating_add(step), self.cost.1.saturating_add(gap));
        let latest = if same_stretch { self.latest.max(stamp) } else { stamp };
        Some(Self { cost, before: Some(place), begins_stretch: !same_stretch, latest })
    }
}

fn left_out(count: usize) -> u32 {
    LEFT_OUT.saturating_mul(u32::try_from(count).unwrap_or(u32::MAX))
}

/// Returns for each message `None` if it is left out, otherwise true if it begins a stretch.
fn fitting<T: Stamped>(messages: &[T]) -> Vec<Option<bool>> {
    // Two paths to each message: the cheapest, and the cheapest on which it is not late, which may become cheaper
    // later.
    let mut paths: Vec<Path> = Vec::with_capacity(2 * messages.len());
    for (index, message) in messages.iter().enumerate() {
        let stamp = message.stamp();
        let first = Path { cost: (left_out(index), 0), before: None, begins_stretch: true, latest: stamp };
        let mut best = [first; 2];
        // The nearest first: of equal paths, prefer the one that keeps more.
        for before in (index.saturating_sub(REACH)..index).rev() {
            for place in [2 * before, 2 * before + 1] {
                let Some(path) = paths.get(place) else { continue };
                let found = [true, false].map(|same_stretch| path.then(place, stamp, index - before - 1, same_stretch));
                for path in found.into_iter().flatten() {
                    let is_better =
                        |best: &Path| path.cost < best.cost || best.before.is_none() && path.cost == best.cost;
                    let [any, in_time] = &mut best;
                    if is_better(any) {
                        *any = path;
                    }
                    if path.latest == stamp && is_better(in_time) {
                        *in_time = path;
                    }
                }
            }
        }
        paths.extend(best);
    }
    let mut kept = vec![None; messages.len()];
    let ends = paths.iter().enumerate().rev().take(2 * REACH);
    let rest = |place: usize| left_out(messages.len() - place / 2 - 1);
    let cost_of = |(place, path): &(usize, &Path)| (path.cost.0.saturating_add(rest(*place)), path.cost.1);
    let mut at = ends.min_by_key(cost_of).map(|(place, _)| place);
    while let Some((place, path)) = at.and_then(|place| Some((place, paths.get(place)?))) {
        if let Some(kept) = kept.get_mut(place / 2) {
            *kept = Some(path.begins_stretch);
        }
        at = path.before;
    }
    kept
}

/// Returns the number of binary digits of a gap, in tenths of a second.
fn digits(gap: i64) -> u32 {
    u64::BITS - (gap.max(0) / (OUT_OF_ORDER / 10)).unsigned_abs().leading_zeros()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const SECOND: i64 = 1_000_000_000;

    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    struct Message {
        stamp: i64,
        recorded: Recorded,
    }

    impl Stamped for Message {
        fn stamp(&self) -> i64 {
            self.stamp
        }

        fn recorded(&self) -> Recorded {
            self.recorded
        }
    }

    /// Creates messages with stamps in tenths of a second, recorded ten per second.
    fn messages(stamps: impl IntoIterator<Item = i64>) -> Vec<Message> {
        let message = |(stamp, number): (i64, i64)| Message {
            stamp: stamp.saturating_mul(SECOND / 10),
            recorded: Recorded { log_time: number * SECOND / 10, number },
        };
        stamps.into_iter().zip(0..).map(message).collect()
    }

    /// Returns the stamps of each stretch, and the number of messages left out.
    fn stretches(stamps: impl IntoIterator<Item = i64>) -> (Vec<Vec<i64>>, usize) {
        let timeline = Timeline::new(messages(stamps), Order::LogTime);
        let stamps = |stretch: &Stretch<Message>| stretch.messages.iter().map(|m| m.stamp / (SECOND / 10)).collect();
        (timeline.stretches.iter().map(stamps).collect(), timeline.misfits + timeline.duplicates)
    }

    #[test]
    fn a_wrong_stamp_loses_only_its_message() {
        let all: Vec<i64> = (1000..1100).collect();
        for wrong in [0, 5, 900, 2000, 1_000_000_000, i64::MAX / SECOND] {
            for place in [0, 1, 50, 98, 99] {
                let mut stamps = all.clone();
                stamps[place] = wrong;
                let (found, _) = stretches(stamps.clone());
                let good: Vec<i64> = found.concat().into_iter().filter(|stamp| *stamp != wrong).collect();
                let expected: Vec<i64> = stamps.into_iter().filter(|stamp| *stamp != wrong).collect();
                assert_eq!((good, found.len()), (expected, 1), "{wrong} at {place}");
            }
        }
    }

    #[test]
    fn a_clock_set_back_begins_a_stretch_and_one_set_forward_does_not() {
        let back = (36_000..36_050).chain(10..60).chain(10..80);
        assert_eq!(stretches(back), (vec![(36_000..36_050).collect(), (10..60).collect(), (10..80).collect()], 0));
        let forward_and_back = (10..60).chain(36_000..36_050).chain(110..160);
        let expected = vec![(10..60).chain(36_000..36_050).collect(), (110..160).collect()];
        assert_eq!(stretches(forward_and_back), (expected, 0));
    }

    #[test]
    fn slightly_unordered_messages_are_kept_and_equal_stamps_merged() {
        assert_eq!(stretches([10, 12, 11, 13, 13, 5, 14]), (vec![vec![5, 10, 11, 12, 13, 14]], 1));
        assert_eq!(stretches([]), (vec![], 0));
    }

    #[test]
    fn the_stretch_of_another_topic_is_found_by_stamp_and_recording_time() {
        let timeline = Timeline::new(messages((10..60).chain(10..60).chain(4000..4050)), Order::LogTime);
        let at = |stamp: i64, number: i64, order: Order| {
            let recorded = Recorded { log_time: number * SECOND / 10, number };
            let message = Message { stamp: stamp * SECOND / 10, recorded };
            Timeline { order, ..timeline.clone() }.index_of_stretch(&message).unwrap()
        };
        for order in [Order::LogTime, Order::Number] {
            let cases = [(10, -5), (12, 3), (58, 48), (59, 51), (10, 49), (11, 51), (59, 99), (4000, 99), (40, 500)];
            assert_eq!(cases.map(|(stamp, number)| at(stamp, number, order)), [0, 0, 0, 0, 1, 1, 1, 1, 1], "{order:?}");
        }
        let message = messages([5])[0];
        assert_eq!(Timeline::<Message>::default().stretch_of(&message), None);
    }

    #[test]
    fn short_runs_of_a_simulation_are_stretches() {
        let run = || (0..8).map(|step| 20 + 5 * step);
        let (found, misfits) = stretches(run().chain(run()).chain(run()));
        assert_eq!((found, misfits), (vec![run().collect::<Vec<_>>(); 3], 0));
    }

    proptest! {
        /// Whatever stamps are wrong and wherever the clock is set, at most as many messages are left out as have wrong
        /// stamps, plus four for each change of the clock.
        #[test]
        fn no_more_is_lost_than_is_wrong(
            wrong in proptest::collection::btree_map(0usize..200, -1_000_000i64..1_000_000, 0..30),
            steps in proptest::collection::btree_map(20usize..180, prop_oneof![-5_000i64..5_000, -20i64..20], 0..3),
        ) {
            let mut offset = 0;
            let mut stamps: Vec<i64> = Vec::new();
            for index in 0..200 {
                offset += steps.get(&index).copied().unwrap_or(0);
                stamps.push(100_000 + index as i64 + offset);
            }
            wrong.iter().for_each(|(place, stamp)| stamps[*place] = *stamp);
            let timeline = Timeline::new(messages(stamps), Order::LogTime);
            let budget = wrong.len() + 4 * steps.len();
            prop_assert!(timeline.misfits <= budget, "{} of {budget}", timeline.misfits);
            for stretch in &timeline.stretches {
                prop_assert!(stretch.messages.is_sorted_by(|one, other| one.stamp < other.stamp));
            }
        }
    }
}
