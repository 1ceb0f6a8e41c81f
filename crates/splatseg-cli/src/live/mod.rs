//! `splatseg live`: a stream while it arrives.

mod player;
mod terminal_outlet;

use crate::input_paths::InputPaths;
use crate::options::SettingsOptions;
use crate::output_folder::OverwritePolicy;
use crate::run::{ExtraFile, FileKind, StopSignals, use_threads};
use crate::{Failure, devices};
use clap::Args;
use player::{Pace, play};
use splatseg::pipeline::LoadedNetworks;
use splatseg::{Pipeline, Settings};
use splatseg_dataset::{DatasetSettings, MatchLimits, McapScene};
use splatseg_live::{BuildPipeline, LiveOptions, LiveSession, LiveStream, Outlet, SavedMap, ViewOutlet};
use splatseg_view::{Reach, ViewOptions};
use std::ffi::OsString;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;
use terminal_outlet::TerminalOutlet;

#[derive(Debug, Args)]
#[command(after_long_help = "Examples:\n  \
    splatseg live kitchen.mcap --map home.ply\n  \
    splatseg live kitchen.mcap --map home.ply --speed 0.5 --poses track\n  \
    splatseg live kitchen.mcap --map home.ply --every-frame\n  \
    splatseg live kitchen.mcap --view\n\n\
    Ctrl-C or SIGTERM ends it after the present frame; the map is saved then, and every --save-interval seconds. Started\n\
    again with the same map, it goes on: a tracked camera first has to find its place in it.")]
pub struct LiveArguments {
    /// A recording of ROS 2 messages (MCAP), or a folder with one
    pub source: PathBuf,
    /// File of the map: loaded if it exists, and saved. The list of objects is beside it: FILE.objects.json
    #[arg(long, value_name = "FILE.ply")]
    pub map: Option<PathBuf>,
    /// Seconds between two saves of the map
    #[arg(long, value_name = "S", default_value_t = 30.0)]
    pub save_interval: f64,
    /// Play the recording this many times as fast
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0)]
    pub speed: f64,
    /// Use every frame, however long it takes, as `run` does
    #[arg(long, conflicts_with = "speed")]
    pub every_frame: bool,
    /// Show it in the browser and in Foxglove. An address that is given may be one that other computers reach
    #[arg(
        long,
        value_name = "ADDRESS:PORT",
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = "127.0.0.1:8765"
    )]
    pub view: Option<SocketAddr>,
    #[arg(long, value_name = "METHOD")]
    pub method: Option<String>,
    #[command(flatten)]
    pub options: SettingsOptions,
}

impl LiveArguments {
    fn settings(&self) -> Result<Settings, Failure> {
        let mut layers = self.options.layers([("method", self.method.as_ref())])?;
        if let Some(map) = self.existing_map() {
            layers.add_saved_memory(map).map_err(Failure::input)?;
        }
        layers.resolve().map_err(Failure::input)
    }

    fn existing_map(&self) -> Option<&Path> {
        self.map.as_deref().filter(|map| map.exists())
    }

    /// Checks the numbers and paths.
    fn check(&self, settings: &Settings) -> Result<(), Failure> {
        let in_range = |option: &str, value: f64, range: std::ops::RangeInclusive<f64>| {
            if range.contains(&value) {
                return Ok(());
            }
            let (least, most) = range.into_inner();
            Err(Failure::input(format!("{option}: found {value}, expected {least} to {most}")))
        };
        let (dataset, default) = (&settings.dataset, DatasetSettings::default());
        if (dataset.start, dataset.stride, dataset.max_frames) != (default.start, default.stride, default.max_frames) {
            return Err(Failure::input(
                "--start, --stride and --max-frames are not used here: a stream has no numbered frames",
            ));
        }
        in_range("--speed", self.speed, 0.01..=100.0)?;
        in_range("--save-interval", self.save_interval, 0.1..=86_400.0)?;
        if !McapScene::is_recording(&self.source) {
            let path = self.source.display();
            return Err(Failure::input(format!(
                "{path}: not a recording of ROS 2 messages (MCAP), nor a folder with one"
            )));
        }
        if let Some(map) = &self.map {
            if settings.method.memory().is_none() {
                let method = settings.method.name().name();
                return Err(Failure::input(format!("{}: the method {method} has no map to save", map.display())));
            }
            let mut inputs = InputPaths::of(settings);
            inputs.add_scene(&self.source);
            inputs.check_output_file(map)?;
            ExtraFile::prepare(map, FileKind::MAP, OverwritePolicy::Replace)?;
        }
        Ok(())
    }
}

/// Executes `splatseg live`.
pub fn live(arguments: &LiveArguments, program: &[OsString]) -> Result<(), Failure> {
    let settings = arguments.settings()?;
    arguments.check(&settings)?;
    devices::check(settings.device(), program)?;
    use_threads(settings.run.threads)?;
    settings.run.memory_limit.enforce();
    let signals = StopSignals::listen().map_err(Failure::runtime)?;
    let dataset = &settings.dataset;
    let stream = if arguments.every_frame {
        LiveStream::without_drops(dataset)
    } else {
        LiveStream::new(dataset, MatchLimits::default())
    };
    let stream = Arc::new(stream.map_err(Failure::input)?);
    let options = LiveOptions {
        saved_map: arguments.map.clone().map(SavedMap::new),
        save_interval: Duration::from_secs_f64(arguments.save_interval),
        ..LiveOptions::default()
    };
    let ends = (Arc::clone(&stream), outlet(arguments)?);
    let session = LiveSession::new(builder(settings), arguments.existing_map(), ends, options);
    let mut session = session.map_err(Failure::input)?;
    let pace = if arguments.every_frame { Pace::EveryFrame } else { Pace::Speed(arguments.speed) };
    let player = play(arguments.source.clone(), Arc::clone(&stream), pace)?;
    let ended = session.run(&mut || signals.received().is_some());
    stream.end();
    // After a signal the player may still be reading, and is not waited for.
    let played = if signals.received().is_none() { player.join() } else { Ok(Ok(())) };
    if session.status().frames > 0 {
        report(arguments, &session, &stream);
    }
    ended.map_err(Failure::runtime)?;
    played.map_err(|_| Failure::runtime("playing the recording failed"))?.map_err(Failure::input)?;
    match (session.status().frames, stream.undecided()) {
        (0, Some(undecided)) => Err(Failure::input(undecided)),
        (0, None) if signals.received().is_none() => {
            Err(Failure::input(format!("{}: none of the frames could be used", arguments.source.display())))
        }
        _ => Ok(()),
    }
}

/// The terminal and, with `--view`, a server for viewers, whose links are printed.
fn outlet(arguments: &LiveArguments) -> Result<Box<dyn Outlet>, Failure> {
    let mut outlets: Vec<Box<dyn Outlet>> = vec![Box::new(TerminalOutlet::new())];
    if let Some(address) = arguments.view {
        // Whoever names an address that others can reach wants it to be reached.
        let reach = if address.ip().is_loopback() { Reach::Loopback } else { Reach::Network };
        let scene = arguments.source.display().to_string();
        let view = ViewOutlet::start(ViewOptions { address, reach, scene, ..ViewOptions::default() });
        let view = view.map_err(Failure::input)?;
        say_error!("view:     {}\nFoxglove: {}", view.server().link(), view.server().foxglove_link());
        outlets.push(Box::new(view));
    }
    Ok(Box::new(outlets))
}

/// Builds pipelines that share their networks.
fn builder(settings: Settings) -> BuildPipeline {
    let networks = Arc::new(LoadedNetworks::default());
    Box::new(move |map| {
        let mut builder = Pipeline::builder(&settings).networks(&networks);
        if let Some(map) = map {
            builder = builder.saved_memory(map);
        }
        builder.build()
    })
}

/// Prints what was done.
fn report(arguments: &LiveArguments, session: &LiveSession, stream: &LiveStream) {
    for source in stream.sources() {
        say_error!("  {source}");
    }
    let status = session.status();
    say!("{} frames, {} objects; {}", status.frames, status.objects, stream.counts());
    say!("{}", session.latest_times());
    if let Some(map) = &arguments.map {
        say!("map: {}; objects: {}", map.display(), SavedMap::new(map.clone()).objects().display());
    }
}
