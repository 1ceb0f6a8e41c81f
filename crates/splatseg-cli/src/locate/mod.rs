//! `splatseg locate`: where single frames were taken, in the coordinates of a saved map.

mod comparison;

use super::Failure;
use super::file_kind::FileKind;
use super::input_paths::InputPaths;
use super::map_changes::load_with_keyframes;
use super::options::DatasetOptions;
use super::output_folder::OverwritePolicy;
use super::terminal::{counted, print_text};
use clap::Args;
use comparison::{Comparison, Group, PoseError};
use serde::Serialize;
use splatseg::odometry::{LocatedFrame, Relocaliser};
use splatseg_annotations::{TRAJECTORY_HEADER, frame_time, trajectory_line};
use splatseg_dataset::{DatasetSettings, FrameSource, FrameStream, GroundTruth, StreamedFrame, open_scene};
use splatseg_output::write_atomically;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

#[derive(Debug, Args)]
#[command(after_long_help = "Examples:\n  \
    splatseg run monday --poses track --out monday-out --save-memory monday.ply\n  \
    splatseg locate monday.ply photos --out poses.txt\n  \
    splatseg locate monday.ply tuesday --stride 10 --compare --out poses.txt --json located.json\n\n\
    Each frame is searched for by itself, in all keyframes of the map. It is found if the map shows its place from within\n\
    about 50 cm and 30 degrees. A place that only looks the same can be mistaken for one in the map: a run with\n\
    --load-memory confirms each place with a second frame.")]
pub struct LocateArguments {
    /// The map: a memory saved by `run --save-memory`
    pub map: PathBuf,
    /// The frames: a scene with depth, as for `run`
    pub scene: PathBuf,
    /// File for the poses of the frames that were found, in TUM's format; by default they are printed. Frames without
    /// timestamps have the time of their index / 30
    #[arg(long, value_name = "FILE.txt")]
    pub out: Option<PathBuf>,
    /// File for all frames, found or not, and the counts
    #[arg(long, value_name = "FILE.json")]
    pub json: Option<PathBuf>,
    /// The scene's poses are true and in the map's coordinates: say how many frames were found there
    #[arg(long)]
    pub compare: bool,
    /// Replace existing files of the same kind
    #[arg(long)]
    pub overwrite: bool,
    #[command(flatten)]
    pub dataset: DatasetOptions,
}

/// Content of the `--json` file. Its keys are part of the interface.
#[derive(Debug, Serialize)]
struct Located {
    map: String,
    scene: String,
    keyframes: usize,
    /// Frames that were searched for.
    frames: usize,
    found: usize,
    /// Frames that could not be read.
    skipped: usize,
    /// Mean time per frame without reading it, milliseconds.
    mean_ms: f64,
    /// With `--compare`: the frames by how near the map was seen from.
    comparison: Option<Vec<Group>>,
    results: Vec<FrameResult>,
    version: &'static str,
}

/// The result of a frame.
#[derive(Debug, Serialize)]
struct FrameResult {
    frame: String,
    /// Index in the scene.
    index: usize,
    /// Seconds.
    time: f64,
    #[serde(flatten)]
    place: Option<Place>,
    /// With `--compare`, if it was found.
    error: Option<PoseError>,
}

/// Where a frame was taken.
#[derive(Debug, Serialize)]
struct Place {
    /// Camera to world: position, metres, and unit quaternion x, y, z, w.
    position: [f64; 3],
    quaternion: [f64; 4],
    keyframe: u64,
    part: u32,
    features: usize,
    agreement: f32,
}

/// Executes `splatseg locate`.
pub fn locate(arguments: &LocateArguments) -> Result<(), Failure> {
    check_files(arguments)?;
    let relocaliser = relocaliser(&arguments.map)?;
    let dataset = arguments.dataset.over(&DatasetSettings::default())?;
    let scene = open_scene(&arguments.scene, &dataset).map_err(Failure::input)?;
    if arguments.compare && !scene.has_poses() {
        return Err(Failure::input(format!("{}: has no poses to compare with", arguments.scene.display())));
    }
    let stream = FrameStream::open(scene, &dataset, GroundTruth::Skip).map_err(Failure::input)?;
    inform!("{}", stream.description());
    inform!("{}: {}", arguments.map.display(), counted(relocaliser.keyframe_count(), "keyframe"));
    let found = search(arguments, &relocaliser, stream)?;
    let written = |path: &Path, bytes: &[u8]| write_atomically(path, bytes).map_err(Failure::runtime);
    match &arguments.out {
        Some(path) => written(path, found.trajectory.as_bytes())?,
        None => print_text(&found.trajectory),
    }
    for line in found.lines(&relocaliser) {
        say_error!("{line}");
    }
    let Some(path) = &arguments.json else { return Ok(()) };
    let mut text = serde_json::to_vec_pretty(&found.json(arguments, &relocaliser)).map_err(Failure::runtime)?;
    text.push(b'\n');
    written(path, &text)
}

/// Refuses to replace inputs, files of other kinds, and without `--overwrite` all files.
fn check_files(arguments: &LocateArguments) -> Result<(), Failure> {
    let mut inputs = InputPaths::default();
    inputs.add("the map", &arguments.map);
    inputs.add_scene(&arguments.scene);
    for (path, kind) in [(&arguments.out, FileKind::POSES), (&arguments.json, FileKind::LOCATED)] {
        let Some(path) = path else { continue };
        inputs.check_output_file(path)?;
        kind.check(path, OverwritePolicy::from_flag(arguments.overwrite))?;
    }
    match (&arguments.out, &arguments.json) {
        (Some(out), Some(json)) if out == json => {
            Err(Failure::input(format!("{}: is the file of --out: choose another file for --json", json.display())))
        }
        _ => Ok(()),
    }
}

fn relocaliser(map: &Path) -> Result<Relocaliser, Failure> {
    let (_, keyframes) = load_with_keyframes(map)?.ok_or_else(|| {
        let reason = "has no keyframes, so frames cannot be located in it: save it again with this version";
        Failure::input(format!("{}: {reason}", map.display()))
    })?;
    Relocaliser::new(&keyframes).map_err(|error| Failure::input(format!("{}: {error}", map.display())))
}

/// The frames of a scene, searched for in a map.
struct SearchedFrames {
    results: Vec<FrameResult>,
    trajectory: String,
    found: usize,
    skipped: usize,
    /// Time of all searches.
    time: Duration,
    comparison: Option<Comparison>,
}

/// Searches for each frame by itself.
fn search(
    arguments: &LocateArguments,
    relocaliser: &Relocaliser,
    stream: FrameStream,
) -> Result<SearchedFrames, Failure> {
    let scene = arguments.scene.display();
    let comparison = arguments.compare.then(Comparison::default);
    let (results, trajectory) = (Vec::new(), TRAJECTORY_HEADER.to_owned());
    let mut searched = SearchedFrames { results, trajectory, found: 0, skipped: 0, time: Duration::ZERO, comparison };
    let (mut has_depth, mut first_error) = (false, None);
    for streamed in stream {
        match streamed {
            Ok(streamed) => {
                has_depth |= streamed.frame.depth().pixels().iter().any(|depth| *depth > 0.0);
                searched.add(&streamed, relocaliser);
            }
            Err(error) => {
                searched.skipped += 1;
                first_error.get_or_insert(error);
            }
        }
    }
    match first_error {
        Some(error) if searched.results.is_empty() => Err(Failure::input(error)),
        None if searched.results.is_empty() => Err(Failure::input(format!("{scene}: has no frames"))),
        _ if !has_depth => Err(Failure::input(format!("{scene}: no frame has depth, which locating needs"))),
        Some(error) => {
            say_error!("{} skipped, the first one: {error}", counted(searched.skipped, "frame"));
            Ok(searched)
        }
        None => Ok(searched),
    }
}

impl SearchedFrames {
    fn add(&mut self, streamed: &StreamedFrame, relocaliser: &Relocaliser) {
        let frame = &streamed.frame;
        let started = Instant::now();
        let located = relocaliser.locate(frame);
        self.time += started.elapsed();
        let truth = streamed.world_from_camera.as_ref();
        let error = truth.zip(self.comparison.as_mut()).and_then(|(truth, comparison)| {
            comparison.add(relocaliser, truth, located.as_ref().map(|located| &located.world_from_camera))
        });
        let time = frame_time(frame.timestamp(), streamed.index);
        if let Some(located) = &located {
            self.found += 1;
            self.trajectory.push_str(&trajectory_line(time, &located.world_from_camera));
        }
        self.results.push(FrameResult {
            frame: frame.name().to_owned(),
            index: streamed.index,
            time: time.as_secs_f64(),
            place: located.as_ref().map(Place::of),
            error,
        });
    }

    /// Mean time per frame, milliseconds.
    fn mean_ms(&self) -> f64 {
        self.time.as_secs_f64() * 1e3 / self.results.len().max(1) as f64
    }

    /// The counts, for the terminal.
    fn lines(&self, relocaliser: &Relocaliser) -> Vec<String> {
        let (found, frames) = (self.found, counted(self.results.len(), "frame"));
        let mut lines = vec![format!("{found} of {frames} found, {:.1} ms per frame", self.mean_ms())];
        if relocaliser.part_count() > 1 && found > 0 {
            lines.push(format!(
                "the map has {} parts, whose places relative to each other are unknown: --json tells each frame's part",
                relocaliser.part_count()
            ));
        }
        lines.extend(self.comparison.iter().flat_map(Comparison::lines));
        lines
    }

    fn json(self, arguments: &LocateArguments, relocaliser: &Relocaliser) -> Located {
        Located {
            map: arguments.map.display().to_string(),
            scene: arguments.scene.display().to_string(),
            keyframes: relocaliser.keyframe_count(),
            frames: self.results.len(),
            found: self.found,
            skipped: self.skipped,
            mean_ms: self.mean_ms(),
            comparison: self.comparison.map(Comparison::into_groups),
            results: self.results,
            version: env!("CARGO_PKG_VERSION"),
        }
    }
}

impl Place {
    fn of(located: &LocatedFrame) -> Self {
        let turn = glam::DQuat::from_mat3(&located.world_from_camera.rotation()).normalize();
        Self {
            position: located.world_from_camera.translation().to_array(),
            quaternion: if turn.w < 0.0 { -turn } else { turn }.to_array(),
            keyframe: u64::from(located.keyframe),
            part: located.part,
            features: located.features,
            agreement: located.agreement,
        }
    }
}
