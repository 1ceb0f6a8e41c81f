//! The stream's messages, fed by threads that receive them.

use crate::recorder::Recorder;
use splatseg_dataset::{
    CoordinateFrames, DatasetError, DatasetSettings, FrameMatcher, MatchCounts, MatchLimits, UndecodedFrame,
};
use splatseg_output::StreamRecordingError;
use std::io;
use std::path::Path;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant, SystemTime};

/// Longest time between two looks at the clock while waiting for a frame: poses may be waited for no longer.
const CLOCK_CHECK: Duration = Duration::from_millis(20);

/// Number of complete frames that may wait in a stream without drops.
const WITHOUT_DROPS: usize = 1024;

/// A [`FrameMatcher`] that several threads share: some feed it, one takes frames.
pub struct LiveStream {
    state: Mutex<State>,
    clock: Clock,
    has_news: Condvar,
    has_room: Condvar,
}

/// The clock by which a stream waits for poses and partners of images.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Clock {
    /// The system clock: the newest frame wins.
    System,
    /// The times of the messages: no frame is dropped, and whoever feeds them waits.
    Messages,
}

struct State {
    matcher: FrameMatcher,
    recorder: Option<Recorder>,
    is_over: bool,
    /// Time of receipt of the latest message.
    received: Duration,
}

impl LiveStream {
    /// Creates a stream; see [`FrameMatcher`] for how topics are chosen.
    ///
    /// # Errors
    /// If a setting is out of range.
    pub fn new(settings: &DatasetSettings, limits: MatchLimits) -> Result<Self, DatasetError> {
        Ok(Self::with_clock(FrameMatcher::new(settings, limits)?, Clock::System))
    }

    /// Creates a stream in which no complete frame is dropped: [`Self::feed_at`] waits until the frames so far are taken.
    /// Frames wait for poses by the times of the messages, so the same messages give the same frames. Nothing is dropped
    /// either if a clock is set back.
    ///
    /// # Errors
    /// If a setting is out of range.
    pub fn without_drops(settings: &DatasetSettings) -> Result<Self, DatasetError> {
        let limits = MatchLimits { complete: WITHOUT_DROPS, ..MatchLimits::default() };
        Ok(Self::with_clock(FrameMatcher::new(settings, limits)?.keeping_frames(), Clock::Messages))
    }

    fn with_clock(matcher: FrameMatcher, clock: Clock) -> Self {
        let state = Mutex::new(State { matcher, recorder: None, is_over: false, received: Duration::ZERO });
        Self { state, clock, has_news: Condvar::new(), has_room: Condvar::new() }
    }

    /// Records what is used from now on: the images of the frames that are taken, and all poses and calibrations. A session
    /// that is fed with them without drops uses the same frames. The file appears at `path` only after
    /// [`Self::finish_recording`], or when it cannot be written any more, e.g. because the disk is full: then it has the
    /// messages before, and [`Self::recording_problem`] says so.
    ///
    /// # Errors
    /// If no file can be written there.
    pub fn record(&self, path: &Path) -> io::Result<()> {
        let recorder = Recorder::create(path)?;
        self.lock().recorder = Some(recorder);
        Ok(())
    }

    /// Ends the recording, if there is one.
    ///
    /// # Errors
    /// If not all messages could be written. The error says what is in the file.
    pub fn finish_recording(&self) -> Result<(), StreamRecordingError> {
        let recorder = self.lock().recorder.take();
        recorder.map_or(Ok(()), Recorder::finish)
    }

    /// Returns why the recording has ended before the stream, in a sentence; `None` if it goes on, or there is none.
    pub fn recording_problem(&self) -> Option<String> {
        self.lock().recorder.as_ref().and_then(Recorder::problem)
    }

    /// Returns the time since the Unix epoch.
    pub fn now() -> Duration {
        SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default()
    }

    /// Takes in a message that has just been received: `data` in CDR, of type `type_name`, e.g. `sensor_msgs/msg/Image`.
    /// It is copied only if it is an image that may be used.
    pub fn feed(&self, topic: &str, type_name: &str, data: &[u8]) {
        self.feed_at((topic, type_name), data, Self::now());
    }

    /// As [`Self::feed`], with the topic, its type, and the time of receipt since the Unix epoch. Messages after the end
    /// of the stream are ignored.
    pub fn feed_at(&self, (topic, type_name): (&str, &str), data: &[u8], received: Duration) {
        let mut state = self.lock();
        if state.is_over {
            return;
        }
        let State { matcher, recorder, .. } = &mut *state;
        if let Some(recorder) = recorder.as_mut().filter(|_| matcher.wants(topic, type_name)) {
            recorder.receive((topic, type_name), data, received);
        }
        matcher.feed(topic, type_name, data, received);
        state.received = received;
        self.has_news.notify_one();
        while self.clock == Clock::Messages && state.matcher.complete_frames() > 0 && !state.is_over {
            state = self.has_room.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// Ends the stream: frames that are complete can still be taken, and no more will come.
    pub fn end(&self) {
        let mut state = self.lock();
        state.matcher.flush();
        state.is_over = true;
        self.has_news.notify_all();
        self.has_room.notify_all();
    }

    /// Waits for the next complete frame, for `timeout` at most.
    pub fn wait(&self, timeout: Duration) -> Option<UndecodedFrame> {
        let until = Instant::now() + timeout;
        let mut state = self.lock();
        loop {
            let now = if self.clock == Clock::System { Self::now() } else { state.received };
            if let Some(frame) = state.matcher.take(now) {
                if let Some(recorder) = &mut state.recorder {
                    recorder.use_frame(&frame);
                }
                self.has_room.notify_all();
                return Some(frame);
            }
            let left = until.saturating_duration_since(Instant::now());
            if state.is_over || left.is_zero() {
                return None;
            }
            let waited = self.has_news.wait_timeout(state, left.min(CLOCK_CHECK));
            state = waited.unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    /// Returns the time since a message was received, as given to [`Self::feed_at`]. Zero if the times of messages are the
    /// clock.
    pub fn time_since(&self, received: Duration) -> Duration {
        if self.clock == Clock::System { Self::now().saturating_sub(received) } else { Duration::ZERO }
    }

    /// Returns true if a recording is played without drops: the times of its messages are the clock.
    pub fn is_played(&self) -> bool {
        self.clock == Clock::Messages
    }

    /// Returns true if the stream has ended. Frames may be left: there are none if it had ended before [`Self::wait`]
    /// returned `None`.
    pub fn is_over(&self) -> bool {
        self.lock().is_over
    }

    /// Returns what has become of the messages so far.
    pub fn counts(&self) -> MatchCounts {
        self.lock().matcher.counts()
    }

    /// Returns true if messages of a topic may be used; see [`FrameMatcher::wants`].
    pub fn wants(&self, topic: &str, type_name: &str) -> bool {
        self.lock().matcher.wants(topic, type_name)
    }

    /// Returns the topics used, one line each; empty until they are chosen.
    pub fn sources(&self) -> Vec<String> {
        self.lock().matcher.sources().to_vec()
    }

    /// Returns why no topics are chosen yet; `None` once they are, and before the first attempt.
    pub fn undecided(&self) -> Option<String> {
        self.lock().matcher.undecided().map(ToString::to_string)
    }

    /// Returns the names of the coordinate frames; `None` until topics are chosen.
    pub fn coordinate_frames(&self) -> Option<CoordinateFrames> {
        self.lock().matcher.coordinate_frames().cloned()
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
