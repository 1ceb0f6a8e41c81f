//! Requests to a running session, from other threads.

use std::path::PathBuf;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::time::Duration;

/// Number of requests that may wait.
const WAITING: usize = 8;

/// Something that a session is asked to do between two frames.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum LiveRequest {
    /// Save the map and the list of objects.
    Save,
    /// Replace the map by the saved one, or by that of another file.
    Load(Option<PathBuf>),
    /// Forget everything.
    Reset,
    /// Pause (`true`) or go on.
    Pause(bool),
}

/// Sends requests to a session.
#[derive(Clone, Debug)]
pub struct Requests(SyncSender<PendingRequest>);

/// A request, and where its answer goes: what was done, or the error.
pub(crate) type PendingRequest = (LiveRequest, SyncSender<Result<String, String>>);

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
        self.0.try_send((request, answer)).map_err(|_| "the session is busy or has ended".to_owned())?;
        answered.recv_timeout(timeout).unwrap_or_else(|_| Err("the session has not answered in time".to_owned()))
    }
}
