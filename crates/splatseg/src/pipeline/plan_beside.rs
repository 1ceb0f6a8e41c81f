//! The plan of a map beside the frames, which do not wait for it.
//!
//! A thread of the lowest priority makes one plan at a time, from the map as it was when it began, and takes a small share of
//! a core. What came in between is in the next plan. On the thread of the frames, only the copy of the map is made.

use super::background::{busy_time, lower_priority};
use super::{MapPlaces, Pipeline};
use splatseg_geometry::KeyframeId;
use splatseg_odometry::{KeyframePlace, PoseSourceError};
use splatseg_places::PlanSettings;
use std::collections::BTreeMap;
use std::io;
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::time::{Duration, Instant};

/// Rest after each second of work, seconds: the thread takes at most a tenth of a core.
const REST: u32 = 9;
/// Without new keyframes, a plan is made anew after this many intervals with frames: things may have moved.
const WITHOUT_NEWS: u32 = 6;

/// A finished plan.
type MadePlaces = Result<MapPlaces, PoseSourceError>;

/// A finished plan, and the time that it took.
type Made = (MadePlaces, Duration);

/// Makes plans of a pipeline's map.
pub struct PlanBeside {
    settings: PlanSettings,
    /// Shortest time from the start of a plan to that of the next.
    interval: Duration,
    pool: rayon::ThreadPool,
    work: Option<Receiver<Made>>,
    /// When the latest plan was begun, and the frames and keyframes that it was made of.
    begun: Option<Instant>,
    frames: usize,
    keyframes: BTreeMap<KeyframeId, KeyframePlace>,
    /// When the next may be begun.
    next: Instant,
}

impl PlanBeside {
    /// Starts the thread. Plans are begun at least `interval` apart.
    ///
    /// # Errors
    /// If the system allows no more threads.
    pub fn start(settings: PlanSettings, interval: Duration) -> io::Result<Self> {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(1)
            .thread_name(|_| "splatseg-plan".to_owned())
            .start_handler(|_| lower_priority())
            // Without a handler, a panic ends the program. The pipeline is told that there is no plan.
            .panic_handler(|_| {})
            .build()
            .map_err(io::Error::other)?;
        let (frames, keyframes) = (0, BTreeMap::new());
        Ok(Self { settings, interval, pool, work: None, begun: None, frames, keyframes, next: Instant::now() })
    }

    /// Returns the plan that was finished since the last call, if any, and begins the next one if it is time and `is_wanted`:
    /// when keyframes were added or corrected, and otherwise after six intervals with frames. The pipeline gets the
    /// numbers of the rooms. To be called between two frames, always with the same pipeline.
    pub fn step(&mut self, pipeline: &mut Pipeline, is_wanted: bool) -> Option<Result<MapPlaces, PoseSourceError>> {
        let made = self.finished(false).map(|made| self.with_rooms(pipeline, made));
        if is_wanted && self.work.is_none() && Instant::now() >= self.next && self.has_news(pipeline) {
            self.begin(pipeline);
        }
        made
    }

    /// Notes that the map has changed without a frame, e.g. by objects that were merged by hand: the latest plan, and one under
    /// way, are of the map before.
    pub fn outdate(&mut self) {
        (self.begun, self.frames) = (None, 0);
    }

    /// The plan of the map as it is now, made by the caller's threads after those under way; `None` if there was nothing new
    /// since the latest one.
    pub fn last(&mut self, pipeline: &mut Pipeline) -> Option<Result<MapPlaces, PoseSourceError>> {
        let made = self.finished(true).map(|made| self.with_rooms(pipeline, made));
        if pipeline.objects().frames() == self.frames && self.begun.is_some() {
            return made;
        }
        self.note_begin(pipeline);
        let Some(input) = pipeline.plan_input() else { return made };
        Some(self.with_rooms(pipeline, input.places(self.settings)))
    }

    fn has_news(&self, pipeline: &Pipeline) -> bool {
        let frames = pipeline.objects().frames();
        let is_old = self.begun.is_none_or(|begun| begun.elapsed() >= WITHOUT_NEWS * self.interval);
        frames > self.frames && (is_old || pipeline.keyframes() != self.keyframes)
    }

    fn note_begin(&mut self, pipeline: &Pipeline) {
        let now = Instant::now();
        (self.begun, self.next) = (Some(now), now + self.interval);
        (self.frames, self.keyframes) = (pipeline.objects().frames(), pipeline.keyframes());
    }

    fn begin(&mut self, pipeline: &Pipeline) {
        self.note_begin(pipeline);
        let Some(input) = pipeline.plan_input() else { return };
        let (send, receive) = channel();
        let settings = self.settings;
        self.pool.spawn(move || {
            let started = busy_time();
            let places = input.places(settings);
            // The pipeline may be gone.
            let _ = send.send((places, busy_time().saturating_sub(started)));
        });
        self.work = Some(receive);
    }

    fn finished(&mut self, wait: bool) -> Option<MadePlaces> {
        let work = self.work.as_ref()?;
        let made = if wait { work.recv().map_err(|_| TryRecvError::Disconnected) } else { work.try_recv() };
        match made {
            Ok((places, busy)) => {
                self.work = None;
                self.next = self.next.max(Instant::now() + REST * busy);
                Some(places)
            }
            Err(TryRecvError::Empty) => None,
            Err(TryRecvError::Disconnected) => {
                self.work = None;
                None
            }
        }
    }

    /// Gives the pipeline the rooms of the latest plan that was begun.
    fn with_rooms(&self, pipeline: &mut Pipeline, made: MadePlaces) -> MadePlaces {
        if let Ok(places) = &made {
            pipeline.set_rooms_of_plan(places.rooms.clone(), &self.keyframes);
        }
        made
    }
}
