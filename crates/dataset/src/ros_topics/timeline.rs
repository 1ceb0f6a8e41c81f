//! The messages of a topic in time order, from a recording or as they arrive.
//!
//! A timeline is divided into stretches, within which the clock does not go back (`clock.rs`). Across stretches nothing is
//! paired or interpolated. That of a stream has one stretch, the current one (`stream_clock.rs`), and forgets.

use super::clock::{OUT_OF_ORDER, Recorded, Stamped, fitting};
use super::stream_clock::{Reading, SetBack, StreamClock, latest};

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
    /// In file order, until they are sorted in.
    recorded: Vec<T>,
    /// For messages that arrive one by one.
    clock: StreamClock<T>,
}

impl<T> Default for Timeline<T> {
    fn default() -> Self {
        Self {
            order: Order::default(),
            stretches: Vec::new(),
            misfits: 0,
            duplicates: 0,
            recorded: Vec::new(),
            clock: StreamClock::default(),
        }
    }
}

impl<T: Stamped> Timeline<T> {
    /// Adds a message, which is not sorted in yet.
    pub(crate) fn record(&mut self, message: T) {
        self.recorded.push(message);
    }

    /// Returns the number of messages that are not sorted in.
    pub(crate) fn unsorted(&self) -> usize {
        self.recorded.len()
    }

    /// Returns the stamp of all messages that are not sorted in, if there are several and all have the same, although they
    /// were recorded at different times: the clock stands still, or a constant was written.
    pub(crate) fn constant_stamp(&self) -> Option<i64> {
        let (first, rest) = self.recorded.split_first()?;
        let is_constant = rest.iter().all(|message| message.stamp() == first.stamp());
        let is_recorded_later = rest.iter().any(|message| message.recorded().log_time != first.recorded().log_time);
        (rest.len() >= 2 && is_constant && is_recorded_later).then(|| first.stamp())
    }

    /// Replaces the stamps of the messages that are not sorted in by their recording times, if all are the same.
    pub(crate) fn replace_constant_stamp(&mut self) {
        if self.constant_stamp().is_some() {
            self.recorded.iter_mut().for_each(|message| message.set_stamp(message.recorded().log_time));
        }
    }

    /// Divides all messages of a recording's topic into stretches.
    pub(crate) fn sort(&mut self, order: Order) {
        let messages = std::mem::take(&mut self.recorded);
        let count = messages.len();
        let decisions = fitting(&messages);
        let misfits = decisions.iter().filter(|decision| decision.is_none()).count();
        let mut groups: Vec<Vec<T>> = Vec::new();
        for (message, begins_stretch) in messages.into_iter().zip(decisions) {
            match (begins_stretch, groups.last_mut()) {
                (Some(false), Some(group)) => group.push(message),
                (Some(_), _) => groups.push(vec![message]),
                (None, _) => {}
            }
        }
        let stretches: Vec<Stretch<T>> = groups.into_iter().map(|group| Stretch::new(group, order)).collect();
        let kept: usize = stretches.iter().map(|stretch| stretch.messages.len()).sum();
        *self = Self { order, stretches, misfits, duplicates: count - misfits - kept, ..Self::default() };
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

/// Stamps of a history may be older than its newest by this, nanoseconds.
const HISTORY: i64 = 10_000_000_000;
/// Maximum number of messages of a history: ten seconds at 200 per second.
const MAX_HISTORY: usize = 2048;

/// Effects of a message.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Arrival<T> {
    /// Messages whose stamps turned out to be wrong.
    pub(crate) misfits: Vec<T>,
    /// Messages with the stamp of another.
    pub(crate) repeated: Vec<T>,
    /// If the clock was set back: the messages before, which were removed, and where it was set back.
    pub(crate) set_back: Option<(Vec<T>, SetBack)>,
}

impl<T: Stamped + Copy> Timeline<T> {
    /// Returns true if [`Self::arrive`] would remove all messages before, because one that was recorded confirms that the
    /// clock was set back.
    pub(crate) fn is_set_back(&self) -> bool {
        self.recorded.iter().any(|message| self.clock.is_set_back_by(message))
    }

    /// Removes and returns the messages that are not sorted in.
    pub(crate) fn take_unsorted(&mut self) -> Vec<T> {
        std::mem::take(&mut self.recorded)
    }

    /// Sorts in the recorded messages of a stream, and forgets old ones.
    pub(crate) fn arrive_all(&mut self) {
        for message in self.take_unsorted() {
            self.arrive(message);
        }
        self.trim_history();
    }

    /// Adds a message, or holds it.
    pub(crate) fn arrive(&mut self, message: T) -> Arrival<T> {
        let Reading { fitting, misfits, set_back } = self.clock.read(message);
        self.misfits += misfits.len();
        let set_back = set_back.map(|at| (self.take_all(), at));
        let repeated = fitting.into_iter().filter(|message| !self.insert(*message)).collect();
        Arrival { misfits, repeated, set_back }
    }

    /// Inserts a message in order. Returns false if there is one with its stamp, of which one is kept.
    fn insert(&mut self, message: T) -> bool {
        let recorded = self.order.of(message.recorded());
        let Some(stretch) = self.stretches.first_mut() else {
            self.order = Order::Number;
            let last_recorded = self.order.of(message.recorded());
            self.stretches.push(Stretch { messages: vec![message], last_recorded });
            return true;
        };
        stretch.last_recorded = stretch.last_recorded.max(recorded);
        let place = stretch.messages.partition_point(|other| other.stamp() < message.stamp());
        match stretch.messages.get_mut(place) {
            Some(same) if same.stamp() == message.stamp() => {
                if T::KEEPS_LAST {
                    *same = message;
                }
                self.duplicates += 1;
                false
            }
            _ => {
                stretch.messages.insert(place, message);
                true
            }
        }
    }

    /// Returns the messages in time order, without those held.
    pub(crate) fn messages(&self) -> &[T] {
        self.stretches.first().map_or(&[], |stretch| &stretch.messages)
    }

    /// Returns the latest stamp so far, nanoseconds.
    pub(crate) fn newest(&self) -> Option<i64> {
        self.clock.newest
    }

    /// Removes and returns all messages that are not held.
    pub(crate) fn take_all(&mut self) -> Vec<T> {
        std::mem::take(&mut self.stretches).into_iter().flat_map(|stretch| stretch.messages).collect()
    }

    /// Removes and returns the messages held.
    pub(crate) fn take_held(&mut self) -> Vec<T> {
        std::mem::take(&mut self.clock.held)
    }

    /// Removes and returns messages that are not held.
    pub(crate) fn take_if(&mut self, is_taken: impl Fn(&T) -> bool) -> Vec<T> {
        let Some(stretch) = self.stretches.first_mut() else { return Vec::new() };
        let (taken, kept) = std::mem::take(&mut stretch.messages).into_iter().partition(is_taken);
        stretch.messages = kept;
        if stretch.messages.is_empty() {
            self.stretches.clear();
        }
        taken
    }

    /// Removes and returns the message with a number, held or not.
    pub(crate) fn take_number(&mut self, number: i64) -> Vec<T> {
        let is_it = |message: &T| message.recorded().number == number;
        let mut taken = self.take_if(is_it);
        let (held, kept) = self.take_held().into_iter().partition(is_it);
        self.clock.held = kept;
        taken.extend::<Vec<T>>(held);
        taken
    }

    /// Removes and returns all messages from before the clock of another topic was set back. If none are left but some
    /// are held, these are added, as they contradict nothing any more.
    pub(crate) fn restart(&mut self, at: &SetBack) -> Vec<T> {
        let is_before = |message: &T| at.outdates(message);
        let mut removed = self.take_if(is_before);
        let (before, held) = self.take_held().into_iter().partition::<Vec<T>, _>(is_before);
        removed.extend(before);
        if self.is_empty() {
            self.clock.newest = latest(&held);
            for message in held {
                if !self.insert(message) && !T::KEEPS_LAST {
                    removed.push(message);
                }
            }
        } else {
            self.clock = StreamClock { newest: latest(self.messages()), held };
        }
        removed
    }

    /// Forgets messages that are too old or too many, in large steps.
    pub(crate) fn trim_history(&mut self) {
        let Some(newest) = self.clock.newest else { return };
        let Some(stretch) = self.stretches.first_mut() else { return };
        let is_old = |message: &T, by: i64| message.stamp() < newest.saturating_sub(by);
        let messages = &mut stretch.messages;
        if messages.first().is_some_and(|first| is_old(first, 2 * HISTORY)) {
            messages.drain(..messages.partition_point(|message| is_old(message, HISTORY)));
        }
        if messages.len() >= 2 * MAX_HISTORY {
            messages.drain(..messages.len() - MAX_HISTORY);
        }
        if messages.is_empty() {
            self.stretches.clear();
        }
    }
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

        fn set_stamp(&mut self, stamp: i64) {
            self.stamp = stamp;
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

    /// Returns the timeline of a recording's messages.
    fn sorted(messages: Vec<Message>) -> Timeline<Message> {
        let mut timeline = Timeline::default();
        messages.into_iter().for_each(|message| timeline.record(message));
        timeline.sort(Order::LogTime);
        timeline
    }

    /// Returns the stamps of each stretch, and the number of messages left out.
    fn stretches(stamps: impl IntoIterator<Item = i64>) -> (Vec<Vec<i64>>, usize) {
        let timeline = sorted(messages(stamps));
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
    fn a_constant_stamp_is_replaced_by_the_recording_time() {
        let timeline = |stamps: &[i64]| {
            let mut timeline = Timeline::default();
            messages(stamps.iter().copied()).into_iter().for_each(|message| timeline.record(message));
            timeline.replace_constant_stamp();
            timeline.sort(Order::LogTime);
            timeline.len()
        };
        assert_eq!([timeline(&[7; 5]), timeline(&[7; 2]), timeline(&[7, 7, 7, 8]), timeline(&[])], [5, 1, 2, 0]);
    }

    #[test]
    fn slightly_unordered_messages_are_kept_and_equal_stamps_merged() {
        assert_eq!(stretches([10, 12, 11, 13, 13, 5, 14]), (vec![vec![5, 10, 11, 12, 13, 14]], 1));
        assert_eq!(stretches([]), (vec![], 0));
    }

    #[test]
    fn the_stretch_of_another_topic_is_found_by_stamp_and_recording_time() {
        let timeline = sorted(messages((10..60).chain(10..60).chain(4000..4050)));
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

    /// Feeds stamps in tenths of a second. Returns the timeline, and the results of all arrivals: the number of misfits
    /// and of repeated messages, and where the clock was set back.
    fn fed(stamps: impl IntoIterator<Item = i64>) -> (Timeline<Message>, usize, usize, Vec<SetBack>) {
        let (mut timeline, mut misfits, mut repeated, mut set_back) = (Timeline::default(), 0, 0, Vec::new());
        for message in messages(stamps) {
            timeline.record(message);
            let is_expected = timeline.is_set_back();
            assert_eq!(timeline.take_unsorted(), [message]);
            let arrival = timeline.arrive(message);
            assert_eq!(arrival.set_back.is_some(), is_expected, "it is known before");
            misfits += arrival.misfits.len();
            repeated += arrival.repeated.len();
            set_back.extend(arrival.set_back.map(|(_, at)| at));
        }
        (timeline, misfits, repeated, set_back)
    }

    fn stamps(timeline: &Timeline<Message>) -> Vec<i64> {
        timeline.messages().iter().map(|message| message.stamp / (SECOND / 10)).collect()
    }

    #[test]
    fn a_wrong_stamp_is_left_out_and_disorder_sorted() {
        let (timeline, misfits, repeated, set_back) = fed([100, 102, 101, 5, 103, i64::MAX, 103, 900, 104]);
        assert_eq!(stamps(&timeline), [100, 101, 102, 103, 104]);
        assert_eq!((misfits, repeated, set_back.len()), (3, 1, 0));
    }

    #[test]
    fn four_messages_that_agree_set_the_clock() {
        let (timeline, misfits, _, set_back) = fed((500..520).chain(10..13));
        assert_eq!((timeline.messages().len(), misfits, set_back.len()), (20, 0, 0));
        let (timeline, _, _, set_back) = fed((500..520).chain(10..14));
        assert_eq!((stamps(&timeline), set_back.len()), (vec![10, 11, 12, 13], 1));
        let (timeline, _, _, set_back) = fed((500..520).chain(1000..1004));
        assert_eq!((timeline.messages().len(), set_back.len()), (24, 0), "a gap");
    }

    #[test]
    fn only_what_is_from_before_is_forgotten() {
        let at = fed((500..520).chain(10..14)).3[0];
        // Slower than the topic whose clock was set back, so that its last message is held.
        let (mut timeline, ..) = fed((500..519).chain([9, 11]));
        assert_eq!(timeline.restart(&at).len(), 19);
        assert_eq!((stamps(&timeline), timeline.newest()), (vec![9, 11], Some(11 * SECOND / 10)));
    }

    #[test]
    fn a_history_is_limited() {
        let (mut timeline, ..) = fed(0..300);
        timeline.trim_history();
        assert_eq!(stamps(&timeline), (199..300).collect::<Vec<_>>());
        let (mut timeline, ..) = fed((0..5000).map(|_| 7));
        timeline.trim_history();
        assert_eq!(timeline.messages().len(), 1);
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
            let timeline = sorted(messages(stamps));
            let budget = wrong.len() + 4 * steps.len();
            prop_assert!(timeline.misfits <= budget, "{} of {budget}", timeline.misfits);
            for stretch in &timeline.stretches {
                prop_assert!(stretch.messages.is_sorted_by(|one, other| one.stamp < other.stamp));
            }
        }
    }
}
