//! Connections: accepted, checked, and answered or turned into viewers, each on a thread of its own.

use crate::counts::count;
use crate::foxglove_viewer::FoxgloveViewer;
use crate::hub::Shared;
use crate::page_viewer::PageViewer;
use crate::request::{BadRequest, Request, Upgrade, read_request};
use crate::response;
use crate::slots::lock;
use crate::timed_stream::TimedStream;
use std::collections::BTreeMap;
use std::io::{self, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::{Duration, Instant};
use tungstenite::protocol::{Role, WebSocketConfig};
use tungstenite::{Message, WebSocket};

/// Connections in addition to the viewers: requests for the page.
const MORE_CONNECTIONS: usize = 32;
/// Interval between looks for new connections.
const ACCEPT_INTERVAL: Duration = Duration::from_millis(20);
/// A viewer is looked after at least this often.
const ATTEND_INTERVAL: Duration = Duration::from_millis(20);
/// Maximum size of a viewer's message, bytes. Subscriptions are the longest.
const MAX_MESSAGE: usize = 64 << 10;
/// Messages of a viewer that are read before it is sent something again.
const MAX_MESSAGES: usize = 32;
const READ_BUFFER: usize = 4 << 10;

/// The open connections.
#[derive(Debug, Default)]
pub(crate) struct Connections {
    open: Mutex<BTreeMap<u64, TcpStream>>,
}

impl Connections {
    /// Ends all connections, and waits for their threads, at most for this long.
    pub(crate) fn end(&self, time: Duration) {
        let deadline = Instant::now() + time;
        loop {
            let open = lock(&self.open);
            if open.is_empty() || Instant::now() > deadline {
                return;
            }
            for tcp in open.values() {
                // It may have ended by itself.
                let _ = tcp.shutdown(Shutdown::Both);
            }
            drop(open);
            thread::sleep(Duration::from_millis(2));
        }
    }
}

/// Accepts connections until the server stops.
pub(crate) fn accept(listener: &TcpListener, shared: &Arc<Shared>, connections: &Arc<Connections>) {
    let mut number = 0;
    while !shared.is_stopping() {
        match listener.accept() {
            Ok((tcp, _)) => {
                number += 1;
                count(&shared.counters.connections);
                if let Err(error) = start(tcp, number, shared, connections) {
                    count(&shared.counters.refused);
                    tracing::debug!("a viewer was refused: {error}");
                }
            }
            Err(_) => thread::sleep(ACCEPT_INTERVAL),
        }
    }
}

/// Starts the thread of a connection.
fn start(tcp: TcpStream, number: u64, shared: &Arc<Shared>, connections: &Arc<Connections>) -> io::Result<()> {
    let copy = tcp.try_clone()?;
    {
        let mut open = lock(&connections.open);
        if open.len() >= shared.limits.viewers + MORE_CONNECTIONS {
            return Err(io::Error::other("too many connections"));
        }
        open.insert(number, copy);
    }
    let (thread_shared, thread_connections) = (Arc::clone(shared), Arc::clone(connections));
    let answer = move || {
        if let Err(error) = handle(tcp, &thread_shared) {
            tracing::debug!("a viewer's connection ended: {error}");
        }
        lock(&thread_connections.open).remove(&number);
    };
    let started = thread::Builder::new().name("splatseg-viewer".to_owned()).spawn(answer);
    if started.is_err() {
        lock(&connections.open).remove(&number);
    }
    started.map(drop)
}

/// Answers one request.
fn handle(tcp: TcpStream, shared: &Shared) -> io::Result<()> {
    let mut stream = TimedStream::new(tcp, shared.limits.request_time)?;
    let request = match read_request(&mut stream) {
        Ok(request) => request,
        Err(problem) => {
            if problem != BadRequest::Nothing {
                count(&shared.counters.bad_requests);
            }
            return reply(stream, shared, &response::bad_request(problem));
        }
    };
    if let Err(refusal) = request.check(shared) {
        count(&shared.counters.refused);
        return reply(stream, shared, &response::refusal(refusal));
    }
    let Request { path, upgrade, rest, .. } = request;
    match upgrade {
        None => reply(stream, shared, &response::file(&path, shared)),
        Some(upgrade) => watch(stream, shared, &upgrade, rest),
    }
}

fn reply(mut stream: TimedStream, shared: &Shared, bytes: &[u8]) -> io::Result<()> {
    stream.allow(shared.limits.request_time);
    stream.write_all(bytes)?;
    stream.end();
    Ok(())
}

/// Turns a connection into a viewer.
fn watch(mut stream: TimedStream, shared: &Shared, upgrade: &Upgrade, rest: Vec<u8>) -> io::Result<()> {
    let viewer: Option<Box<dyn Viewer + '_>> = if upgrade.subprotocol.is_some() {
        FoxgloveViewer::join(shared).map(|viewer| Box::new(viewer) as Box<dyn Viewer + '_>)
    } else {
        PageViewer::join(shared).map(|viewer| Box::new(viewer) as Box<dyn Viewer + '_>)
    };
    let Some(mut viewer) = viewer else {
        count(&shared.counters.refused);
        return reply(stream, shared, &response::too_many_viewers());
    };
    stream.allow(shared.limits.request_time);
    stream.write_all(&response::switch(upgrade))?;
    let config = WebSocketConfig::default()
        .read_buffer_size(READ_BUFFER)
        .write_buffer_size(0)
        .max_message_size(Some(MAX_MESSAGE))
        .max_frame_size(Some(MAX_MESSAGE));
    let mut socket = WebSocket::from_partially_read(stream, rest, Role::Server, Some(config));
    let ended = attend(&mut socket, shared, &mut *viewer);
    match &ended {
        Err(tungstenite::Error::Io(error)) if error.kind() == io::ErrorKind::TimedOut => {
            count(&shared.counters.viewers_dropped);
        }
        Err(tungstenite::Error::Protocol(tungstenite::error::ProtocolError::ResetWithoutClosingHandshake)) => {}
        Err(tungstenite::Error::Protocol(_) | tungstenite::Error::Capacity(_) | tungstenite::Error::Utf8(_)) => {
            count(&shared.counters.bad_messages)
        }
        Ok(()) | Err(_) => {}
    }
    if let Err(error) = ended {
        tracing::debug!("a viewer left: {error}");
    }
    Ok(())
}

/// A viewer of a websocket. It leaves when dropped.
pub(crate) trait Viewer {
    /// Returns the next message, if the viewer can take one.
    fn next(&mut self) -> Option<Message>;

    /// Waits for a message, at most for this long.
    fn wait(&mut self, time: Duration);

    /// Processes the viewer's message. Returns false if it violates the protocol.
    fn receive(&mut self, message: &Message) -> bool;

    /// True if the viewer owes an answer. It is disconnected if it owes one for too long.
    fn owes_answer(&self) -> bool;
}

/// Sends and receives until the viewer leaves or the server stops.
fn attend(
    socket: &mut WebSocket<TimedStream>,
    shared: &Shared,
    viewer: &mut dyn Viewer,
) -> Result<(), tungstenite::Error> {
    let mut heard = Instant::now();
    while !shared.is_stopping() {
        let owed = viewer.owes_answer();
        if let Some(message) = viewer.next() {
            if !owed {
                // The time for an answer begins now.
                heard = Instant::now();
            }
            socket.get_mut().allow(shared.limits.viewer_time);
            socket.send(message)?;
        } else {
            viewer.wait(ATTEND_INTERVAL);
        }
        socket.get_mut().set_polling(true)?;
        for _ in 0..MAX_MESSAGES {
            match socket.read() {
                // Answered by the library. They do not count as a sign of life, since nobody needs to read the answer.
                Ok(Message::Ping(_) | Message::Close(_)) => {}
                Ok(message) => {
                    heard = Instant::now();
                    if !viewer.receive(&message) {
                        count(&shared.counters.bad_messages);
                    }
                }
                Err(tungstenite::Error::Io(error)) if error.kind() == io::ErrorKind::WouldBlock => break,
                Err(tungstenite::Error::ConnectionClosed) => return Ok(()),
                Err(error) => return Err(error),
            }
        }
        socket.get_mut().set_polling(false)?;
        if viewer.owes_answer() && heard.elapsed() > shared.limits.viewer_time {
            return Err(io::Error::from(io::ErrorKind::TimedOut).into());
        }
    }
    // A farewell; the connection ends anyway.
    socket.get_mut().allow(ATTEND_INTERVAL);
    let _ = socket.close(None);
    let _ = socket.flush();
    Ok(())
}
