//! Foxglove, or another program with its protocol.

use crate::connection::Viewer;
use crate::foxglove::{Request, error_status, message_data, parse_request};
use crate::hub::Shared;
use crate::slots::{MessageQueue, Queued};
use std::sync::Arc;
use std::time::Duration;
use tungstenite::Message;

/// A viewer that is sent the messages of its subscriptions.
#[derive(Debug)]
pub(crate) struct FoxgloveViewer<'a> {
    shared: &'a Shared,
    queue: Arc<MessageQueue>,
}

impl<'a> FoxgloveViewer<'a> {
    /// A new viewer; `None` if there are too many.
    pub(crate) fn join(shared: &'a Shared) -> Option<Self> {
        let room = shared.limits.viewers.saturating_sub(shared.pages.viewers());
        let queue = shared.messages.join(&shared.session, room)?;
        Some(Self { shared, queue })
    }

    /// Performs a request. Returns false if any part of it is wrong.
    fn perform(&self, request: Request) -> bool {
        let messages = &self.shared.messages;
        // All parts are performed, whatever the others are.
        match request {
            Request::Subscribe(pairs) => {
                pairs.into_iter().filter(|(number, id)| !messages.subscribe(&self.queue, *number, *id)).count() == 0
            }
            Request::Unsubscribe(numbers) => {
                numbers.into_iter().filter(|number| !messages.unsubscribe(&self.queue, *number)).count() == 0
            }
            Request::Other(_) => false,
        }
    }
}

impl Drop for FoxgloveViewer<'_> {
    fn drop(&mut self) {
        self.shared.messages.leave(&self.queue);
    }
}

impl Viewer for FoxgloveViewer<'_> {
    fn next(&mut self) -> Option<Message> {
        Some(match self.queue.take()? {
            Queued::Text(text) => Message::text(text),
            Queued::Data { subscription, time, data } => Message::binary(message_data(subscription, time, &data)),
        })
    }

    fn remaining(&mut self) -> Option<Message> {
        self.next()
    }

    fn wait(&mut self, time: Duration) {
        self.queue.wait(time);
    }

    fn receive(&mut self, message: &Message) -> bool {
        let Message::Text(text) = message else { return false };
        let Some(request) = parse_request(text) else { return false };
        let other = if let Request::Other(name) = &request { format!("{name} is not offered") } else { String::new() };
        let done = self.perform(request);
        // A viewer with more mistakes than it reads answers gets one of them.
        if !done && !self.queue.has_text() {
            let text = if other.is_empty() { "a subscription or its channel is unknown or in use" } else { &other };
            self.queue.push(Queued::Text(error_status(text)));
        }
        done
    }

    fn owes_answer(&self) -> bool {
        false
    }
}
