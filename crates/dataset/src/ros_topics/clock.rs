//! The clock of a recording: stamps that do not fit those of their neighbours, and clocks that are set back.
//!
//! A stamp may be wrong, and a clock may be set: by NTP, or because a simulation restarts. So the messages of a topic
//! are divided into stretches ([`Timeline`](super::timeline::Timeline)). Within a stretch the clock does not go back. A
//! clock set forward leaves a gap, as if the recorder had paused.
//!
//! Each stamp is weighed against all others here. A stream, whose future is unknown, decides with the same numbers in
//! `stream_clock.rs`.

use std::cmp::Ordering;

/// Stamps that go back by less than this are messages recorded slightly out of order, nanoseconds.
pub(crate) const OUT_OF_ORDER: i64 = 1_000_000_000;

/// Costs of leaving out a message and of starting a stretch.
const LEFT_OUT: u32 = 4;
const NEW_STRETCH: u32 = 14;

/// Number of messages that make a stretch: leaving them out would cost more. A shorter run of deviating stamps counts as
/// wrong.
pub(super) const CONFIRMING: usize = (NEW_STRETCH / LEFT_OUT + 1) as usize;

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
    fn set_stamp(&mut self, stamp: i64);
    fn recorded(&self) -> Recorded;
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
pub(super) fn fitting<T: Stamped>(messages: &[T]) -> Vec<Option<bool>> {
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
