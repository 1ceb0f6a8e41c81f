//! A connection whose reads and writes end at a deadline.

use std::io::{self, Read, Write};
use std::net::{Shutdown, TcpStream};
use std::time::{Duration, Instant};

/// Shortest time-out passed to the system, which refuses zero.
const MIN_WAIT: Duration = Duration::from_millis(1);

/// A TCP connection. Every read and write fails with [`io::ErrorKind::TimedOut`] once the deadline has passed, however
/// many bytes trickle in or out. While polling, reads return [`io::ErrorKind::WouldBlock`] if nothing has arrived.
#[derive(Debug)]
pub(crate) struct TimedStream {
    tcp: TcpStream,
    deadline: Instant,
    is_polling: bool,
    /// True if a write was not possible while polling.
    is_blocked: bool,
}

impl TimedStream {
    pub(crate) fn new(tcp: TcpStream, time: Duration) -> io::Result<Self> {
        // Accepted sockets inherit the listener's mode on some systems.
        tcp.set_nonblocking(false)?;
        // A frame should leave at once.
        tcp.set_nodelay(true)?;
        Ok(Self { tcp, deadline: Instant::now() + time, is_polling: false, is_blocked: false })
    }

    /// Sets the deadline.
    pub(crate) fn allow(&mut self, time: Duration) {
        self.deadline = Instant::now() + time;
    }

    /// Starts or ends polling.
    pub(crate) fn set_polling(&mut self, wanted: bool) -> io::Result<()> {
        self.is_polling = wanted;
        self.tcp.set_nonblocking(wanted)
    }

    /// Returns true if a write was not possible while polling, since the last call.
    pub(crate) fn take_blocked(&mut self) -> bool {
        std::mem::take(&mut self.is_blocked)
    }

    /// Ends the connection so that what was written last still arrives: closing with unread bytes would discard it.
    pub(crate) fn end(mut self) {
        let mut rest = [0; 4096];
        if self.tcp.shutdown(Shutdown::Write).is_ok() {
            while self.read(&mut rest).is_ok_and(|count| count > 0) {}
        }
    }

    fn time_left(&self) -> io::Result<Duration> {
        let left = self.deadline.saturating_duration_since(Instant::now());
        if left.is_zero() { Err(io::ErrorKind::TimedOut.into()) } else { Ok(left.max(MIN_WAIT)) }
    }
}

/// A time-out is `WouldBlock` on some systems and `TimedOut` on others.
fn as_time_out(error: io::Error) -> io::Error {
    if error.kind() == io::ErrorKind::WouldBlock { io::ErrorKind::TimedOut.into() } else { error }
}

impl Read for TimedStream {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        if self.is_polling {
            return self.tcp.read(bytes);
        }
        self.tcp.set_read_timeout(Some(self.time_left()?))?;
        self.tcp.read(bytes).map_err(as_time_out)
    }
}

impl Write for TimedStream {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if self.is_polling {
            let written = self.tcp.write(bytes);
            self.is_blocked |= written.as_ref().is_err_and(|error| error.kind() == io::ErrorKind::WouldBlock);
            return written;
        }
        self.tcp.set_write_timeout(Some(self.time_left()?))?;
        self.tcp.write(bytes).map_err(as_time_out)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.tcp.flush()
    }
}
