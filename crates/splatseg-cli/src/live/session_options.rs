//! Options that `splatseg live` and `splatseg ros2` share: settings, the map, viewers.

use super::terminal_outlet::TerminalOutlet;
use crate::Failure;
use crate::file_kind::FileKind;
use crate::input_paths::{InputPaths, real_path};
use crate::options::SettingsOptions;
use crate::output_folder::OverwritePolicy;
use crate::run::ExtraFile;
use clap::Args;
use splatseg::{Pipeline, Settings};
use splatseg_dataset::DatasetSettings;
use splatseg_live::{LiveError, LiveOptions, LiveSession, LiveStream, Outlet, SavedMap, ViewOutlet, build_with};
use splatseg_view::{Reach, ViewError, ViewOptions};
use std::io::ErrorKind;
use std::net::SocketAddr;
use std::num::ParseFloatError;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

#[derive(Debug, Args)]
pub struct SessionOptions {
    /// File of the map: loaded if it exists, and saved. The list of objects, with rooms and
    /// relations, is beside it: FILE.objects.json
    #[arg(long, value_name = "FILE.ply")]
    pub map: Option<PathBuf>,
    /// Seconds between two saves of the map
    #[arg(long, value_name = "S", default_value_t = 30.0)]
    pub save_interval: f64,
    /// Delay ids, overlays and the page by this many seconds, e.g. 1 or 1s, and decide them again with the frames in
    /// between. Poses, objects and the map are not delayed. Delayed frames are kept in memory
    #[arg(long, value_name = "S", default_value = "0", value_parser = seconds)]
    pub lag: f64,
    /// Record what is used of the stream; `live FILE.mcap --every-frame` then gives the same map
    #[arg(long, value_name = "FILE.mcap")]
    pub record: Option<PathBuf>,
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

/// The files that a session writes. Keep them until it ends: folders that were created for them are removed then, if they
/// are empty.
#[derive(Debug)]
pub struct SessionFiles {
    _map: Option<ExtraFile>,
    _recording: Option<ExtraFile>,
}

impl SessionOptions {
    /// The settings, with those of the saved map.
    pub fn settings(&self) -> Result<Settings, Failure> {
        let mut layers = self.options.layers([("method", self.method.as_ref())])?;
        if let Some(map) = self.existing_map() {
            layers.add_saved_memory(map).map_err(Failure::input)?;
        }
        layers.resolve().map_err(Failure::input)
    }

    fn existing_map(&self) -> Option<&Path> {
        self.map.as_deref().filter(|map| map.exists())
    }

    /// Checks the numbers and paths. `source` is the input, if it is a file.
    pub fn check(&self, settings: &Settings, source: Option<&Path>) -> Result<SessionFiles, Failure> {
        let (dataset, default) = (&settings.dataset, DatasetSettings::default());
        if (dataset.start, dataset.stride, dataset.max_frames) != (default.start, default.stride, default.max_frames) {
            return Err(Failure::input(
                "--start, --stride and --max-frames are not used here: a stream has no numbered frames",
            ));
        }
        Pipeline::builder(settings).check_depth_predictor().map_err(Failure::input)?;
        in_range("--save-interval", self.save_interval, 0.1..=86_400.0)?;
        in_range("--lag", self.lag, 0.0..=LiveOptions::MAX_LAG.as_secs_f64())?;
        let mut map_file = None;
        if let Some(map) = &self.map {
            if settings.method.memory().is_none() {
                let method = settings.method.name().name();
                return Err(Failure::input(format!("{}: the method {method} has no map to save", map.display())));
            }
            let mut inputs = InputPaths::of(settings);
            if let Some(source) = source {
                inputs.add_scene(source);
            }
            inputs.check_output_file(map)?;
            let saved = SavedMap::new(map.clone());
            self.check_recording(&saved)?;
            FileKind::OBJECTS.check(&saved.objects(), OverwritePolicy::Replace)?;
            map_file = Some(ExtraFile::prepare(map, FileKind::MAP, OverwritePolicy::Replace)?);
        }
        let recording = match &self.record {
            Some(file) if file.symlink_metadata().is_ok() => {
                return Err(Failure::input(format!("{}: exists: choose another file for --record", file.display())));
            }
            Some(file) => Some(ExtraFile::prepare(file, FileKind::RECORDING, OverwritePolicy::Keep)?),
            None => None,
        };
        Ok(SessionFiles { _map: map_file, _recording: recording })
    }

    /// Checks that the recording is not one of the map's files.
    fn check_recording(&self, map: &SavedMap) -> Result<(), Failure> {
        let Some(recording) = &self.record else { return Ok(()) };
        let real = real_path(recording);
        for (path, what) in [(map.map(), "the file of --map"), (&map.objects(), "the list of objects beside --map")] {
            if real_path(path) == real {
                let path = recording.display();
                return Err(Failure::input(format!("{path}: is {what}: choose another file for --record")));
            }
        }
        Ok(())
    }

    /// Starts the recording, if there is to be one.
    pub fn start_recording(&self, stream: &LiveStream) -> Result<(), Failure> {
        let Some(file) = &self.record else { return Ok(()) };
        stream.record(file).map_err(|error| Failure::input(format!("{}: {error}", file.display())))
    }

    /// Ends the recording, if there is one.
    fn finish_recording(&self, stream: &LiveStream) -> Result<(), Failure> {
        let Some(file) = &self.record else { return Ok(()) };
        stream.finish_recording().map_err(Failure::runtime)?;
        report!("recording: {}", file.display());
        Ok(())
    }

    /// Ends a session: prints what was done, and ends the recording. `ended` is the session's result, `played` that of
    /// its source.
    ///
    /// # Errors
    /// Everything that went wrong.
    pub fn finish(
        &self,
        session: &LiveSession,
        stream: &LiveStream,
        ended: Result<(), LiveError>,
        played: Result<(), Failure>,
    ) -> Result<(), Failure> {
        if session.status().frames > 0 {
            self.report(session, stream);
        }
        let recorded = self.finish_recording(stream);
        Failure::all([ended.map_err(Failure::runtime), played, recorded])
    }

    /// Creates the session. Its results go to the terminal, to viewers, and to `outlets`.
    pub fn session(
        &self,
        settings: Settings,
        stream: &Arc<LiveStream>,
        mut outlets: Vec<Box<dyn Outlet>>,
        scene: &str,
    ) -> Result<LiveSession, Failure> {
        let options = LiveOptions {
            saved_map: self.map.clone().map(SavedMap::new),
            save_interval: Duration::from_secs_f64(self.save_interval),
            lag: Duration::from_secs_f64(self.lag),
            ..LiveOptions::default()
        };
        if let Some(address) = self.view {
            outlets.push(Box::new(view(address, scene)?));
        }
        outlets.push(Box::new(TerminalOutlet::new()));
        let ends: (_, Box<dyn Outlet>) = (Arc::clone(stream), Box::new(outlets));
        LiveSession::new(build_with(settings), self.existing_map(), ends, options).map_err(Failure::input)
    }

    /// Prints what was done. Names only files that contain it.
    fn report(&self, session: &LiveSession, stream: &LiveStream) {
        for source in stream.sources() {
            inform!("  {source}");
        }
        let status = session.status();
        report!("{} frames, {}; {}", status.frames, session.objects().counts(), stream.counts());
        report!("{}", session.latest_times());
        let (Some(map), Some(saving)) = (&self.map, &status.saving) else { return };
        let files = SavedMap::new(map.clone());
        let is_there = |path: &Path| path.is_file().then(|| path.display().to_string());
        let (map, objects) = (is_there(files.map()), is_there(&files.objects()));
        match (saving.saved_frames, &saving.problem, map.zip(objects)) {
            (Some(_), None, Some((map, objects))) => report!("map: {map}; objects: {objects}"),
            (Some(saved), Some(_), Some((map, objects))) => {
                report!("map: {map}; objects: {objects}: as of frame {saved} of {}", status.frames);
            }
            // The error says what is not there.
            _ => {}
        }
    }
}

/// Parses a number of seconds, with or without their unit.
fn seconds(text: &str) -> Result<f64, ParseFloatError> {
    text.strip_suffix('s').unwrap_or(text).parse()
}

/// Checks a number.
pub fn in_range(option: &str, value: f64, range: std::ops::RangeInclusive<f64>) -> Result<(), Failure> {
    if range.contains(&value) {
        return Ok(());
    }
    let (least, most) = range.into_inner();
    Err(Failure::input(format!("{option}: found {value}, expected {least} to {most}")))
}

/// A server for viewers, whose links are printed.
fn view(address: SocketAddr, scene: &str) -> Result<ViewOutlet, Failure> {
    // Whoever names an address that others can reach wants it to be reached.
    let reach = if address.ip().is_loopback() { Reach::Loopback } else { Reach::Network };
    let options = ViewOptions { address, reach, scene: scene.to_owned(), ..ViewOptions::default() };
    let view = ViewOutlet::start(options).map_err(|error| {
        let another = match &error {
            ViewError::Listen { source, .. } if source.kind() == ErrorKind::AddrInUse => {
                let host = address.to_string();
                format!("; another port: --view={}PORT", host.trim_end_matches(|end: char| end.is_ascii_digit()))
            }
            _ => String::new(),
        };
        Failure::input(format!("{error}{another}"))
    })?;
    say_error!("view:     {}\nFoxglove: {}", view.server().link(), view.server().foxglove_link());
    Ok(view)
}
