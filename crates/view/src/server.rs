//! The server.

use crate::connection::{self, Connections};
use crate::encoder;
use crate::hub::{Answer, ListedObjects, PlacedFrame, Shared};
use crate::page_messages::Hello;
use crate::{
    AnswerViewer, Channel, ChannelId, Reach, Token, ViewCounts, ViewError, ViewFrame, ViewObject, ViewOptions,
};
use glam::Vec3;
use splatseg_geometry::{MapView, Pose};
use splatseg_places::FloorPlan;
use std::io;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

/// Time for viewers to be told that the server stops, and to leave: more than a connection waits for its viewer.
const FAREWELL_TIME: Duration = Duration::from_millis(5200);
/// The last results, which may include a large map, must be encoded in this time.
const FINISH_TIME: Duration = Duration::from_secs(2);
const END_TIME: Duration = Duration::from_millis(500);

/// A server for viewers of a run. It stops when dropped.
#[derive(Debug)]
pub struct ViewServer {
    shared: Arc<Shared>,
    connections: Arc<Connections>,
    address: SocketAddr,
    accepting: Option<JoinHandle<()>>,
    threads: Vec<JoinHandle<()>>,
}

impl ViewServer {
    /// Opens the port and starts the threads.
    ///
    /// # Errors
    /// [`ViewError`] if the port is in use, or if its address can be reached from other computers and
    /// [`ViewOptions::reach`] does not allow that.
    pub fn start(options: ViewOptions) -> Result<Self, ViewError> {
        let ViewOptions { address, reach, token, scene, host_names, limits } = options;
        if reach == Reach::Loopback && !address.ip().to_canonical().is_loopback() {
            return Err(ViewError::NotLoopback(address));
        }
        let token = token.map_or_else(Token::random, Ok)?;
        let listen = |source: io::Error| ViewError::Listen { address, source };
        let listener = TcpListener::bind(address).map_err(listen)?;
        let address = listener.local_addr().map_err(listen)?;
        let shared = Arc::new(Shared::new(token, scene, host_names, limits));
        let connections = Arc::new(Connections::default());
        let mut server = Self { shared, connections, address, accepting: None, threads: Vec::new() };
        let (shared, connections) = (Arc::clone(&server.shared), Arc::clone(&server.connections));
        let accept = move || connection::accept(&listener, &shared, &connections);
        server.accepting = Some(spawn("splatseg-accept", accept)?);
        let shared = Arc::clone(&server.shared);
        server.threads.push(spawn("splatseg-encode", move || encoder::run(&shared))?);
        Ok(server)
    }

    /// Ends the thread that waits for connections, by connecting to it.
    fn stop_accepting(&mut self) {
        let Some(accepting) = self.accepting.take() else { return };
        let deadline = Instant::now() + END_TIME;
        while !accepting.is_finished() && Instant::now() < deadline {
            // It may fail while other connections are accepted.
            let _ = TcpStream::connect_timeout(&self.shown_address(), END_TIME);
            thread::sleep(Duration::from_millis(1));
        }
        if accepting.is_finished() {
            self.threads.push(accepting);
        } else {
            tracing::error!("port {} stays open until the program ends: nothing connects to it", self.address.port());
        }
    }

    /// The address that the server listens on, with its port.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// The link for a browser, with the token. If the server listens on all addresses, it has the one of this computer.
    pub fn link(&self) -> String {
        format!("http://{}/?token={}", self.shown_address(), self.shared.token.as_str())
    }

    /// The link for Foxglove ("Open connection", "Foxglove WebSocket"), with the token.
    pub fn foxglove_link(&self) -> String {
        format!("ws://{}/?token={}", self.shown_address(), self.shared.token.as_str())
    }

    fn shown_address(&self) -> SocketAddr {
        let localhost: IpAddr = match self.address.ip() {
            IpAddr::V4(ip) if ip.is_unspecified() => Ipv4Addr::LOCALHOST.into(),
            IpAddr::V6(ip) if ip.is_unspecified() => Ipv6Addr::LOCALHOST.into(),
            // With the scope that a link-local address has.
            _ => return self.address,
        };
        SocketAddr::new(localhost, self.address.port())
    }

    /// Publishes a frame with the pose of its camera; `None` if that is lost. `frame` is called only if somebody watches
    /// the page; it returns `None` if there is no picture, as when somebody has come only now. The pose is always recorded, for
    /// the camera's path. Does not wait.
    pub fn publish_frame<F: Into<Option<ViewFrame>>>(
        &self,
        world_from_camera: Option<&Pose>,
        frame: impl FnOnce() -> F,
    ) {
        let Some(index) = self.shared.pages.record(world_from_camera) else { return };
        if let Some(frame) = frame().into() {
            let placed = PlacedFrame { index, frame, world_from_camera: world_from_camera.copied() };
            self.shared.pages.put_frame(placed, &self.shared.counters);
        }
    }

    /// Lets viewers of the page find objects by words and give them labels: `answer` is called on their threads, and may
    /// take seconds. Only the first call has an effect; pages opened before it cannot ask.
    pub fn answer_with(&self, answer: AnswerViewer) {
        let _ = self.shared.answer.set(Answer(answer));
    }

    /// Sets what the page says besides the lines of the latest frame, e.g. what is wrong. It comes within a second, also if
    /// there are no new frames.
    pub fn set_notes(&self, notes: Vec<String>) {
        self.shared.pages.set_notes(notes);
    }

    /// Publishes the list of all objects found so far, in `frames` frames. It comes to the page without a frame, too. The
    /// page keeps the latest list, also for viewers that come later. Does not wait.
    pub fn publish_objects(&self, objects: Vec<ViewObject>, frames: usize) {
        self.shared.pages.put_objects(ListedObjects { objects, frames });
    }

    /// Publishes the map if somebody watches the page and the last one is old enough
    /// ([`ViewLimits::map_interval`](crate::ViewLimits)). Returns true if so. `up` is the unit vector that points up in the
    /// world; without it, the poses of the frames so far tell, and z before the first one. Does not wait; making the map
    /// takes milliseconds.
    pub fn publish_map(&self, map: &MapView<'_>, up: Option<Vec3>) -> bool {
        let is_wanted = self.shared.pages.wants_map();
        if is_wanted {
            self.shared.pages.put_map(map, up, self.shared.limits.map_interval);
        }
        is_wanted
    }

    /// As [`Self::publish_map`], however old the last map is: this one will not change for a while.
    pub fn publish_last_map(&self, map: &MapView<'_>, up: Option<Vec3>) -> bool {
        let is_wanted = self.shared.pages.is_watched();
        if is_wanted {
            self.shared.pages.put_map(map, up, self.shared.limits.map_interval);
        }
        is_wanted
    }

    /// Starts again with a new run: frames, objects, map, plan and the camera's path so far are forgotten, and pages load
    /// again. Does not wait.
    pub fn restart(&self) {
        self.shared.pages.restart(Hello::of(&self.shared));
    }

    /// Publishes the plan of the map, or that it has none any more. The page keeps the latest one, also for viewers that come
    /// later. Does not wait.
    pub fn publish_plan(&self, plan: Option<&FloorPlan>) {
        self.shared.pages.put_plan(plan.cloned());
    }

    /// Adds a channel for Foxglove.
    pub fn add_channel(&self, channel: Channel) -> ChannelId {
        self.shared.messages.add_channel(channel)
    }

    /// True if somebody has subscribed to a channel. Otherwise its messages need not be made, though a message of a latched
    /// channel is kept for those who come later.
    pub fn wants_message(&self, channel: ChannelId) -> bool {
        self.shared.messages.wants(channel)
    }

    /// Publishes a message in CDR with its time in nanoseconds. Does not wait.
    pub fn publish_message(&self, channel: ChannelId, message: Vec<u8>, time: u64) {
        self.shared.messages.publish(channel, message.into(), time, &self.shared.counters);
    }

    /// Number of viewers.
    pub fn viewers(&self) -> usize {
        self.shared.viewers()
    }

    /// Counts since the start.
    pub fn counts(&self) -> ViewCounts {
        self.shared.counters.snapshot()
    }
}

fn spawn(name: &str, work: impl FnOnce() + Send + 'static) -> Result<JoinHandle<()>, ViewError> {
    thread::Builder::new().name(name.to_owned()).spawn(work).map_err(ViewError::Thread)
}

impl Drop for ViewServer {
    fn drop(&mut self) {
        // The last results of a session are what viewers go on looking at.
        self.shared.pages.finish(FINISH_TIME);
        self.shared.stop();
        self.stop_accepting();
        self.connections.wait_for_viewers(FAREWELL_TIME);
        self.connections.end(END_TIME);
        for thread in self.threads.drain(..) {
            if thread.join().is_err() {
                tracing::error!("a thread of the viewer panicked");
            }
        }
    }
}
