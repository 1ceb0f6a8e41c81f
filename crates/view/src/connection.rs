//! Connections: accepted, checked, and answered or turned into viewers, each on a thread of its own.
//!
//! Connections that have not shown the token have a pool of their own: if it is full, a new one takes the place of the
//! oldest. So nobody without the token keeps out those with one, who show it at once.

use crate::counts::count;
use crate::foxglove_viewer::FoxgloveViewer;
use crate::hub::Shared;
use crate::page_viewer::PageViewer;
use crate::request::{BadRequest, Request, Upgrade, read_request};
use crate::response;
use crate::slots::lock;
use crate::timed_stream::TimedStream;
use std::collections::BTreeMap;
use std::hash::{BuildHasher, Hasher, RandomState};
use std::io::{self, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::{Duration, Instant};
use tungstenite::protocol::frame::coding::CloseCode;
use tungstenite::protocol::{CloseFrame, Role, WebSocketConfig};
use tungstenite::{Bytes, Message, WebSocket};

/// Connections in addition to the viewers that have shown the token: requests for the page.
const MORE_CONNECTIONS: usize = 32;
/// Connections that have not shown the token.
const MAX_STRANGERS: usize = 64;
/// The same, with those that were ended and whose threads are about to notice.
const MAX_ENDING_STRANGERS: usize = 2 * MAX_STRANGERS;
/// Pause after a connection that could not be accepted, e.g. since too many files are open.
const RETRY_INTERVAL: Duration = Duration::from_millis(20);
/// A viewer is looked after at least this often.
const ATTEND_INTERVAL: Duration = Duration::from_millis(20);
/// Time to send a viewer what waits for it when the server stops, and for the viewer to leave. A browser on a busy
/// computer needs seconds for a large map.
const FAREWELL_TIME: Duration = Duration::from_secs(5);
/// Maximum size of a viewer's message, bytes. Subscriptions are the longest.
const MAX_MESSAGE: usize = 64 << 10;
/// Messages of a viewer that are read before it is sent something again.
const MAX_MESSAGES: usize = 32;
const READ_BUFFER: usize = 4 << 10;
/// Number of pings in the time in which a viewer must answer one.
const PINGS: u32 = 3;

/// The open connections.
#[derive(Debug, Default)]
pub(crate) struct Connections {
    /// By number, in the order of their coming.
    open: Mutex<BTreeMap<u64, Open>>,
}

/// An open connection.
#[derive(Debug)]
struct Open {
    tcp: TcpStream,
    stage: Stage,
}

/// State of a connection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    /// It has not shown the token.
    Stranger,
    /// It had to make room for another one before it had shown the token.
    Ended,
    /// It has shown the token.
    Known,
}

impl Connections {
    /// Adds a connection. Too many without the token cost the oldest of them its place. Returns true if so.
    fn add(&self, number: u64, tcp: TcpStream) -> io::Result<bool> {
        let mut open = lock(&self.open);
        let strangers = open.values().filter(|other| other.stage != Stage::Known).count();
        if strangers >= MAX_ENDING_STRANGERS {
            return Err(io::Error::other("too many connections without the token"));
        }
        let waiting = open.values().filter(|other| other.stage == Stage::Stranger).count();
        let mut oldest = open.values_mut().find(|other| other.stage == Stage::Stranger && waiting >= MAX_STRANGERS);
        if let Some(oldest) = &mut oldest {
            oldest.stage = Stage::Ended;
            // It may have ended by itself.
            let _ = oldest.tcp.shutdown(Shutdown::Both);
        }
        let has_ended_one = oldest.is_some();
        open.insert(number, Open { tcp, stage: Stage::Stranger });
        Ok(has_ended_one)
    }

    /// Records that a connection has shown the token. Returns false if there are `most` of these already.
    fn admit(&self, number: u64, most: usize) -> bool {
        let mut open = lock(&self.open);
        let has_room = open.values().filter(|other| other.stage == Stage::Known).count() < most;
        if let (true, Some(connection)) = (has_room, open.get_mut(&number)) {
            connection.stage = Stage::Known;
        }
        has_room
    }

    fn remove(&self, number: u64) {
        lock(&self.open).remove(&number);
    }

    /// Waits until the connections that have shown the token have ended by themselves, at most for this long.
    pub(crate) fn wait_for_viewers(&self, time: Duration) {
        let deadline = Instant::now() + time;
        while lock(&self.open).values().any(|open| open.stage == Stage::Known) && Instant::now() < deadline {
            thread::sleep(Duration::from_millis(2));
        }
    }

    /// Ends all connections, and waits for their threads, at most for this long.
    pub(crate) fn end(&self, time: Duration) {
        let deadline = Instant::now() + time;
        loop {
            let open = lock(&self.open);
            if open.is_empty() || Instant::now() > deadline {
                return;
            }
            for connection in open.values() {
                // It may have ended by itself.
                let _ = connection.tcp.shutdown(Shutdown::Both);
            }
            drop(open);
            thread::sleep(Duration::from_millis(2));
        }
    }
}

/// Accepts connections until the server stops, which is noticed at the next connection.
pub(crate) fn accept(listener: &TcpListener, shared: &Arc<Shared>, connections: &Arc<Connections>) {
    let mut number = 0;
    while !shared.is_stopping() {
        match listener.accept() {
            Ok(_) if shared.is_stopping() => {}
            Ok((tcp, _)) => {
                number += 1;
                count(&shared.counters.connections);
                if let Err(error) = start(tcp, number, shared, connections) {
                    count(&shared.counters.refused);
                    tracing::debug!("a viewer was refused: {error}");
                }
            }
            Err(_) => thread::sleep(RETRY_INTERVAL),
        }
    }
}

/// Starts the thread of a connection.
fn start(tcp: TcpStream, number: u64, shared: &Arc<Shared>, connections: &Arc<Connections>) -> io::Result<()> {
    if connections.add(number, tcp.try_clone()?)? {
        count(&shared.counters.refused);
    }
    let (thread_shared, thread_connections) = (Arc::clone(shared), Arc::clone(connections));
    let answer = move || {
        if let Err(error) = handle(tcp, number, &thread_shared, &thread_connections) {
            tracing::debug!("a viewer's connection ended: {error}");
        }
        thread_connections.remove(number);
    };
    let started = thread::Builder::new().name("splatseg-viewer".to_owned()).spawn(answer);
    if started.is_err() {
        connections.remove(number);
    }
    started.map(drop)
}

/// Answers one request.
fn handle(tcp: TcpStream, number: u64, shared: &Shared, connections: &Connections) -> io::Result<()> {
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
    if !connections.admit(number, shared.limits.viewers + MORE_CONNECTIONS) {
        count(&shared.counters.refused);
        return reply(stream, shared, &response::too_many_viewers());
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

    /// Returns the next message when the server stops, whether or not the viewer has shown those before.
    fn remaining(&mut self) -> Option<Message>;

    /// Waits for a message, at most for this long.
    fn wait(&mut self, time: Duration);

    /// Processes the viewer's message. Returns false if it violates the protocol.
    fn receive(&mut self, message: &Message) -> bool;

    /// True if the viewer owes an answer. It is disconnected if it owes one for too long.
    fn owes_answer(&self) -> bool;
}

/// The proof that a viewer reads: it returns what is in a ping. Nothing else that it sends shows that.
struct SignOfLife {
    interval: Duration,
    next_ping: Instant,
    /// The content of the ping that is not answered yet, and its time.
    awaited: Option<(Bytes, Instant)>,
}

impl SignOfLife {
    fn new(time: Duration) -> Self {
        Self { interval: time / PINGS, next_ping: Instant::now(), awaited: None }
    }

    /// Returns a ping if it is time for one. Its content cannot be guessed.
    fn ping(&mut self) -> Option<Message> {
        let now = Instant::now();
        if self.awaited.is_some() || now < self.next_ping {
            return None;
        }
        let content = Bytes::copy_from_slice(&RandomState::new().build_hasher().finish().to_le_bytes());
        self.next_ping = now + self.interval;
        self.awaited = Some((content.clone(), now));
        Some(Message::Ping(content))
    }

    fn receive_pong(&mut self, content: &Bytes) {
        self.awaited.take_if(|(awaited, _)| awaited == content);
    }

    fn is_missing(&self, time: Duration) -> bool {
        self.awaited.as_ref().is_some_and(|(_, since)| since.elapsed() > time)
    }
}

/// Sends and receives until the viewer leaves or the server stops.
fn attend(
    socket: &mut WebSocket<TimedStream>,
    shared: &Shared,
    viewer: &mut dyn Viewer,
) -> Result<(), tungstenite::Error> {
    let time = shared.limits.viewer_time;
    let (mut heard, mut life) = (Instant::now(), SignOfLife::new(time));
    while !shared.is_stopping() {
        let owed = viewer.owes_answer();
        if let Some(message) = life.ping() {
            send(socket, message, time)?;
        } else if let Some(message) = viewer.next() {
            if !owed {
                // The time for an answer begins now.
                heard = Instant::now();
            }
            send(socket, message, time)?;
        } else {
            viewer.wait(ATTEND_INTERVAL);
        }
        socket.get_mut().set_polling(true)?;
        for _ in 0..MAX_MESSAGES {
            match socket.read() {
                // Answered by the library. They do not count as a sign of life, since nobody needs to read the answer.
                Ok(Message::Ping(_) | Message::Close(_)) => {}
                Ok(Message::Pong(content)) => life.receive_pong(&content),
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
        if socket.get_mut().take_blocked() {
            // The library keeps its answers to pings. Nothing more is read until they have left.
            socket.get_mut().allow(time);
            socket.flush()?;
        }
        if life.is_missing(time) || viewer.owes_answer() && heard.elapsed() > time {
            return Err(io::Error::from(io::ErrorKind::TimedOut).into());
        }
    }
    say_farewell(socket, viewer)
}

/// Sends what waits for a viewer and a farewell, by which it knows that nothing was lost. Then what it still sends is read
/// until it leaves: the system throws away what is on its way to a viewer if the connection is closed with unread bytes.
/// The connection ends anyway.
fn say_farewell(socket: &mut WebSocket<TimedStream>, viewer: &mut dyn Viewer) -> Result<(), tungstenite::Error> {
    socket.get_mut().allow(FAREWELL_TIME);
    while let Some(message) = viewer.remaining() {
        socket.send(message)?;
    }
    socket.close(Some(CloseFrame { code: CloseCode::Normal, reason: "the session has ended".into() }))?;
    socket.flush()?;
    while socket.read().is_ok() {}
    Ok(())
}

fn send(socket: &mut WebSocket<TimedStream>, message: Message, time: Duration) -> Result<(), tungstenite::Error> {
    socket.get_mut().allow(time);
    socket.send(message)
}
