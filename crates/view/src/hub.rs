//! State shared by the caller, the encoder and the viewers of the page.

use crate::camera_path::CameraPath;
use crate::counts::{Counters, count};
use crate::foxglove::MessageHub;
use crate::page_messages::{self, Hello};
use crate::slots::{PageMessage, PageSlot, lock};
use crate::{AnswerViewer, Token, ViewFrame, ViewLimits, ViewObject};
use glam::{DVec3, Vec3};
use splatseg_geometry::{MapView, Pose, UpEstimate};
use splatseg_output::{MapData, map_data};
use splatseg_places::FloorPlan;
use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, OnceLock, PoisonError};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};
use tungstenite::Message;

/// The rate of frames is measured over this time.
const RATE_TIME: Duration = Duration::from_secs(5);
/// Coordinates sent as 32-bit floats are relative to an origin on a grid of this spacing, metres, unless the run begins
/// closer than [`MAX_DISTANCE`] to the world's own.
const GRID: f64 = 16.0;
const MAX_DISTANCE: f64 = 128.0;
/// Maps are made in at most this part of the caller's time.
const MAX_MAP_SHARE: u32 = 50;

/// Answers viewers.
pub(crate) struct Answer(pub(crate) AnswerViewer);

impl std::fmt::Debug for Answer {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.write_str("Answer")
    }
}

/// Everything that threads share.
#[derive(Debug)]
pub(crate) struct Shared {
    pub(crate) token: Token,
    pub(crate) scene: String,
    /// Tells viewers after a reconnection whether the server is the same. Pages have the number of the run besides.
    pub(crate) session: String,
    pub(crate) host_names: Vec<String>,
    pub(crate) limits: ViewLimits,
    pub(crate) counters: Counters,
    pub(crate) pages: PageHub,
    pub(crate) messages: MessageHub,
    /// Answers viewers, if the program does.
    pub(crate) answer: OnceLock<Answer>,
    stopping: AtomicBool,
}

impl Shared {
    pub(crate) fn new(token: Token, scene: String, host_names: Vec<String>, limits: ViewLimits) -> Self {
        Self {
            token,
            scene,
            session: SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_nanos().to_string(),
            host_names,
            limits,
            counters: Counters::default(),
            pages: PageHub::default(),
            messages: MessageHub::default(),
            answer: OnceLock::new(),
            stopping: AtomicBool::new(false),
        }
    }

    pub(crate) fn is_stopping(&self) -> bool {
        self.stopping.load(Ordering::Relaxed)
    }

    pub(crate) fn stop(&self) {
        self.stopping.store(true, Ordering::Relaxed);
        // The encoder looks at the flag with the lock held, so it is now either waiting or will see it.
        drop(lock(&self.pages.state));
        self.pages.work.notify_all();
    }

    pub(crate) fn viewers(&self) -> usize {
        self.pages.viewers() + self.messages.viewers()
    }
}

/// A frame with the pose of its camera, `None` if that is lost.
#[derive(Debug)]
pub(crate) struct PlacedFrame {
    /// Its place among all frames, also those that nobody watched.
    pub(crate) index: usize,
    pub(crate) frame: ViewFrame,
    pub(crate) world_from_camera: Option<Pose>,
}

/// A list of objects.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct ListedObjects {
    pub(crate) objects: Vec<ViewObject>,
    /// Number of frames until then.
    pub(crate) frames: usize,
}

/// Work for the encoder.
#[derive(Debug)]
pub(crate) enum Work {
    Frame(Box<PlacedFrame>),
    /// A map, and where up is in the world.
    Map(Box<MapData>, Vec3),
    Objects(ListedObjects),
    /// The plan of the map, `None` if it has none any more.
    Plan(Option<Box<FloorPlan>>),
    /// Nothing new for a while.
    Idle,
    /// Nothing more will come: what was held back is to be sent, then [`PageHub::set_finished`] called.
    Last,
    Stop,
}

/// The newest results, and the slots of the viewers.
#[derive(Debug, Default)]
pub(crate) struct PageHub {
    state: Mutex<State>,
    work: Condvar,
    finished: Condvar,
}

#[derive(Debug, Default)]
struct State {
    viewers: Vec<Arc<PageSlot>>,
    frame: Option<Box<PlacedFrame>>,
    /// The map, and where up is in the world, if the caller knows.
    map: Option<(Box<MapData>, Option<Vec3>)>,
    /// The list of objects that nobody has been sent; it waits for a viewer.
    objects: Option<ListedObjects>,
    /// The plan that nobody has been sent; it waits for a viewer.
    plan: Option<Option<Box<FloorPlan>>>,
    /// The latest message of each kind, for viewers that come later.
    latest: [Option<Message>; PageMessage::COUNT],
    path: CameraPath,
    up: UpEstimate,
    origin: Option<DVec3>,
    published: VecDeque<Instant>,
    next_map: Option<Instant>,
    notes: Vec<String>,
    end: End,
    run: RunNumber,
}

/// Number of a run of the server, from 0: see [`PageHub::restart`]. Messages of an earlier run are not sent.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct RunNumber(u64);

/// How far the end of a server is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum End {
    /// Results may come.
    #[default]
    Open,
    /// No more will come.
    Awaited,
    /// All have been given to the viewers.
    Finished,
}

impl State {
    fn origin_near(&mut self, place: DVec3) -> DVec3 {
        let near =
            || if place.abs().max_element() <= MAX_DISTANCE { DVec3::ZERO } else { (place / GRID).round() * GRID };
        *self.origin.get_or_insert_with(near)
    }

    /// Frames per second over the last seconds.
    fn rate(&self) -> f32 {
        let (Some(first), Some(last)) = (self.published.front(), self.published.back()) else { return 0.0 };
        if last.elapsed() > RATE_TIME {
            return 0.0;
        }
        let seconds = (*last - *first).as_secs_f32();
        if seconds > 0.0 { (self.published.len() - 1) as f32 / seconds } else { 0.0 }
    }

    /// The first message for viewers.
    fn hello(&self, hello: Hello<'_>) -> Message {
        page_messages::hello(hello, self.run.0, self.origin.unwrap_or_default(), &self.path)
    }

    fn take_work(&mut self) -> Work {
        if let Some(frame) = self.frame.take() {
            return Work::Frame(frame);
        }
        if let Some((map, up)) = self.map.take() {
            return Work::Map(map, up.unwrap_or_else(|| self.up.direction()));
        }
        if !self.viewers.is_empty() {
            if let Some(objects) = self.objects.take() {
                return Work::Objects(objects);
            }
            if let Some(plan) = self.plan.take() {
                return Work::Plan(plan);
            }
        }
        if self.end == End::Awaited { Work::Last } else { Work::Idle }
    }

    fn has_work(&self) -> bool {
        self.frame.is_some()
            || self.map.is_some()
            || ((self.plan.is_some() || self.objects.is_some()) && !self.viewers.is_empty())
            || self.end == End::Awaited
    }
}

impl PageHub {
    pub(crate) fn viewers(&self) -> usize {
        lock(&self.state).viewers.len()
    }

    /// Records a frame's pose and time. Returns the frame's index if somebody watches.
    pub(crate) fn record(&self, world_from_camera: Option<&Pose>) -> Option<usize> {
        let now = Instant::now();
        let mut state = lock(&self.state);
        if let Some(pose) = world_from_camera {
            state.up.add(pose);
            state.origin_near(pose.translation());
        }
        let index = state.path.frames();
        state.path.add(world_from_camera.map(Pose::translation));
        state.published.push_back(now);
        while state.published.front().is_some_and(|time| now - *time > RATE_TIME) {
            state.published.pop_front();
        }
        if state.viewers.is_empty() {
            // Nobody gets a picture of this frame, and an earlier one is not the newest any more.
            state.frame = None;
            state.latest[PageMessage::Frame as usize] = None;
            return None;
        }
        Some(index)
    }

    /// Puts a frame in the encoder's slot.
    pub(crate) fn put_frame(&self, frame: PlacedFrame, counters: &Counters) {
        let old = lock(&self.state).frame.replace(Box::new(frame));
        self.work.notify_one();
        if old.is_some() {
            count(&counters.frames_skipped);
        }
    }

    /// Starts a new run: forgets all results, and gives the viewers `hello` of the next run, by which they start again, too.
    pub(crate) fn restart(&self, hello: Hello<'_>) {
        let mut state = lock(&self.state);
        let (viewers, notes, end, run) =
            (std::mem::take(&mut state.viewers), std::mem::take(&mut state.notes), state.end, state.run);
        let old = std::mem::replace(
            &mut *state,
            State { viewers, notes, end, run: RunNumber(run.0 + 1), ..State::default() },
        );
        for viewer in &state.viewers {
            viewer.clear();
            viewer.put(PageMessage::Hello, state.hello(hello));
        }
        drop(state);
        drop(old);
    }

    /// True if somebody watches.
    pub(crate) fn is_watched(&self) -> bool {
        self.viewers() > 0
    }

    /// True if somebody watches and a map is due.
    pub(crate) fn wants_map(&self) -> bool {
        let state = lock(&self.state);
        !state.viewers.is_empty() && state.next_map.is_none_or(|time| Instant::now() >= time)
    }

    /// Makes the map and puts it in the encoder's slot. Without `up`, the cameras of the frames so far tell where up is.
    pub(crate) fn put_map(&self, map: &MapView<'_>, up: Option<Vec3>, interval: Duration) {
        let start = Instant::now();
        let origin = lock(&self.state).origin_near(map.origin);
        let data = Box::new(map_data(map, origin, |_| true));
        let pause = interval.max(start.elapsed() * MAX_MAP_SHARE);
        let old = {
            let mut state = lock(&self.state);
            state.next_map = Some(start + pause);
            state.map.replace((data, up))
        };
        self.work.notify_one();
        drop(old);
    }

    /// Puts a list of objects in the encoder's slot.
    pub(crate) fn put_objects(&self, objects: ListedObjects) {
        let old = lock(&self.state).objects.replace(objects);
        self.work.notify_one();
        drop(old);
    }

    /// Puts a plan in the encoder's slot.
    pub(crate) fn put_plan(&self, plan: Option<FloorPlan>) {
        let old = lock(&self.state).plan.replace(plan.map(Box::new));
        self.work.notify_one();
        drop(old);
    }

    /// Waits until everything that was put here has been given to the viewers, at most for this long.
    pub(crate) fn finish(&self, time: Duration) {
        let mut state = lock(&self.state);
        state.end = End::Awaited;
        self.work.notify_one();
        let waited = self.finished.wait_timeout_while(state, time, |state| state.end == End::Awaited);
        drop(waited.unwrap_or_else(PoisonError::into_inner));
    }

    /// Says that everything has been given to the viewers.
    pub(crate) fn set_finished(&self) {
        lock(&self.state).end = End::Finished;
        self.finished.notify_all();
    }

    /// Waits for work, at most for this long. Returns it with the run that it belongs to.
    pub(crate) fn next_work(&self, time: Duration, is_stopping: impl Fn() -> bool) -> (Work, RunNumber) {
        let nothing = |state: &mut State| !is_stopping() && !state.has_work();
        let waited = self.work.wait_timeout_while(lock(&self.state), time, nothing);
        let (mut state, _) = waited.unwrap_or_else(PoisonError::into_inner);
        let work = if is_stopping() { Work::Stop } else { state.take_work() };
        (work, state.run)
    }

    /// Sets what the page says besides the lines of the latest frame.
    pub(crate) fn set_notes(&self, notes: Vec<String>) {
        lock(&self.state).notes = notes;
    }

    pub(crate) fn notes(&self) -> Vec<String> {
        lock(&self.state).notes.clone()
    }

    /// Origin of coordinates, and frames per second.
    pub(crate) fn origin_and_rate(&self) -> (DVec3, f32) {
        let state = lock(&self.state);
        (state.origin.unwrap_or_default(), state.rate())
    }

    /// Gives a message to all viewers, also to those that come later. One of an earlier run is not sent.
    pub(crate) fn send(&self, run: RunNumber, kind: PageMessage, message: &Message, counters: &Counters) {
        let mut state = lock(&self.state);
        if state.run != run {
            return;
        }
        // A frame that was encoded for viewers who have left meanwhile may not be the newest.
        let is_kept = kind != PageMessage::Frame || !state.viewers.is_empty();
        if let Some(latest) = state.latest.get_mut(kind as usize).filter(|_| is_kept) {
            *latest = Some(message.clone());
        }
        for viewer in &state.viewers {
            if viewer.put(kind, message.clone()) && kind == PageMessage::Frame {
                count(&counters.frames_dropped);
            }
        }
    }

    /// Adds a viewer with everything it has missed. `None` if there are too many.
    pub(crate) fn join(&self, hello: Hello<'_>, max: usize) -> Option<Arc<PageSlot>> {
        let mut state = lock(&self.state);
        if state.viewers.len() >= max {
            return None;
        }
        let slot = Arc::new(PageSlot::default());
        slot.put(PageMessage::Hello, state.hello(hello));
        for kind in [PageMessage::Objects, PageMessage::Frame, PageMessage::Map, PageMessage::Plan] {
            if let Some(Some(message)) = state.latest.get(kind as usize) {
                slot.put(kind, message.clone());
            }
        }
        state.viewers.push(Arc::clone(&slot));
        drop(state);
        self.work.notify_one();
        Some(slot)
    }

    /// Removes a viewer.
    pub(crate) fn leave(&self, slot: &Arc<PageSlot>) {
        lock(&self.state).viewers.retain(|viewer| !Arc::ptr_eq(viewer, slot));
    }
}
