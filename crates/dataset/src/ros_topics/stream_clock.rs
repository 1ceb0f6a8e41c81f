//! Timelines of topics of which the messages arrive one by one.
//!
//! A recording is divided into stretches with all of it at hand (`clock.rs`). Here the future is unknown. So a message
//! whose stamp is far from those before is held until the next ones decide: if [`CONFIRMING`] in a row agree, the clock
//! was set, otherwise the stamp was wrong. The timeline has one stretch, the current one.

use super::clock::{OUT_OF_ORDER, Order, Recorded, Stamped, Stretch, Timeline};

/// Stamps that are ahead by more than this are held, nanoseconds.
const GAP: i64 = 10_000_000_000;
/// Number of messages that agree that a clock was set. As many as make a stretch of a recording.
const CONFIRMING: usize = 4;
/// Stamps of a history may be older than its newest by this, nanoseconds.
const HISTORY: i64 = 10_000_000_000;
/// Maximum number of messages of a history: ten seconds at 200 per second.
const MAX_HISTORY: usize = 2048;

/// The clock of a topic.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct StreamClock<T> {
    newest: Option<i64>,
    /// Messages with other stamps, fewer than [`CONFIRMING`], each about the time of the one before.
    held: Vec<T>,
}

impl<T> Default for StreamClock<T> {
    fn default() -> Self {
        Self { newest: None, held: Vec::new() }
    }
}

/// Effects of a message.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Arrival<T> {
    /// The messages that were added: none while one is held.
    pub(crate) added: Vec<T>,
    /// Messages whose stamps turned out to be wrong.
    pub(crate) misfits: Vec<T>,
    /// Messages with the stamp of another.
    pub(crate) repeated: Vec<T>,
    /// If the clock was set back: the messages before, which were removed, and where it was set back.
    pub(crate) set_back: Option<(Vec<T>, SetBack)>,
}

/// The place in a stream at which a clock was set back.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct SetBack {
    /// When the first message after it was received.
    recorded: Recorded,
    /// Stamp of that message, and the latest stamp before, nanoseconds.
    stamp: i64,
    before: i64,
}

impl SetBack {
    /// Returns true if a message of any topic has a stamp by the clock before. Messages of other topics that were sent
    /// after it may have been received shortly before.
    fn outdates(&self, message: &impl Stamped) -> bool {
        let (stamp, recorded) = (message.stamp(), message.recorded());
        let is_shortly_before = recorded.log_time >= self.recorded.log_time.saturating_sub(OUT_OF_ORDER);
        let is_like_after = stamp.abs_diff(self.stamp) < stamp.abs_diff(self.before);
        recorded.number < self.recorded.number && !(is_shortly_before && is_like_after)
    }
}

/// Effects of a message on the stream: the messages to add, those whose stamps are wrong, and where it was set back.
type Reading<T> = (Vec<T>, Vec<T>, Option<SetBack>);

impl<T: Stamped> StreamClock<T> {
    /// Returns true if this message would set the clock back.
    fn is_set_back_by(&self, message: &T) -> bool {
        let stamp = message.stamp();
        let agrees = self.held.last().is_some_and(|held| follows(held.stamp(), stamp));
        let newest = self.newest.unwrap_or(stamp);
        agrees
            && self.held.len() + 1 >= CONFIRMING
            && !follows(newest, stamp)
            && latest(&self.held).max(Some(stamp)) < Some(newest)
    }

    fn read(&mut self, message: T) -> Reading<T> {
        let stamp = message.stamp();
        let newest = *self.newest.get_or_insert(stamp);
        if follows(newest, stamp) {
            self.newest = Some(newest.max(stamp));
            return (vec![message], std::mem::take(&mut self.held), None);
        }
        let agrees = self.held.last().is_some_and(|held| follows(held.stamp(), stamp));
        let misfits = if agrees { Vec::new() } else { std::mem::take(&mut self.held) };
        self.held.push(message);
        if self.held.len() < CONFIRMING {
            return (Vec::new(), misfits, None);
        }
        let confirmed = std::mem::take(&mut self.held);
        self.newest = latest(&confirmed);
        let first = confirmed.first().filter(|_| self.newest < Some(newest));
        let set_back = first.map(|first| SetBack { recorded: first.recorded(), stamp: first.stamp(), before: newest });
        (confirmed, misfits, set_back)
    }
}

fn latest<T: Stamped>(messages: &[T]) -> Option<i64> {
    messages.iter().map(Stamped::stamp).max()
}

/// Returns true if a stamp may be the next after those up to `newest`.
fn follows(newest: i64, stamp: i64) -> bool {
    (newest.saturating_sub(OUT_OF_ORDER)..=newest.saturating_add(GAP)).contains(&stamp)
}

impl<T: Stamped + Copy> Timeline<T> {
    /// Returns true if [`Self::arrive`] would remove all messages before, because this one confirms that the clock was set
    /// back.
    pub(crate) fn is_set_back_by(&self, message: &T) -> bool {
        self.clock.is_set_back_by(message)
    }

    /// Adds a message, or holds it.
    pub(crate) fn arrive(&mut self, message: T) -> Arrival<T> {
        let (fitting, misfits, set_back) = self.clock.read(message);
        self.misfits += misfits.len();
        let set_back = set_back.map(|at| (self.take_all(), at));
        let (mut added, mut repeated) = (Vec::new(), Vec::new());
        for message in fitting {
            let of_it = if self.insert(message) { &mut added } else { &mut repeated };
            of_it.push(message);
        }
        Arrival { added, misfits, repeated, set_back }
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

    const SECOND: i64 = 1_000_000_000;

    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    struct Message {
        stamp: i64,
        number: i64,
    }

    impl Stamped for Message {
        fn stamp(&self) -> i64 {
            self.stamp
        }

        fn recorded(&self) -> Recorded {
            Recorded { log_time: self.number * SECOND / 10, number: self.number }
        }
    }

    /// Feeds stamps in tenths of a second. Returns the timeline, and the results of all arrivals: the number of misfits
    /// and of repeated messages, and where the clock was set back.
    fn fed(stamps: impl IntoIterator<Item = i64>) -> (Timeline<Message>, usize, usize, Vec<SetBack>) {
        let (mut timeline, mut misfits, mut repeated, mut set_back) = (Timeline::default(), 0, 0, Vec::new());
        for (stamp, number) in stamps.into_iter().zip(1..) {
            let message = Message { stamp: stamp.saturating_mul(SECOND / 10), number };
            let is_expected = timeline.is_set_back_by(&message);
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
}
