//! Messages waiting for a viewer: bounded, so that a slow viewer costs nothing.

use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use tungstenite::{Bytes, Message};

/// Limits of the queue of a Foxglove viewer. The first message always fits.
const MAX_MESSAGES: usize = 256;
const MAX_BYTES: usize = 64 << 20;

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

/// The messages that a Foxglove viewer has not been sent.
#[derive(Debug, Default)]
pub(crate) struct MessageQueue {
    waiting: Mutex<Waiting>,
    news: Condvar,
}

#[derive(Debug, Default)]
struct Waiting {
    texts: VecDeque<String>,
    data: VecDeque<(u32, u64, Bytes)>,
    bytes: usize,
}

impl MessageQueue {
    /// Adds a message. Returns the number of older ones that had to go.
    pub(crate) fn push(&self, message: Queued) -> u64 {
        let mut waiting = lock(&self.waiting);
        let mut dropped = 0;
        match message {
            Queued::Text(text) => waiting.texts.push_back(text),
            Queued::Data { subscription, time, data } => {
                waiting.bytes += data.len();
                waiting.data.push_back((subscription, time, data));
                while waiting.data.len() > 1 && (waiting.data.len() > MAX_MESSAGES || waiting.bytes > MAX_BYTES) {
                    let oldest = waiting.data.pop_front().map_or(0, |(_, _, data)| data.len());
                    waiting.bytes -= oldest;
                    dropped += 1;
                }
            }
        }
        drop(waiting);
        self.news.notify_one();
        dropped
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
        waiting.bytes -= data.len();
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

    fn data(number: u64, length: usize) -> Queued {
        Queued::Data { subscription: 1, time: number, data: Bytes::from(vec![0; length]) }
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
    fn a_full_queue_loses_its_oldest_data_but_no_text() {
        let queue = MessageQueue::default();
        queue.push(Queued::Text("channels".to_owned()));
        let dropped: u64 = (0..MAX_MESSAGES as u64 + 10).map(|number| queue.push(data(number, 1))).sum();
        assert_eq!(dropped, 10);
        assert!(matches!(queue.take(), Some(Queued::Text(text)) if text == "channels"));
        assert!(matches!(queue.take(), Some(Queued::Data { time: 10, .. })));
        assert_eq!(queue.push(data(999, MAX_BYTES)), MAX_MESSAGES as u64 - 1);
        assert!(matches!(queue.take(), Some(Queued::Data { time: 999, .. })));
    }
}
