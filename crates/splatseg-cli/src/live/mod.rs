//! `splatseg live` and `splatseg ros2`: a stream while it arrives.

mod player;
#[cfg(feature = "ros2")]
pub mod ros2;
#[cfg(not(feature = "ros2"))]
#[path = "without_ros2.rs"]
pub mod ros2;
mod session_options;
mod terminal_outlet;

use crate::run::StopSignals;
use crate::system_limits::{no_thread, use_threads};
use crate::{Failure, devices};
use clap::Args;
use player::{Pace, play};
use session_options::{SessionFiles, SessionOptions, in_range};
use splatseg::Settings;
use splatseg_dataset::{MatchLimits, RecordingScene};
use splatseg_live::LiveStream;
use std::ffi::OsString;
use std::path::PathBuf;
use std::sync::Arc;

#[derive(Debug, Args)]
#[command(after_long_help = "Examples:\n  \
    splatseg live kitchen.mcap --map home.ply\n  \
    splatseg live kitchen.mcap --map home.ply --speed 0.5 --poses track\n  \
    splatseg live kitchen.mcap --map home.ply --every-frame\n  \
    splatseg live webcam.mcap --depth-weights depth_anything_v2_metric_hypersim_vits.pth\n  \
    splatseg live kitchen.mcap --view\n\n\
    Ctrl-C or SIGTERM ends it after the present frame; the map is saved then, and every --save-interval seconds. Started\n\
    again with the same map, it goes on: a tracked camera first has to find its place in it.")]
pub struct LiveArguments {
    /// A recording of ROS messages (.mcap, .db3, .bag) or of an Azure Kinect (.mkv), or a folder with one
    pub source: PathBuf,
    /// Play the recording this many times as fast
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0)]
    pub speed: f64,
    /// Use every frame, however long it takes, as `run --online` does
    #[arg(long, conflicts_with = "speed")]
    pub every_frame: bool,
    #[command(flatten)]
    pub session: SessionOptions,
}

impl LiveArguments {
    /// Checks the numbers and paths.
    fn check(&self, settings: &Settings) -> Result<SessionFiles, Failure> {
        in_range("--speed", self.speed, 0.01..=100.0)?;
        if !RecordingScene::is_recording(&self.source) {
            let path = self.source.display();
            return Err(Failure::input(format!(
                "{path}: not a recording of ROS messages (.mcap, .db3, .bag) or of an Azure Kinect (.mkv), nor a folder with one"
            )));
        }
        self.session.check(settings, Some(&self.source))
    }
}

/// Executes `splatseg live`.
pub fn live(arguments: &LiveArguments, program: &[OsString]) -> Result<(), Failure> {
    let mut settings = arguments.session.settings()?;
    let _files = arguments.check(&settings)?;
    settings.settle_depth(&arguments.source).map_err(Failure::input)?;
    devices::check(settings.device(), program)?;
    use_threads(settings.run.threads)?;
    settings.run.memory_limit.enforce();
    let signals = StopSignals::listen().map_err(|error| no_thread("listens for signals", &error))?;
    let dataset = &settings.dataset;
    let stream = if arguments.every_frame {
        LiveStream::without_drops(dataset)
    } else {
        LiveStream::new(dataset, MatchLimits::default())
    };
    let stream = Arc::new(stream.map_err(Failure::input)?);
    let scene = arguments.source.display().to_string();
    let mut session = arguments.session.session(settings, &stream, Vec::new(), &scene)?;
    arguments.session.start_recording(&stream)?;
    let pace = if arguments.every_frame { Pace::EveryFrame } else { Pace::Speed(arguments.speed) };
    let player = play(arguments.source.clone(), Arc::clone(&stream), pace)?;
    let ended = session.run(&mut || signals.received().is_some());
    session.close_requests();
    stream.end();
    // After a signal the player may still be reading, and is not waited for.
    let played = if signals.received().is_none() { player.join() } else { Ok(Ok(())) };
    let played = match played {
        Ok(played) => played.map_err(Failure::input),
        Err(_) => Err(Failure::runtime("playing the recording failed")),
    };
    arguments.session.finish(&session, &stream, ended, played)?;
    match (session.status().frames, stream.undecided()) {
        (0, Some(undecided)) => Err(Failure::input(undecided)),
        (0, None) if signals.received().is_none() => {
            Err(Failure::input(format!("{scene}: none of the frames could be used")))
        }
        _ => Ok(()),
    }
}
