//! How long frames wait with a lag.

use crate::support::{feed, recording};
use splatseg::memory::SplatMemory;
use splatseg::tracking::{FastSamSplat, FastSamSplatSettings, FrameOutput, Method, TrackingError};
use splatseg::{Pipeline, Segmentation, Settings};
use splatseg_dataset::{DatasetSettings, MatchLimits, read_messages};
use splatseg_geometry::RgbdFrame;
use splatseg_live::{BuildPipeline, LiveFrame, LiveOptions, LiveSession, LiveStatus, LiveStream, Outlet, Output};
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// Longer than the time without frames after which a camera is taken to have stopped, with [`LAG`].
const LONG: Duration = Duration::from_millis(1400);
/// Shorter than the time between two frames of the recording.
const LAG: Duration = Duration::from_millis(1);

/// A method that takes long for its first frame.
struct SlowStart {
    method: FastSamSplat,
    has_started: bool,
}

impl Method for SlowStart {
    fn name(&self) -> &str {
        "slow-start"
    }

    fn process(&mut self, frame: &RgbdFrame, found: &Segmentation) -> Result<FrameOutput, TrackingError> {
        if !std::mem::replace(&mut self.has_started, true) {
            std::thread::sleep(LONG);
        }
        self.method.process(frame, found)
    }

    fn memory(&self) -> Option<&SplatMemory> {
        self.method.memory()
    }
}

/// The number of each frame that was shown, with the number of frames that had a result then.
type ShownFrames = Arc<Mutex<Vec<(usize, usize)>>>;

struct Viewer(ShownFrames);

impl Outlet for Viewer {
    fn wants(&self, _: Output) -> bool {
        false
    }

    fn publish(&mut self, _: Output, _: Vec<u8>) {}

    fn show(&mut self, _: &LiveStatus) {}

    fn show_frame(&mut self, frame: &LiveFrame<'_>) {
        self.0.lock().unwrap().push((frame.number, frame.status.frames));
    }
}

fn dataset() -> DatasetSettings {
    let mut dataset = DatasetSettings::default();
    dataset.world_frame = Some("map".to_owned());
    dataset
}

/// A session with a lag, whose first frame is slow.
fn session(stream: &Arc<LiveStream>) -> (LiveSession, ShownFrames) {
    let build: BuildPipeline = Box::new(|_| {
        let method = FastSamSplat::new(FastSamSplatSettings::default(), 0, &mut |_| {}).unwrap();
        Pipeline::builder(&Settings::default()).method(Box::new(SlowStart { method, has_started: false })).build()
    });
    let shown = ShownFrames::default();
    let ends: (_, Box<dyn Outlet>) = (Arc::clone(stream), Box::new(Viewer(Arc::clone(&shown))));
    let options = LiveOptions { lag: LAG, ..LiveOptions::default() };
    (LiveSession::new(build, None, ends, options).unwrap(), shown)
}

#[test]
fn frames_that_take_longer_than_the_lag_wait_for_the_next_one() {
    let limits = MatchLimits { complete: 100, pose_wait: Duration::from_secs(5), ..MatchLimits::default() };
    let stream = Arc::new(LiveStream::new(&dataset(), limits).unwrap());
    let (mut session, shown) = session(&stream);
    read_messages(&recording(), &mut |message| {
        stream.feed_at((message.topic, message.type_name), message.data, message.recorded);
        Ok(())
    })
    .unwrap();
    stream.end();
    session.run(&mut || false).unwrap();
    assert_eq!(*shown.lock().unwrap(), [(0, 2), (1, 3), (2, 4), (3, 4)]);
}

#[test]
fn frames_of_a_played_recording_wait_by_its_times_however_slowly_it_comes() {
    let stream = Arc::new(LiveStream::without_drops(&dataset()).unwrap());
    let (mut session, shown) = session(&stream);
    let requests = session.requests();
    std::thread::scope(|scope| {
        let feeding = scope.spawn(|| {
            feed(&stream);
            // A message of a minute later: frames wait for no other image any more.
            stream.feed_at(("/clock", "std_msgs/msg/String"), &[], Duration::from_secs(1_700_000_060));
            for _ in 0..2000 {
                if requests.look(|session| session.status().frames, Duration::from_secs(20)) == Ok(4) {
                    break;
                }
                std::thread::sleep(Duration::from_millis(5));
            }
            std::thread::sleep(LONG);
            let before_the_end = shown.lock().unwrap().len();
            stream.end();
            before_the_end
        });
        session.run(&mut || false).unwrap();
        assert_eq!(feeding.join().unwrap(), 3, "the last frame waits");
    });
    assert_eq!(*shown.lock().unwrap(), [(0, 2), (1, 3), (2, 4), (3, 4)]);
}
