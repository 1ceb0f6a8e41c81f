//! The clock of a recording: stamps that do not fit those around them, and a clock that is set back.
//!
//! A stamp may be wrong, and a clock may be set: by NTP, or because a simulation starts again. So the messages of a topic
//! are divided into stretches. Within a stretch the clock does not go back; across stretches nothing is paired and nothing
//! interpolated. Where a clock is set forth, there is a gap, as where the recorder has paused.

use std::collections::VecDeque;

/// Stamps that go back by less are messages that were recorded a little out of order, nanoseconds.
const OUT_OF_ORDER: i64 = 1_000_000_000;

/// What it costs to leave a message out, and to begin a stretch: that is worth it where it saves four messages. Fewer with
/// other stamps than their neighbours are wrong.
const LEFT_OUT: u32 = 2;
const NEW_STRETCH: u32 = 7;

/// How many messages back the last good one is looked for: two new stretches are cheaper than to leave out more.
const REACH: usize = 11;

/// When a message was recorded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Recorded {
    /// By the recorder's clock, nanoseconds.
    pub(super) log_time: i64,
    /// The number of the message in the file.
    pub(super) number: i64,
}

/// A message with a stamp.
pub(super) trait Stamped {
    /// Nanoseconds.
    fn stamp(&self) -> i64;
    fn recorded(&self) -> Recorded;
}

/// By which of the times of [`Recorded`] messages of several topics are compared.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Order {
    /// The recorder's clock never goes back.
    #[default]
    LogTime,
    /// It does, or stands still: the place in the file.
    Number,
}

impl Order {
    fn of(self, recorded: Recorded) -> i64 {
        match self {
            Self::LogTime => recorded.log_time,
            Self::Number => recorded.number,
        }
    }
}

/// A stretch of messages during which the clock was not set back, in order of their stamps, all different.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Stretch<T> {
    /// At least one.
    pub(super) messages: Vec<T>,
    /// When the last was recorded.
    last_recorded: i64,
}

/// The messages of a topic.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Timeline<T> {
    order: Order,
    pub(super) stretches: Vec<Stretch<T>>,
    /// Messages whose stamp does not fit those around them, or that have that of another.
    pub(super) misfits: usize,
}

impl<T> Default for Timeline<T> {
    fn default() -> Self {
        Self { order: Order::default(), stretches: Vec::new(), misfits: 0 }
    }
}

impl<T: Stamped> Timeline<T> {
    /// The messages of a topic, given in the order of the file. Of several with the same stamp the last is kept.
    pub(super) fn new(messages: Vec<T>, order: Order) -> Self {
        let count = messages.len();
        let kept = fitting(&messages);
        let mut groups: Vec<Vec<T>> = Vec::new();
        for (message, kept) in messages.into_iter().zip(kept) {
            match (kept, groups.last_mut()) {
                (Some(false), Some(group)) => group.push(message),
                (Some(_), _) => groups.push(vec![message]),
                (None, _) => {}
            }
        }
        let stretches: Vec<Stretch<T>> = groups.into_iter().map(|group| Stretch::new(group, order)).collect();
        let misfits = count - stretches.iter().map(|stretch| stretch.messages.len()).sum::<usize>();
        Self { order, stretches, misfits }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.stretches.is_empty()
    }

    /// Number of messages.
    pub(super) fn len(&self) -> usize {
        self.stretches.iter().map(|stretch| stretch.messages.len()).sum()
    }

    /// The stretch to which a message of another topic belongs.
    pub(super) fn stretch_of(&self, message: &impl Stamped) -> Option<&Stretch<T>> {
        self.stretches.get(self.index_of_stretch(message)?)
    }

    /// Its index: of those that were recorded at about the same time, the one that has the same stamps then.
    pub(super) fn index_of_stretch(&self, message: &impl Stamped) -> Option<usize> {
        let time = self.order.of(message.recorded());
        // The first that does not end before.
        let next = self.stretches.partition_point(|stretch| stretch.last_recorded < time);
        let candidates = next.saturating_sub(1)..(next + 2).min(self.stretches.len());
        let apart = |index: &usize| self.stretches.get(*index).map(|stretch| stretch.distance(message, self.order));
        candidates.min_by_key(apart)
    }
}

impl<T: Stamped> Stretch<T> {
    fn new(mut messages: Vec<T>, order: Order) -> Self {
        let last_recorded = messages.iter().map(|message| order.of(message.recorded())).max().unwrap_or(0);
        messages.reverse();
        messages.sort_by_key(Stamped::stamp);
        messages.dedup_by_key(|message| message.stamp());
        messages.shrink_to_fit();
        Self { messages, last_recorded }
    }

    /// How far a message is from the one with the most similar stamp: by stamp, if that is more than the disorder of a
    /// recording, then by when they were recorded.
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

/// What messages that are left out and new stretches cost. Of equal costs, the one with smaller gaps is lower: how many
/// digits they have, in binary and tenths of a second.
type Cost = (u32, u32);

/// The cheapest way to a message.
#[derive(Clone, Copy, Debug)]
struct Path {
    cost: Cost,
    /// The message before it that is kept.
    before: Option<usize>,
    begins_stretch: bool,
    /// The latest stamp of the stretch so far.
    latest: i64,
}

/// For each message whether it is kept, and then whether it begins a stretch.
fn fitting<T: Stamped>(messages: &[T]) -> Vec<Option<bool>> {
    let mut paths: Vec<Path> = Vec::with_capacity(messages.len());
    let mut recent: VecDeque<usize> = VecDeque::with_capacity(REACH + 1);
    let left_out = |from: usize, to: usize| LEFT_OUT.saturating_mul(u32::try_from(to - from).unwrap_or(u32::MAX));
    for (index, message) in messages.iter().enumerate() {
        let stamp = message.stamp();
        let cost = (left_out(0, index), 0);
        let mut best = Path { cost, before: None, begins_stretch: true, latest: stamp };
        // The nearest first: of equal ways that which keeps more.
        for before in recent.iter().rev() {
            let Some(path) = paths.get(*before) else { continue };
            let goes_on = stamp >= path.latest.saturating_sub(OUT_OF_ORDER);
            let (cost, gaps) = path.cost;
            let cost = cost.saturating_add(left_out(before + 1, index)) + if goes_on { 0 } else { NEW_STRETCH };
            let cost = (cost, gaps + if goes_on { digits(stamp.saturating_sub(path.latest)) } else { 0 });
            if cost < best.cost || best.before.is_none() && cost == best.cost {
                let latest = if goes_on { path.latest.max(stamp) } else { stamp };
                best = Path { cost, before: Some(*before), begins_stretch: !goes_on, latest };
            }
        }
        paths.push(best);
        recent.push_back(index);
        if recent.len() > REACH {
            recent.pop_front();
        }
    }
    let mut kept = vec![None; messages.len()];
    let ends = paths.iter().enumerate().rev().take(REACH);
    let mut at = ends
        .min_by_key(|(index, path)| (path.cost.0.saturating_add(left_out(index + 1, messages.len())), path.cost.1))
        .map(|(index, _)| index);
    while let Some((index, path)) = at.and_then(|index| Some((index, paths.get(index)?))) {
        if let Some(kept) = kept.get_mut(index) {
            *kept = Some(path.begins_stretch);
        }
        at = path.before;
    }
    kept
}

/// How many binary digits a gap has, in tenths of a second.
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

    /// Messages with stamps in tenths of a second, recorded ten a second.
    fn messages(stamps: impl IntoIterator<Item = i64>) -> Vec<Message> {
        let message = |(stamp, number): (i64, i64)| Message {
            stamp: stamp.saturating_mul(SECOND / 10),
            recorded: Recorded { log_time: number * SECOND / 10, number },
        };
        stamps.into_iter().zip(0..).map(message).collect()
    }

    /// The stamps of each stretch, and the misfits.
    fn stretches(stamps: impl IntoIterator<Item = i64>) -> (Vec<Vec<i64>>, usize) {
        let timeline = Timeline::new(messages(stamps), Order::LogTime);
        let stamps = |stretch: &Stretch<Message>| stretch.messages.iter().map(|m| m.stamp / (SECOND / 10)).collect();
        (timeline.stretches.iter().map(stamps).collect(), timeline.misfits)
    }

    #[test]
    fn a_wrong_stamp_costs_its_message_alone() {
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
    fn a_clock_that_is_set_back_begins_a_stretch_and_one_that_is_set_forth_does_not() {
        let back = (36_000..36_050).chain(10..60).chain(10..80);
        assert_eq!(stretches(back), (vec![(36_000..36_050).collect(), (10..60).collect(), (10..80).collect()], 0));
        let forth_and_back = (10..60).chain(36_000..36_050).chain(110..160);
        let expected = vec![(10..60).chain(36_000..36_050).collect(), (110..160).collect()];
        assert_eq!(stretches(forth_and_back), (expected, 0));
    }

    #[test]
    fn messages_a_little_out_of_order_stay_and_equal_stamps_are_one() {
        assert_eq!(stretches([10, 12, 11, 13, 13, 5, 14]), (vec![vec![5, 10, 11, 12, 13, 14]], 1));
        assert_eq!(stretches([]), (vec![], 0));
    }

    #[test]
    fn the_stretch_of_another_topic_is_found_by_stamp_and_by_when_it_was_recorded() {
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
        /// Whatever is wrong with some stamps and wherever the clock is set: at most as many good messages are left out as
        /// there are bad ones.
        #[test]
        fn no_more_is_lost_than_is_wrong(
            wrong in proptest::collection::btree_map(0usize..200, -1_000_000i64..1_000_000, 0..30),
            steps in proptest::collection::btree_map(20usize..180, -5_000i64..5_000, 0..3),
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
