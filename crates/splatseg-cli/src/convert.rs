//! `splatseg convert`: writes any scene as a recording of ROS 2 messages.

use super::Failure;
use super::file_kind::FileKind;
use super::input_paths::InputPaths;
use super::inspect::results::not_opened;
use super::options::{DatasetOptions, memory_limit};
use super::output_folder::OverwritePolicy;
use super::run::{ExtraFile, SkippedFrames, StopSignals};
use super::system_limits::no_thread;
use super::terminal::counted;
use clap::{Args, ValueEnum};
use splatseg_dataset::{DatasetSettings, FrameSource, FrameStream, GroundTruth, Scene, open_scene};
use splatseg_output::{Compression, SceneCounts, SceneRecording};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::Arc;

#[derive(Debug, Args)]
#[command(
    after_long_help = "The recording has colour as PNG, depth as millimetres (16UC1) where that is exact and otherwise as \
    metres (32FC1), the camera of each frame, and its pose in /tf. Ground truth and corrections of poses are not part of it.\n\n\
    Examples:\n  \
    splatseg convert rgbd_dataset_freiburg1_desk desk.mcap\n  \
    splatseg convert scene0011_00.sens scene.mcap --stride 20 --resize 320x240\n  \
    splatseg convert drive.bag drive.mcap --color /camera/color/image_raw"
)]
pub struct ConvertArguments {
    /// The scene: a folder or file in any format listed for --format, or `synthetic[:frames=60,seed=3,…]`
    pub scene: PathBuf,
    /// The recording to write
    #[arg(value_name = "OUT.mcap")]
    pub out: PathBuf,
    /// Replace a recording that splatseg wrote, once the new one is complete
    #[arg(long)]
    pub overwrite: bool,
    /// Compression of the recording, besides that of the PNGs in it
    #[arg(long, value_enum, value_name = "COMPRESSION", default_value_t = CompressionName::Lz4)]
    pub compression: CompressionName,
    #[command(flatten)]
    pub dataset: DatasetOptions,
    #[arg(long, value_name = "SIZE")]
    pub memory_limit: Option<String>,
}

/// Names of compressions.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum CompressionName {
    /// For readers that know no other
    None,
    /// Chunks in LZ4
    Lz4,
}

impl From<CompressionName> for Compression {
    fn from(name: CompressionName) -> Self {
        match name {
            CompressionName::None => Self::None,
            CompressionName::Lz4 => Self::Lz4,
        }
    }
}

/// Writes the recording.
pub fn convert(arguments: &ConvertArguments) -> Result<(), Failure> {
    let settings = arguments.dataset.over(&DatasetSettings::default())?;
    memory_limit(arguments.memory_limit.as_ref())?.enforce();
    let out = Output::prepare(arguments)?;
    let signals = StopSignals::listen().map_err(|error| no_thread("listens for signals", &error))?;
    let scene = open_scene(&arguments.scene, &settings).map_err(|error| not_opened(&arguments.scene, error))?;
    let stream = FrameStream::open(Arc::clone(&scene), &settings, GroundTruth::Skip).map_err(Failure::input)?;
    inform!("{}", stream.description());
    let recording = out.start(arguments.compression.into())?;
    let counts = out.write(recording, (stream, scene.as_ref()), &signals)?;
    for note in notes(&counts) {
        say_error!("{note}");
    }
    report!("{}: {}", out.path().display(), written_text(&counts));
    Ok(())
}

/// The file to write.
struct Output(ExtraFile);

impl Output {
    /// Checks that the file may be written.
    fn prepare(arguments: &ConvertArguments) -> Result<Self, Failure> {
        let out = &arguments.out;
        let mut inputs = InputPaths::default();
        inputs.add_scene(&arguments.scene);
        inputs.check_output_file(out)?;
        ExtraFile::prepare(out, FileKind::CONVERTED, OverwritePolicy::from_flag(arguments.overwrite)).map(Self)
    }

    fn path(&self) -> &Path {
        self.0.path()
    }

    fn start(&self, compression: Compression) -> Result<SceneRecording, Failure> {
        SceneRecording::create(self.path(), compression).map_err(|error| self.failure(&error))
    }

    /// Writes the frames of a scene. Those that cannot be read are left out, as in a run.
    fn write(
        &self,
        mut recording: SceneRecording,
        (stream, scene): (FrameStream, &dyn Scene),
        signals: &StopSignals,
    ) -> Result<SceneCounts, Failure> {
        let mut skipped = SkippedFrames::default();
        for frame in stream {
            match frame {
                Ok(frame) => recording
                    .write(&frame.frame, frame.world_from_camera.as_ref())
                    .map_err(|error| self.failure(&error))?,
                Err(error) => {
                    if let Some(message) = skipped.add_unread(&error) {
                        say_error!("frame skipped: {message}");
                    }
                }
            }
            if let Some(signal) = signals.received() {
                let text = format!("interrupted by {}: {} was not written", signal.name, self.path().display());
                return Err(Failure::Interrupted { code: signal.exit_code(), text });
            }
        }
        for message in skipped.messages() {
            say_error!("{message}");
        }
        let counts = recording.counts();
        if counts.frames == 0 {
            return Err(Failure::input(format!("{}: none of the selected frames can be read", scene.name())));
        }
        recording.finish().map_err(|error| self.failure(&error))?;
        Ok(counts)
    }

    fn failure(&self, error: &std::io::Error) -> Failure {
        let text = format!("{}: cannot be written: {error}", self.path().display());
        match error.kind() {
            ErrorKind::InvalidInput => Failure::Input(text),
            _ => Failure::Runtime(text),
        }
    }
}

/// Says what a reader of the recording will see differently from the scene.
fn notes(counts: &SceneCounts) -> Vec<String> {
    let mut notes = Vec::new();
    if counts.moved_in_time > 0 {
        let frames = counted(counts.moved_in_time, "frame");
        notes.push(format!("{frames} at or before the time of the frame before: now 1/30 s after it"));
    }
    let unposed = counts.frames - counts.posed;
    if counts.posed > 0 && unposed > 0 {
        let frames = counted(unposed, "frame");
        notes.push(format!(
            "{frames} without a pose: readers interpolate between poses that are close in time (dataset.max_pose_gap_ms)"
        ));
    }
    notes
}

fn written_text(counts: &SceneCounts) -> String {
    let poses = match counts.posed {
        0 => "no poses".to_owned(),
        posed if posed == counts.frames => "all with poses".to_owned(),
        posed => format!("{posed} with poses"),
    };
    let depth = match counts.fractional_depth {
        0 => "depth in millimetres (16UC1)".to_owned(),
        all if all == counts.frames => "depth in metres (32FC1)".to_owned(),
        some => format!("depth in millimetres (16UC1), in metres (32FC1) for {}", counted(some, "frame")),
    };
    format!("{}, {poses}, {depth}", counted(counts.frames, "frame"))
}
