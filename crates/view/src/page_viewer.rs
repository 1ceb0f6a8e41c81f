//! A browser that shows the page.

use crate::ViewRequest;
use crate::connection::Viewer;
use crate::hub::Shared;
use crate::page_messages::Hello;
use crate::slots::PageSlot;
use std::sync::Arc;
use std::time::Duration;
use tungstenite::Message;

/// Messages under way that the page has not shown yet. More would only queue up in the browser.
const MAX_UNDER_WAY: usize = 3;
/// Pause while the page has enough to do.
const PAUSE: Duration = Duration::from_millis(5);
/// The page's answer to each message, once it is shown.
const SHOWN: &str = "shown";

/// A page that is sent the newest of everything.
#[derive(Debug)]
pub(crate) struct PageViewer<'a> {
    shared: &'a Shared,
    slot: Arc<PageSlot>,
    under_way: usize,
}

impl<'a> PageViewer<'a> {
    /// A new viewer; `None` if there are too many.
    pub(crate) fn join(shared: &'a Shared) -> Option<Self> {
        let room = shared.limits.viewers.saturating_sub(shared.messages.viewers());
        Some(Self { shared, slot: shared.pages.join(Hello::of(shared), room)?, under_way: 0 })
    }

    /// Answers a request. Returns false if it is none, or nobody answers.
    fn answer(&self, text: &str) -> bool {
        let (Some(answer), Some(request)) = (self.shared.answer.get(), ViewRequest::parse(text)) else { return false };
        let answered = (answer.0)(request.clone());
        self.slot.put_answer(request.answered(&answered));
        true
    }
}

impl Drop for PageViewer<'_> {
    fn drop(&mut self) {
        self.shared.pages.leave(&self.slot);
    }
}

impl Viewer for PageViewer<'_> {
    fn next(&mut self) -> Option<Message> {
        if self.under_way == MAX_UNDER_WAY {
            return None;
        }
        let message = self.slot.take()?;
        self.under_way += 1;
        Some(message)
    }

    fn remaining(&mut self) -> Option<Message> {
        self.slot.take()
    }

    fn wait(&mut self, time: Duration) {
        if self.under_way == MAX_UNDER_WAY { std::thread::sleep(PAUSE) } else { self.slot.wait(time) }
    }

    fn receive(&mut self, message: &Message) -> bool {
        let Message::Text(text) = message else { return false };
        if text.as_str() != SHOWN {
            return self.answer(text);
        }
        let is_expected = self.under_way > 0;
        self.under_way -= usize::from(is_expected);
        is_expected
    }

    fn owes_answer(&self) -> bool {
        self.under_way > 0
    }
}
