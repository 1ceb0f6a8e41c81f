//! Counters of a server.

use std::sync::atomic::{AtomicU64, Ordering};

/// Counts since the start of a [`ViewServer`](crate::ViewServer).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ViewCounts {
    /// Connections accepted by the system, including those refused later.
    pub connections: u64,
    /// Requests without the token, for a foreign host name or from a foreign page, or beyond the number of viewers, and
    /// connections that had to make room before they had shown the token.
    pub refused: u64,
    /// Requests that are not valid HTTP, too large, or not in time.
    pub bad_requests: u64,
    /// Messages of viewers that violate their protocol.
    pub bad_messages: u64,
    /// Frames replaced by a newer one before they were encoded.
    pub frames_skipped: u64,
    /// Frames replaced by a newer one before they were sent, over all viewers.
    pub frames_dropped: u64,
    /// Foxglove messages replaced by a newer one of their channel before they were sent, over all viewers.
    pub messages_dropped: u64,
    /// Viewers disconnected because they took or answered nothing.
    pub viewers_dropped: u64,
}

/// The counters, shared by all threads.
#[derive(Debug, Default)]
pub(crate) struct Counters {
    pub(crate) connections: AtomicU64,
    pub(crate) refused: AtomicU64,
    pub(crate) bad_requests: AtomicU64,
    pub(crate) bad_messages: AtomicU64,
    pub(crate) frames_skipped: AtomicU64,
    pub(crate) frames_dropped: AtomicU64,
    pub(crate) messages_dropped: AtomicU64,
    pub(crate) viewers_dropped: AtomicU64,
}

/// Adds one to a counter.
pub(crate) fn count(counter: &AtomicU64) {
    counter.fetch_add(1, Ordering::Relaxed);
}

impl Counters {
    pub(crate) fn snapshot(&self) -> ViewCounts {
        let value = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
        ViewCounts {
            connections: value(&self.connections),
            refused: value(&self.refused),
            bad_requests: value(&self.bad_requests),
            bad_messages: value(&self.bad_messages),
            frames_skipped: value(&self.frames_skipped),
            frames_dropped: value(&self.frames_dropped),
            messages_dropped: value(&self.messages_dropped),
            viewers_dropped: value(&self.viewers_dropped),
        }
    }
}
