//! Requests to a running session, from other threads.

use crate::LiveSession;
use splatseg::segmenter::Detail;
use splatseg_geometry::SegmentId;
use std::path::PathBuf;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::time::Duration;

/// Number of requests that may wait.
const WAITING: usize = 8;
/// Errors of whoever has asked.
const LATE: &str = "the session has not answered in time";
const ENDED: &str = "the session has ended";

/// A request to a session, carried out between two frames.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum LiveRequest {
    /// Save the map and the list of objects.
    Save,
    /// Replace the map by the saved one, or by that of another file.
    Load(Option<PathBuf>),
    /// Forget everything.
    Reset,
    /// Give an object the label of a person, or take its label away.
    Name(SegmentId, Option<String>),
    /// Make objects of the map one: see [`Pipeline::merge_objects`](splatseg::Pipeline::merge_objects).
    Merge(Vec<SegmentId>),
    /// Segment later frames more or less finely.
    Detail(Detail),
    /// Pause (`true`) or go on.
    Pause(bool),
}

/// Sends requests to a session.
#[derive(Clone, Debug)]
pub struct Requests(SyncSender<PendingRequest>);

/// Requests that wait for the session between two frames.
pub(crate) enum PendingRequest {
    /// A request, and where its answer goes: what was done, or the error.
    Execute(LiveRequest, SyncSender<Result<String, String>>),
    /// A look at the session.
    Look(Box<dyn FnOnce(&LiveSession) + Send>),
}

impl Requests {
    pub(crate) fn channel() -> (Self, Receiver<PendingRequest>) {
        let (sender, receiver) = sync_channel(WAITING);
        (Self(sender), receiver)
    }

    /// Sends a request and waits for its answer, for `timeout` at most.
    ///
    /// # Errors
    /// A sentence: the request failed, or the session is busy or has ended.
    pub fn send(&self, request: LiveRequest, timeout: Duration) -> Result<String, String> {
        let (answer, answered) = sync_channel(1);
        self.put(PendingRequest::Execute(request, answer))?;
        answered.recv_timeout(timeout).unwrap_or_else(|error| Err(unanswered(error)))
    }

    /// Looks at the session between two frames, and waits for what `look` returns, for `timeout` at most.
    ///
    /// # Errors
    /// A sentence: the session is busy or has ended.
    pub fn look<T: Send + 'static>(
        &self,
        look: impl FnOnce(&LiveSession) -> T + Send + 'static,
        timeout: Duration,
    ) -> Result<T, String> {
        let (answer, answered) = sync_channel(1);
        // Whoever has asked may have stopped waiting.
        self.put(PendingRequest::Look(Box::new(move |session| drop(answer.try_send(look(session))))))?;
        answered.recv_timeout(timeout).map_err(unanswered)
    }

    fn put(&self, request: PendingRequest) -> Result<(), String> {
        self.0.try_send(request).map_err(|error| match error {
            TrySendError::Full(_) => "the session is busy".to_owned(),
            TrySendError::Disconnected(_) => ENDED.to_owned(),
        })
    }
}

fn unanswered(error: RecvTimeoutError) -> String {
    match error {
        RecvTimeoutError::Timeout => LATE.to_owned(),
        RecvTimeoutError::Disconnected => ENDED.to_owned(),
    }
}
