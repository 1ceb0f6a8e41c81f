//! The loop of a session: the newest frame, its result, what is due besides.

use crate::latest_times::LatestTimes;
use crate::places::LivePlaces;
use crate::requests::PendingRequest;
use crate::results::{Results, send};
use crate::saved_map::objects;
use crate::words::LiveWords;
use crate::{
    LiveError, LiveFrame, LiveRequest, LiveStatus, LiveStream, Outlet, Output, Requests, SaveStatus, SavedMap,
};
use splatseg::pipeline::{FrameResult, LateFrame, LoadedNetworks, MergeObjectsError, PipelineError, WaitingFrames};
use splatseg::{Pipeline, Settings};
use splatseg_dataset::{StreamedFrame, UndecodedFrame};
use splatseg_geometry::{CameraFrame, Image, Intrinsics, SegmentId};
use splatseg_objects::{FrameStamp, Object, ObjectCounts, ObjectList, SeenObjects};
use splatseg_ros::{Detection3dArray, Header, Time, to_cdr};
use std::path::Path;
use std::sync::Arc;
use std::sync::mpsc::Receiver;
use std::time::{Duration, Instant};

/// Longest time without looking at requests and signals.
const WAIT: Duration = Duration::from_millis(100);
/// Requests that are answered between two frames at most, so that viewers who ask all the time do not stop the frames.
const MAX_REQUESTS: usize = 8;
const SECOND: Duration = Duration::from_secs(1);
/// Earlier stamps are not since 1970 but from a simulation or a device: objects were seen when the image was received.
const EPOCH_TIMES: Duration = Duration::from_secs(1_000_000_000);

/// How often a session publishes and saves.
#[derive(Clone, Debug, PartialEq)]
pub struct LiveOptions {
    /// Interval between messages with all objects.
    pub objects_interval: Duration,
    /// Interval between messages with the map's points.
    pub points_interval: Duration,
    /// Shortest interval between plans of the map: free space, rooms and relations.
    pub plan_interval: Duration,
    /// Interval between states.
    pub status_interval: Duration,
    /// Where the map is saved, if it is.
    pub saved_map: Option<SavedMap>,
    /// Interval between saves.
    pub save_interval: Duration,
    /// Delay of ids, overlays and the page, measured in stamps. Each frame is decided again with the frames after it before it
    /// is published. At most [`Self::MAX_LAG`], as delayed frames are kept in memory.
    pub lag: Duration,
}

impl LiveOptions {
    /// The largest lag.
    pub const MAX_LAG: Duration = Duration::from_secs(10);
}

impl Default for LiveOptions {
    fn default() -> Self {
        Self {
            objects_interval: Duration::from_millis(500),
            points_interval: Duration::from_secs(2),
            plan_interval: Duration::from_secs(5),
            status_interval: SECOND,
            saved_map: None,
            save_interval: Duration::from_secs(30),
            lag: Duration::ZERO,
        }
    }
}

/// Makes a pipeline, with a saved map if a path is given.
pub type BuildPipeline = Box<dyn FnMut(Option<&Path>) -> Result<Pipeline, PipelineError> + Send>;

/// Makes pipelines with these settings, which share their networks.
pub fn build_with(settings: Settings) -> BuildPipeline {
    let networks = Arc::new(LoadedNetworks::default());
    Box::new(move |map| {
        let mut builder = Pipeline::builder(&settings).networks(&networks);
        if let Some(map) = map {
            builder = builder.saved_memory(map);
        }
        builder.build()
    })
}

/// A pipeline whose namer, if it has a slow one, works beside the frames.
fn started(mut pipeline: Pipeline) -> Pipeline {
    if let Err(error) = pipeline.name_beside_frames() {
        tracing::warn!("objects are named at the end only: {error}");
    }
    pipeline
}

/// A pipeline on a stream.
pub struct LiveSession {
    pipeline: Pipeline,
    build: BuildPipeline,
    stream: Arc<LiveStream>,
    outlet: Box<dyn Outlet>,
    options: LiveOptions,
    results: Results,
    seen: SeenObjects,
    places: LivePlaces,
    /// With a lag: the frames whose results are not published yet.
    waiting: WaitingFrames<PublishedFrame>,
    /// When the latest frame was done.
    latest_frame: Instant,
    /// Since when the session waits for a frame.
    waiting_since: Instant,
    /// Images of a frame: colour, and depth if the camera has it.
    images_per_frame: u64,
    /// Objects have other names, or are merged, unlike in the saved map.
    has_new_names: bool,
    /// The same, unlike in the messages with all objects.
    has_unpublished_names: bool,
    /// Counts the changes of the map.
    map_version: usize,
    status: LiveStatus,
    times: LatestTimes,
    latest_stamp: Duration,
    due: Due,
    requests: (Requests, Receiver<PendingRequest>),
}

/// Stamp, size and camera of a frame, which are published with its result.
#[derive(Debug)]
struct PublishedFrame {
    stamp: Duration,
    file_stamp: FrameStamp,
    /// When the frame was received.
    received: Duration,
    /// Width and height.
    size: (usize, usize),
    intrinsics: Intrinsics,
}

/// When things were last done.
struct Due {
    objects: Instant,
    points: Instant,
    status: Instant,
    saved: Instant,
    /// Frames with a result at the last save.
    saved_frames: usize,
}

impl LiveSession {
    /// Creates a session. `build` makes its pipeline, now with the map `load`, and again when a request needs a new one.
    ///
    /// # Errors
    /// As `build`.
    pub fn new(
        mut build: BuildPipeline,
        load: Option<&Path>,
        (stream, mut outlet): (Arc<LiveStream>, Box<dyn Outlet>),
        options: LiveOptions,
    ) -> Result<Self, PipelineError> {
        let now = Instant::now();
        let pipeline = started(build(load)?);
        let requests = Requests::channel();
        outlet.accept(&requests.0);
        let places = LivePlaces::new(options.plan_interval);
        let saving = options.saved_map.as_ref().map(|_| SaveStatus::default());
        Ok(Self {
            pipeline,
            build,
            stream,
            outlet,
            options,
            results: Results::default(),
            seen: SeenObjects::default(),
            places,
            waiting: WaitingFrames::default(),
            latest_frame: now,
            waiting_since: now,
            images_per_frame: 1,
            has_new_names: false,
            has_unpublished_names: false,
            map_version: 0,
            status: LiveStatus { saving, ..LiveStatus::default() },
            times: LatestTimes::default(),
            latest_stamp: Duration::ZERO,
            due: Due { objects: now, points: now, status: now, saved: now, saved_frames: 0 },
            requests,
        })
    }

    /// Returns a sender of requests, for other threads.
    pub fn requests(&self) -> Requests {
        self.requests.0.clone()
    }

    /// Refuses the requests that wait, and those that come later: nobody answers them any more. Whoever waits for an answer
    /// learns it at once.
    pub fn close_requests(&mut self) {
        self.requests.1 = Requests::channel().1;
    }

    /// The state after the latest frame.
    pub fn status(&self) -> &LiveStatus {
        &self.status
    }

    /// Times of the latest frames.
    pub fn latest_times(&self) -> &LatestTimes {
        &self.times
    }

    /// The pipeline.
    pub fn pipeline(&self) -> &Pipeline {
        &self.pipeline
    }

    /// The pipeline, e.g. to name its objects between two calls of [`Self::run`].
    pub fn pipeline_mut(&mut self) -> &mut Pipeline {
        &mut self.pipeline
    }

    /// Processes frames until the stream ends or `is_stopped` returns true, which is called between frames and ten times a
    /// second. Then the map is saved, and everything is published once more.
    ///
    /// # Errors
    /// If the method fails, or the map cannot be saved at the end. A save in between that fails is in the status until one
    /// works ([`LiveStatus::saving`]).
    pub fn run(&mut self, is_stopped: &mut dyn FnMut() -> bool) -> Result<(), LiveError> {
        let ended = self.process(is_stopped).and_then(|()| self.publish_waiting(|_| true));
        // What was published is saved.
        self.pipeline.keep_verdicts();
        // The frames have ended, so a namer may take its time. A map without new names is worth keeping, too.
        match self.pipeline.finish_names() {
            Ok(named) => self.has_new_names |= named > 0,
            Err(error) => tracing::warn!("the objects have no new names: {error}"),
        }
        self.finish_places();
        let saved = if self.has_unsaved() || self.has_lost_files() { self.save() } else { Ok(()) };
        self.publish_all();
        match (ended, saved) {
            (Err(ended), Err(saved)) => Err(LiveError::Unsaved { ended: Box::new(ended), saved: Box::new(saved) }),
            (ended, saved) => ended.and(saved),
        }
    }

    fn process(&mut self, is_stopped: &mut dyn FnMut() -> bool) -> Result<(), LiveError> {
        let mut has_more_requests = false;
        while !is_stopped() {
            // Asked before: the last frames of a stream that ends while the session waits come with the next look.
            let is_over = self.stream.is_over();
            match self.stream.wait(if has_more_requests { Duration::ZERO } else { WAIT }) {
                Some(frame) => {
                    if self.status.is_paused {
                        self.status.paused_frames += 1;
                    } else {
                        self.use_frame(frame)?;
                        // Not before: a frame may take longer than the lag.
                        self.latest_frame = Instant::now();
                    }
                    self.waiting_since = Instant::now();
                }
                None if is_over => break,
                None if self.status.frames + self.status.skipped == 0 => self.status.problem = self.stream.undecided(),
                // That a frame could not be used is the problem until one can.
                None => {}
            }
            self.status.silence = if self.stream.is_played() { Duration::ZERO } else { self.waiting_since.elapsed() };
            if !self.stream.is_played() && self.latest_frame.elapsed() > self.options.lag + SECOND {
                // The camera has stopped: nothing more will be known about them soon, and there is time for names. A recording
                // that is played without drops only comes slowly.
                self.publish_waiting(|_| true)?;
                self.has_new_names |= self.pipeline.name_while_idle();
            }
            has_more_requests = self.answer_requests(is_stopped);
            self.do_what_is_due();
        }
        // A name given at the last moment is saved, too.
        self.answer_requests(&mut || false);
        Ok(())
    }

    /// Processes a frame. One that cannot be used becomes the problem in the status.
    fn use_frame(&mut self, frame: UndecodedFrame) -> Result<(), LiveError> {
        let (received, started) = (frame.received(), Instant::now());
        self.images_per_frame = (frame.images().count() as u64).max(1);
        let streamed = match frame.read() {
            Ok(streamed) => streamed,
            Err(error) => {
                // Frames of a stream are named by their number, and the reason may begin with it.
                let reason = error.source.to_string();
                let reason = reason.strip_prefix(&format!("{}: ", error.name)).unwrap_or(&reason);
                self.skip(format!("frame {} cannot be used: {reason}", error.index));
                return Ok(());
            }
        };
        let StreamedFrame { frame, world_from_camera, .. } = streamed;
        let since_1970 = frame.timestamp().filter(|stamp| *stamp >= EPOCH_TIMES);
        self.pipeline.set_seen_at(since_1970.unwrap_or(received));
        let place = PublishedFrame {
            stamp: frame.timestamp().unwrap_or(received),
            received,
            file_stamp: FrameStamp {
                number: self.status.frames,
                name: Some(frame.name().to_owned()),
                file: None,
                time_s: Some(frame.timestamp().unwrap_or(received).as_secs_f64()),
            },
            size: (frame.width(), frame.height()),
            intrinsics: *frame.intrinsics(),
        };
        let is_shown = self.outlet.is_watched() || self.outlet.wants(Output::Overlay);
        let kept = (is_shown || !self.options.lag.is_zero()).then(|| frame.clone());
        let result = match world_from_camera {
            Some(pose) => self.pipeline.step(&frame.at(pose)),
            None => self.pipeline.step_unposed(frame),
        };
        match result {
            Ok(result) => {
                self.seen.remap(&result.remapped);
                // Also with a lag: states and numbers of frames in the list do not wait for hindsight either.
                self.seen.record(&place.file_stamp, place.size, &result.objects);
                self.record(&result, received, started);
                self.latest_stamp = place.stamp;
                if let Some(frames) = self.stream.coordinate_frames() {
                    self.results.set_frames(frames);
                }
                self.results.publish_pose(place.stamp, &result, self.outlet.as_mut());
                self.publish_or_wait(kept, place, result)
            }
            Err(error @ (PipelineError::Segmenter { .. } | PipelineError::Pose { .. })) => {
                self.skip(error.to_string());
                Ok(())
            }
            Err(error) => Err(error.into()),
        }
    }

    /// Publishes a result, or lets it wait and publishes those that have waited long enough.
    fn publish_or_wait(
        &mut self,
        frame: Option<CameraFrame<'static>>,
        place: PublishedFrame,
        result: FrameResult,
    ) -> Result<(), LiveError> {
        let (lag, stamp) = (self.options.lag.min(LiveOptions::MAX_LAG), place.stamp);
        match frame {
            Some(frame) if !lag.is_zero() => {
                let pose = result.pose.world_from_camera;
                self.waiting.add(frame.at(pose), result, place);
                // A clock that was set back must not keep frames for ever.
                self.publish_waiting(|waited| stamp < waited || stamp - waited >= lag)
            }
            frame => {
                self.publish(frame.as_ref().map(|frame| frame.color()), &place, &result);
                Ok(())
            }
        }
    }

    /// Decides the waiting frames again for whose stamps `is_due` returns true, and publishes them.
    fn publish_waiting(&mut self, is_due: impl Fn(Duration) -> bool) -> Result<(), LiveError> {
        while let Some(LateFrame { frame, result, belongings }) =
            self.waiting.next_due(&mut self.pipeline, |place, _| is_due(place.stamp))?
        {
            self.publish(Some(frame.color()), &belongings, &result);
        }
        Ok(())
    }

    /// Publishes the result of a frame. `color` may be left out if nobody watches.
    fn publish(&mut self, color: Option<&Image<[u8; 3]>>, place: &PublishedFrame, result: &FrameResult) {
        let is_shown = self.outlet.is_watched() || self.outlet.wants(Output::Overlay);
        let frame = LiveFrame {
            number: place.file_stamp.number,
            name: place.file_stamp.name.as_deref().unwrap_or_default(),
            stamp: place.stamp,
            color: color.filter(|_| is_shown),
            intrinsics: place.intrinsics,
            result,
            pipeline: &self.pipeline,
            status: &self.status,
            delay: self.stream.time_since(place.received),
        };
        self.outlet.show_frame(&frame);
        self.results.publish_frame(&frame, self.outlet.as_mut());
    }

    fn skip(&mut self, problem: String) {
        self.status.skipped += 1;
        self.status.problem = Some(problem);
    }

    fn record(&mut self, result: &FrameResult, received: Duration, started: Instant) {
        let status = &mut self.status;
        status.frames += 1;
        status.problem = None;
        status.visible_objects = result.objects.len();
        status.pose = Some(result.pose.state);
        status.doubts.extend(result.doubts.iter().map(|doubt| doubt.text.clone()));
        status.frame_time = started.elapsed();
        status.age = self.stream.time_since(received);
        self.times.record(status.frame_time, status.age);
        self.map_version += 1;
        self.count_messages();
    }

    fn count_messages(&mut self) {
        let counts = self.stream.counts();
        // Each image without a partner is the end of a frame; the others belong to whole ones.
        let alone = counts.dropped.unpaired;
        self.status.dropped_frames = alone + (counts.dropped.total() - alone).div_ceil(self.images_per_frame);
        self.status.counts = counts;
        self.status.recording_problem = self.stream.recording_problem();
    }

    fn do_what_is_due(&mut self) {
        let passed = |before: Instant, interval: Duration| before.elapsed() >= interval;
        let has_frames = self.status.frames > 0;
        if passed(self.due.objects, self.options.objects_interval) {
            self.publish_objects();
        }
        if let Some(map) = self.pipeline.map().filter(|_| self.outlet.is_watched()) {
            self.outlet.show_map(&map, self.pipeline.up(), self.map_version);
        }
        if has_frames && passed(self.due.points, self.options.points_interval) {
            self.due.points = Instant::now();
            self.results.publish_points(&self.pipeline, self.latest_stamp, self.outlet.as_mut());
        }
        self.step_places();
        if passed(self.due.status, self.options.status_interval) {
            self.show_status();
        }
        if self.has_unsaved() && passed(self.due.saved, self.options.save_interval) {
            // What is wrong is in the status.
            let _ = self.save();
        }
    }

    fn publish_all(&mut self) {
        self.publish_objects();
        // Its ids may have been settled since the latest frame.
        self.map_version += 1;
        if let Some(map) = self.pipeline.map().filter(|_| self.outlet.is_watched()) {
            self.outlet.show_last_map(&map, self.pipeline.up(), self.map_version);
        }
        if self.status.frames > 0 {
            self.results.publish_points(&self.pipeline, self.latest_stamp, self.outlet.as_mut());
        }
        self.show_status();
    }

    /// Publishes all objects: as messages once there are frames, and on the page.
    fn publish_objects(&mut self) {
        self.due.objects = Instant::now();
        self.has_unpublished_names = false;
        let is_published = self.outlet.wants(Output::Objects) || self.outlet.wants(Output::Markers);
        let (is_published, is_watched) = (is_published && self.status.frames > 0, self.outlet.is_watched());
        if !is_published && !is_watched {
            return;
        }
        let list = self.objects();
        if is_watched {
            self.outlet.show_objects(&list, self.status.frames);
        }
        if is_published {
            self.results.publish_objects(&list, self.latest_stamp, self.outlet.as_mut());
        }
    }

    /// True if somebody gets the plan of the map: on a topic, on the page, or with the saved objects.
    fn wants_places(&self) -> bool {
        let is_wanted = [Output::Map, Output::SceneGraph].into_iter().any(|output| self.outlet.wants(output));
        is_wanted || self.outlet.is_watched() || self.options.saved_map.is_some()
    }

    /// Begins a plan of the map if one is due, and publishes one that has been made since. A recording that is played
    /// without drops gives the same results whatever the time that they take, so that its plan is made at the end.
    fn step_places(&mut self) {
        let is_wanted = !self.stream.is_played() && self.wants_places();
        if self.places.step(&mut self.pipeline, is_wanted) {
            self.publish_places();
        }
    }

    /// Makes the plan of the map at the end of the frames.
    fn finish_places(&mut self) {
        if self.status.frames > 0 && self.wants_places() && self.places.finish(&mut self.pipeline) {
            self.publish_places();
        }
    }

    /// Publishes the latest plan, or takes back the one before if there is none any more.
    fn publish_places(&mut self) {
        let of_map = (&self.pipeline, &self.seen);
        match self.places.latest() {
            Some(places) => self.results.publish_places(of_map, places, self.latest_stamp, self.outlet.as_mut()),
            None => self.results.withdraw_places(of_map, self.latest_stamp, self.outlet.as_mut()),
        }
    }

    fn show_status(&mut self) {
        self.due.status = Instant::now();
        self.status.places = self.places.summary().map(str::to_owned);
        self.status.rate_hz = self.times.since(SECOND) as f32;
        self.count_messages();
        self.status.gaussians = self.pipeline.map().map_or(0, |map| map.gaussian_count());
        self.status.objects = ObjectCounts::new(self.pipeline.objects(), self.pipeline.map()).objects;
        if self.outlet.wants(Output::Diagnostics) {
            let now = i64::try_from(self.outlet.clock().unwrap_or_else(LiveStream::now).as_nanos()).unwrap_or(i64::MAX);
            let header = Header { stamp: Time::from_nanoseconds(now), frame_id: String::new() };
            send(self.outlet.as_mut(), Output::Diagnostics, to_cdr(&self.status.diagnostics(header)));
        }
        self.outlet.show(&self.status);
    }

    /// True if there is a file for the map, and frames or names that it does not contain.
    fn has_unsaved(&self) -> bool {
        let has_news = self.status.frames > self.due.saved_frames || self.has_new_names;
        self.options.saved_map.is_some() && has_news
    }

    /// True if somebody has removed what was saved.
    fn has_lost_files(&self) -> bool {
        self.due.saved_frames > 0 && self.options.saved_map.as_ref().is_some_and(|files| !files.exists())
    }

    fn save(&mut self) -> Result<(), LiveError> {
        let files = self.options.saved_map.as_ref().ok_or(LiveError::NoFile)?;
        let saved = files.save(&self.pipeline, &self.seen, self.places.latest());
        // From the end of it: a slow disk must not take all of the time.
        self.due.saved = Instant::now();
        let status = self.status.saving.get_or_insert_default();
        status.problem = saved.as_ref().err().map(ToString::to_string);
        if saved.is_ok() {
            status.saved_frames = Some(self.status.frames);
            self.due.saved_frames = self.status.frames;
            self.has_new_names = false;
        }
        saved
    }

    /// Answers requests that wait, until `is_stopped` returns true or as many as may come between two frames are answered.
    /// Returns true if there may be more.
    fn answer_requests(&mut self, is_stopped: &mut dyn FnMut() -> bool) -> bool {
        let mut answered = 0;
        while answered < MAX_REQUESTS && (answered == 0 || !is_stopped()) {
            let Ok(pending) = self.requests.1.try_recv() else { break };
            answered += 1;
            match pending {
                PendingRequest::Execute(request, answer) => {
                    let done = self.execute(request).map_err(|error| error.to_string());
                    // Whoever has asked may have stopped waiting.
                    let _ = answer.try_send(done);
                }
                PendingRequest::Look(look) => look(self),
            }
        }
        // Once for all of them.
        if self.has_unpublished_names {
            self.publish_objects();
        }
        answered == MAX_REQUESTS
    }

    fn execute(&mut self, request: LiveRequest) -> Result<String, LiveError> {
        match request {
            LiveRequest::Save => {
                self.save()?;
                let path = self.options.saved_map.as_ref().map(|files| files.map().display().to_string());
                Ok(format!("saved {} to {}", self.objects().counts(), path.unwrap_or_default()))
            }
            LiveRequest::Load(path) => {
                let saved = self.options.saved_map.as_ref().map(|files| files.map().to_owned());
                let path = path.or(saved).ok_or(LiveError::NoFile)?;
                self.replace_map(Some(&path))?;
                Ok(format!("loaded {}", path.display()))
            }
            LiveRequest::Reset => {
                self.replace_map(None)?;
                Ok("forgot everything".to_owned())
            }
            LiveRequest::Name(id, label) => {
                self.name(id, label.as_deref()).map_err(LiveError::Name)?;
                Ok(format!("object {id} is {}", label.as_deref().unwrap_or("without a label")))
            }
            LiveRequest::Merge(ids) => {
                let into = self.merge(&ids)?;
                Ok(format!("{} objects are {into}", ids.len()))
            }
            LiveRequest::Detail(detail) => {
                self.pipeline.detail().ok_or(LiveError::NoDetail)?;
                self.pipeline.set_detail(detail);
                Ok(format!("later frames are segmented with the detail {}", detail.name()))
            }
            LiveRequest::Pause(is_paused) => {
                self.status.is_paused = is_paused;
                Ok(if is_paused { "paused" } else { "running" }.to_owned())
            }
        }
    }

    /// Starts again with another map, or an empty one. If it cannot be loaded, the present one stays.
    fn replace_map(&mut self, path: Option<&Path>) -> Result<(), LiveError> {
        let detail = self.pipeline.detail();
        self.pipeline = started((self.build)(path)?);
        // What a viewer has chosen stays.
        if let Some(detail) = detail {
            self.pipeline.set_detail(detail);
        }
        self.status.doubts.clear();
        // The names were those of the map of before.
        self.has_new_names = false;
        self.seen = SeenObjects::default();
        self.places.forget();
        self.publish_places();
        self.waiting = WaitingFrames::default();
        self.map_version += 1;
        self.outlet.reset();
        Ok(())
    }

    /// Returns the objects so far, as in `objects.json`.
    pub fn objects(&self) -> ObjectList {
        objects(&self.pipeline, &self.seen, self.places.latest())
    }

    /// Returns what is needed to find objects by words, on another thread: comparing them with a text takes longer than a
    /// frame may wait.
    pub fn words(&self) -> LiveWords {
        LiveWords {
            objects: self.objects(),
            names: self.pipeline.names().clone(),
            network: self.pipeline.names_network(),
            stamp: self.latest_stamp,
            world: self.results.world().to_owned(),
        }
    }

    /// Gives an object the label of a person, or takes its label away. It is shown and saved like those of a network.
    ///
    /// # Errors
    /// A sentence: there is no such object, or the label cannot be used.
    pub fn name_by_hand(&mut self, id: SegmentId, label: Option<&str>) -> Result<(), String> {
        self.name(id, label)?;
        self.publish_objects();
        Ok(())
    }

    fn name(&mut self, id: SegmentId, label: Option<&str>) -> Result<(), String> {
        let is_known = self.pipeline.objects().records().contains_key(&id)
            || self.pipeline.map().is_some_and(|map| map.is_carried(id));
        if !is_known {
            return Err(format!("there is no object {id}"));
        }
        self.pipeline.name_by_hand(id, label).map_err(|error| error.to_string())?;
        (self.has_new_names, self.has_unpublished_names) = (true, true);
        Ok(())
    }

    /// Makes objects of the map one, as a person says, and returns its id. It is shown and saved, and cannot be taken back.
    ///
    /// # Errors
    /// [`MergeObjectsError`]; then nothing has changed.
    pub fn merge_objects(&mut self, ids: &[SegmentId]) -> Result<SegmentId, MergeObjectsError> {
        let into = self.merge(ids)?;
        self.publish_objects();
        Ok(into)
    }

    fn merge(&mut self, ids: &[SegmentId]) -> Result<SegmentId, MergeObjectsError> {
        let remapped = self.pipeline.merge_objects(ids)?;
        self.seen.remap(&remapped);
        self.waiting.remap(&remapped);
        self.outlet.merge(&remapped);
        self.places.outdate();
        (self.has_new_names, self.has_unpublished_names) = (true, true);
        self.map_version += 1;
        Ok(remapped.first().map_or(0, |ids| ids.into))
    }

    /// Returns the chosen objects, as in the messages of [`Output::Objects`].
    pub fn detections(&self, is_chosen: impl Fn(&Object) -> bool) -> Detection3dArray {
        let list = self.objects();
        self.results.detections(self.latest_stamp, list.all().filter(|object| is_chosen(object)))
    }
}
