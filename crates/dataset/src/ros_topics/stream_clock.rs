//! The clock of a topic of which the messages arrive one by one.
//!
//! A recording is divided into stretches with all of it at hand (`clock.rs`). Here the future is unknown. So a message
//! whose stamp is far from those before is held until the next ones decide: if [`CONFIRMING`] in a row agree, the clock
//! was set, otherwise the stamp was wrong.

use super::clock::{CONFIRMING, OUT_OF_ORDER, Recorded, Stamped};

/// Stamps that are ahead by more than this are held, nanoseconds.
const GAP: i64 = 10_000_000_000;

/// The clock of a topic.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct StreamClock<T> {
    /// Latest stamp of the messages that were read, without those held.
    pub(super) newest: Option<i64>,
    /// Messages with other stamps, fewer than [`CONFIRMING`], each about the time of the one before.
    pub(super) held: Vec<T>,
}

impl<T> Default for StreamClock<T> {
    fn default() -> Self {
        Self { newest: None, held: Vec::new() }
    }
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
    pub(super) fn outdates(&self, message: &impl Stamped) -> bool {
        let (stamp, recorded) = (message.stamp(), message.recorded());
        let is_shortly_before = recorded.log_time >= self.recorded.log_time.saturating_sub(OUT_OF_ORDER);
        let is_like_after = stamp.abs_diff(self.stamp) < stamp.abs_diff(self.before);
        recorded.number < self.recorded.number && !(is_shortly_before && is_like_after)
    }
}

/// The messages that the clock of a stream has decided about when the latest one arrived.
pub(super) struct Reading<T> {
    /// Messages whose stamps are confirmed.
    pub(super) fitting: Vec<T>,
    /// Messages whose stamps turned out to be wrong.
    pub(super) misfits: Vec<T>,
    /// If the clock was set back: where.
    pub(super) set_back: Option<SetBack>,
}

impl<T: Stamped> StreamClock<T> {
    /// Returns true if this message would set the clock back.
    pub(super) fn is_set_back_by(&self, message: &T) -> bool {
        let stamp = message.stamp();
        let agrees = self.held.last().is_some_and(|held| follows(held.stamp(), stamp));
        let newest = self.newest.unwrap_or(stamp);
        agrees
            && self.held.len() + 1 >= CONFIRMING
            && !follows(newest, stamp)
            && latest(&self.held).max(Some(stamp)) < Some(newest)
    }

    /// Reads the stamp of the next message, which is held if it is far from those before.
    pub(super) fn read(&mut self, message: T) -> Reading<T> {
        let stamp = message.stamp();
        let newest = *self.newest.get_or_insert(stamp);
        if follows(newest, stamp) {
            self.newest = Some(newest.max(stamp));
            return Reading { fitting: vec![message], misfits: std::mem::take(&mut self.held), set_back: None };
        }
        let agrees = self.held.last().is_some_and(|held| follows(held.stamp(), stamp));
        let misfits = if agrees { Vec::new() } else { std::mem::take(&mut self.held) };
        self.held.push(message);
        if self.held.len() < CONFIRMING {
            return Reading { fitting: Vec::new(), misfits, set_back: None };
        }
        let confirmed = std::mem::take(&mut self.held);
        self.newest = latest(&confirmed);
        let first = confirmed.first().filter(|_| self.newest < Some(newest));
        let set_back = first.map(|first| SetBack { recorded: first.recorded(), stamp: first.stamp(), before: newest });
        Reading { fitting: confirmed, misfits, set_back }
    }
}

/// Returns the latest stamp.
pub(super) fn latest<T: Stamped>(messages: &[T]) -> Option<i64> {
    messages.iter().map(Stamped::stamp).max()
}

/// Returns true if a stamp may be the next after those up to `newest`.
fn follows(newest: i64, stamp: i64) -> bool {
    (newest.saturating_sub(OUT_OF_ORDER)..=newest.saturating_add(GAP)).contains(&stamp)
}
