//! A gate that is closed while a frame is processed, for threads that work beside the frames.

use crate::parts::Pacer;
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::time::Duration;

/// Longest wait before one step: with frames that leave no time between them, work goes on slowly rather than never.
const MAX_WAIT: Duration = Duration::from_millis(25);

/// The gate. Nothing else is locked while it is waited for, and no wait is longer than [`MAX_WAIT`].
#[derive(Debug)]
pub(super) struct FrameGate {
    /// Number of guards that keep it closed.
    closed: Mutex<usize>,
    opened: Condvar,
    max_wait: Duration,
}

impl Default for FrameGate {
    fn default() -> Self {
        Self { closed: Mutex::new(0), opened: Condvar::new(), max_wait: MAX_WAIT }
    }
}

impl FrameGate {
    /// Closes the gate until the guard is dropped.
    pub(super) fn close(gate: &Arc<Self>) -> ClosedGate {
        *gate.closed.lock().unwrap_or_else(PoisonError::into_inner) += 1;
        ClosedGate(Arc::clone(gate))
    }
}

impl Pacer for FrameGate {
    fn before_step(&self) {
        let closed = self.closed.lock().unwrap_or_else(PoisonError::into_inner);
        // What comes back is the number of guards, which does not matter any more.
        drop(self.opened.wait_timeout_while(closed, self.max_wait, |closed| *closed > 0));
    }
}

/// Keeps a gate closed.
#[derive(Debug)]
pub(super) struct ClosedGate(Arc<FrameGate>);

impl Drop for ClosedGate {
    fn drop(&mut self) {
        *self.0.closed.lock().unwrap_or_else(PoisonError::into_inner) -= 1;
        self.0.opened.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::mpsc::{RecvTimeoutError, channel};
    use std::time::Instant;

    #[test]
    fn steps_wait_for_the_last_guard() {
        let gate = Arc::new(FrameGate { max_wait: Duration::from_secs(3600), ..FrameGate::default() });
        gate.before_step();
        let (first, second) = (FrameGate::close(&gate), FrameGate::close(&gate));
        let (send, received) = channel();
        let waiting = Arc::clone(&gate);
        let thread = std::thread::spawn(move || {
            waiting.before_step();
            send.send(Instant::now()).unwrap();
        });
        drop(first);
        assert_eq!(received.recv_timeout(Duration::from_millis(20)), Err(RecvTimeoutError::Timeout));
        let opened = Instant::now();
        drop(second);
        assert!(received.recv().unwrap() >= opened);
        thread.join().unwrap();
    }

    #[test]
    fn a_gate_that_stays_closed_lets_steps_through_now_and_then() {
        let gate = Arc::new(FrameGate::default());
        let _closed = FrameGate::close(&gate);
        let started = Instant::now();
        (0..2).for_each(|_| gate.before_step());
        assert!(started.elapsed() >= 2 * MAX_WAIT);
    }

    #[test]
    fn a_panic_in_a_frame_opens_the_gate() {
        let gate = Arc::new(FrameGate::default());
        let inner = Arc::clone(&gate);
        let panicked = std::thread::spawn(move || {
            let _closed = FrameGate::close(&inner);
            panic!("a frame fails");
        });
        assert!(panicked.join().is_err());
        assert_eq!(*gate.closed.lock().unwrap(), 0);
    }
}
