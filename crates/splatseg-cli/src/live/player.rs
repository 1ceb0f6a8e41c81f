//! Plays a recording like a camera.

use crate::Failure;
use crate::system_limits::no_thread;
use splatseg_dataset::{DatasetError, read_messages};
use splatseg_live::LiveStream;
use std::path::PathBuf;
use std::sync::Arc;
use std::thread::{Builder, JoinHandle, sleep};
use std::time::{Duration, Instant};

/// Longest sleep without a look at whether the stream has ended.
const NAP: Duration = Duration::from_millis(100);

/// How fast a recording is played.
#[derive(Clone, Copy, Debug)]
pub enum Pace {
    /// This many times as fast as it was recorded.
    Speed(f64),
    /// As fast as frames are used.
    EveryFrame,
}

/// Feeds a stream with the messages of a recording, on a thread, and ends the stream after the last one.
pub fn play(
    path: PathBuf,
    stream: Arc<LiveStream>,
    pace: Pace,
) -> Result<JoinHandle<Result<(), DatasetError>>, Failure> {
    let work = move || {
        let started = Instant::now();
        let mut first = None;
        let played = read_messages(&path, &mut |message| {
            let Pace::Speed(speed) = pace else {
                stream.feed_at((message.topic, message.type_name), message.data, message.recorded);
                return Ok(());
            };
            let passed = message.recorded.saturating_sub(*first.get_or_insert(message.recorded));
            let due = Duration::try_from_secs_f64(passed.as_secs_f64() / speed).unwrap_or_default();
            while let Some(left) = due.checked_sub(started.elapsed()).filter(|left| !left.is_zero()) {
                if stream.is_over() {
                    return Ok(());
                }
                sleep(left.min(NAP));
            }
            stream.feed(message.topic, message.type_name, message.data);
            Ok(())
        });
        stream.end();
        played
    };
    Builder::new().name("player".to_owned()).spawn(work).map_err(|error| no_thread("plays the recording", &error))
}
