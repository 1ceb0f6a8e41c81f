//! Messages waiting for a viewer: bounded, so that a slow viewer costs nothing.

use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use tungstenite::{Bytes, Message};

/// Locks a mutex. A thread that panicked leaves nothing half-changed here.
pub(crate) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Answers to a page that wait. The oldest is discarded if the page asks on without taking them.
const MAX_ANSWERS: usize = 64;

/// Kinds of messages for the page of which the newest counts, in the order of sending.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum PageMessage {
    Hello,
    Status,
    Objects,
    Frame,
    Map,
    Plan,
}

impl PageMessage {
    pub(crate) const COUNT: usize = 6;
}

/// The newest message of each kind, and the answers, that a page has not been sent.
#[derive(Debug, Default)]
pub(crate) struct PageSlot {
    waiting: Mutex<WaitingForPage>,
    news: Condvar,
}

#[derive(Debug, Default)]
struct WaitingForPage {
    newest: [Option<Message>; PageMessage::COUNT],
    answers: VecDeque<Message>,
}

impl WaitingForPage {
    fn is_empty(&self) -> bool {
        self.answers.is_empty() && self.newest.iter().all(Option::is_none)
    }

    /// Takes the next message: answers come before everything but the first message.
    fn take(&mut self) -> Option<Message> {
        let hello = self.newest.first_mut().and_then(Option::take);
        hello.or_else(|| self.answers.pop_front()).or_else(|| self.newest.iter_mut().find_map(Option::take))
    }
}

impl PageSlot {
    /// Puts a message in the place of an older one. Returns true if that was not sent.
    pub(crate) fn put(&self, kind: PageMessage, message: Message) -> bool {
        let old = lock(&self.waiting).newest.get_mut(kind as usize).and_then(|place| place.replace(message));
        self.news.notify_one();
        old.is_some()
    }

    /// Adds the answer to a request of the page: each request has one.
    pub(crate) fn put_answer(&self, message: Message) {
        let mut waiting = lock(&self.waiting);
        if waiting.answers.len() == MAX_ANSWERS {
            waiting.answers.pop_front();
        }
        waiting.answers.push_back(message);
        drop(waiting);
        self.news.notify_one();
    }

    /// Removes all messages but answers.
    pub(crate) fn clear(&self) {
        lock(&self.waiting).newest = Default::default();
    }

    /// Takes the next message.
    pub(crate) fn take(&self) -> Option<Message> {
        lock(&self.waiting).take()
    }

    /// Waits for a message, at most for this long.
    pub(crate) fn wait(&self, time: Duration) {
        let waited = self.news.wait_timeout_while(lock(&self.waiting), time, |waiting| waiting.is_empty());
        drop(waited.unwrap_or_else(PoisonError::into_inner));
    }
}

/// A message for a Foxglove viewer.
#[derive(Clone, Debug)]
pub(crate) enum Queued {
    /// Text of the protocol. Never discarded.
    Text(String),
    /// Data of a channel.
    Data {
        /// The viewer's number for its subscription.
        subscription: u32,
        /// Nanoseconds.
        time: u64,
        /// The message, CDR.
        data: Bytes,
    },
}

/// The messages that a Foxglove viewer has not been sent: of each subscription the newest one.
#[derive(Debug, Default)]
pub(crate) struct MessageQueue {
    waiting: Mutex<Waiting>,
    news: Condvar,
}

#[derive(Debug, Default)]
struct Waiting {
    texts: VecDeque<String>,
    /// Subscription, time and message; each subscription at most once, the one that has waited longest first.
    data: VecDeque<(u32, u64, Bytes)>,
}

impl MessageQueue {
    /// Adds a message; data takes the place of older data of its subscription. Returns true if that was not sent.
    pub(crate) fn push(&self, message: Queued) -> bool {
        let mut waiting = lock(&self.waiting);
        let mut old = None;
        match message {
            Queued::Text(text) => waiting.texts.push_back(text),
            Queued::Data { subscription, time, data } => {
                let new = (subscription, time, data);
                // Its place in the line stays, so that a channel with many messages and one with few take turns.
                match waiting.data.iter_mut().find(|(of, ..)| *of == subscription) {
                    Some(place) => old = Some(std::mem::replace(place, new)),
                    None => waiting.data.push_back(new),
                }
            }
        }
        drop(waiting);
        self.news.notify_one();
        old.is_some()
    }

    /// Discards the data of a subscription that has ended.
    pub(crate) fn forget(&self, subscription: u32) {
        lock(&self.waiting).data.retain(|(of, ..)| *of != subscription);
    }

    /// True if a text waits.
    pub(crate) fn has_text(&self) -> bool {
        !lock(&self.waiting).texts.is_empty()
    }

    /// Takes the next message: texts first, so that a channel is announced before its data.
    pub(crate) fn take(&self) -> Option<Queued> {
        let mut waiting = lock(&self.waiting);
        if let Some(text) = waiting.texts.pop_front() {
            return Some(Queued::Text(text));
        }
        let (subscription, time, data) = waiting.data.pop_front()?;
        Some(Queued::Data { subscription, time, data })
    }

    /// Waits for a message, at most for this long.
    pub(crate) fn wait(&self, time: Duration) {
        let is_empty = |waiting: &mut Waiting| waiting.texts.is_empty() && waiting.data.is_empty();
        let waited = self.news.wait_timeout_while(lock(&self.waiting), time, is_empty);
        drop(waited.unwrap_or_else(PoisonError::into_inner));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn data(subscription: u32, time: u64) -> Queued {
        Queued::Data { subscription, time, data: Bytes::from_static(&[0]) }
    }

    #[test]
    fn the_newest_frame_wins_and_others_stay() {
        let slot = PageSlot::default();
        assert!(!slot.put(PageMessage::Frame, Message::text("old")));
        assert!(!slot.put(PageMessage::Hello, Message::text("hello")));
        assert!(slot.put(PageMessage::Frame, Message::text("new")));
        assert_eq!(
            [slot.take(), slot.take(), slot.take()],
            [Some("hello"), Some("new"), None].map(|text| text.map(Message::text))
        );
    }

    #[test]
    fn the_newest_data_of_each_subscription_waits_and_no_text_is_lost() {
        let queue = MessageQueue::default();
        let dropped = [data(1, 10), data(2, 11), Queued::Text("channels".to_owned()), data(1, 12), data(1, 13)]
            .map(|message| queue.push(message));
        assert_eq!(dropped, [false, false, false, true, true]);
        assert!(matches!(queue.take(), Some(Queued::Text(text)) if text == "channels"));
        assert!(matches!(queue.take(), Some(Queued::Data { subscription: 1, time: 13, .. })));
        // The first one has been taken, so its next message comes after the other channel's.
        assert!(!queue.push(data(1, 14)));
        assert!(matches!(queue.take(), Some(Queued::Data { subscription: 2, time: 11, .. })));
        queue.forget(1);
        assert!(queue.take().is_none(), "a subscription that has ended gets nothing");
    }
}
