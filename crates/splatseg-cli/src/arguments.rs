//! The command line.

use super::Failure;
use super::batch::BatchArguments;
use super::bench::BenchArguments;
use super::completions::CompletionsArguments;
use super::convert::ConvertArguments;
use super::devices::DevicesArguments;
use super::eval::EvalArguments;
use super::export::ExportArguments;
use super::find::FindArguments;
use super::help_layout::arranged;
use super::inspect::InspectArguments;
use super::live::LiveArguments;
use super::live::ros2::Ros2Arguments;
use super::locate::LocateArguments;
#[cfg(feature = "man")]
use super::manual::ManArguments;
use super::map_changes::DiffArguments;
use super::mcp::McpArguments;
use super::merge::MergeArguments;
use super::name::NameArguments;
use super::options::SettingsOptions;
use super::route::RouteArguments;
use super::run::SavedRun;
use super::settings::SettingsArguments;
use super::terminal::record_output_error;
use clap::builder::{PossibleValue, PossibleValuesParser};
use clap::{Arg, Args, CommandFactory, FromArgMatches, Parser, Subcommand};
use splatseg::Settings;
use splatseg::parts::{Part, PartKind};
use splatseg::pipeline::Rotate;
use splatseg::segmenter::Detail;
use splatseg::settings::{Entry, MethodName, MethodPreset, SettingsLayers, describe, entries};
use splatseg::{Segmenter, Tracker};
use splatseg_dataset::DepthRegistration;
use splatseg_odometry::PoseMode;
use splatseg_settings::{Allowed, Choice};
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// Gives every object in an RGB-D video one id that lasts for the whole video, by remembering what was seen in an
/// online 3D Gaussian splat.
#[derive(Debug, Parser)]
#[command(name = "splatseg", version, propagate_version = true)]
pub struct Arguments {
    /// Print only results, warnings and errors: no progress, and no report at the end
    #[arg(short, long, global = true)]
    pub quiet: bool,
    #[command(subcommand)]
    pub command: Command,
}

/// The result of parsing a command line.
#[derive(Debug)]
pub enum Parsed {
    /// A command to execute.
    Arguments(Box<Arguments>),
    /// Help or the version (already printed).
    Help,
    /// Invalid arguments (already reported).
    Wrong {
        /// The exit code.
        code: u8,
    },
}

#[derive(Debug, Subcommand)]
pub enum Command {
    /// Segment a short video that is built into the program: needs no files and no network
    Demo(DemoArguments),
    /// Segment a recorded RGB-D video
    Run(Box<RunArguments>),
    /// Segment a stream while it arrives, here a recording that is played: the newest frame wins, the map is kept
    Live(Box<LiveArguments>),
    /// Segment the stream of a ROS 2 camera, as a node: needs no ROS on this computer
    Ros2(Box<Ros2Arguments>),
    /// Score predictions, of this program or any other, against a scene's ground truth
    Eval(Box<EvalArguments>),
    /// Compare methods: scenes × methods × seeds, with tables and a report
    Bench(Box<BenchArguments>),
    /// Segment many videos: on all cores of this machine, or on a Ray cluster
    Batch(Box<BatchArguments>),
    /// Process jobs from standard input
    #[command(hide = true)]
    BatchWorker,
    /// Show the contents of a checkpoint (network, tensors, parameters), a recording (topics and the ones used) or a scene
    Inspect(Box<InspectArguments>),
    /// Write a scene of any format as a recording of ROS 2 messages (MCAP), without loss
    Convert(Box<ConvertArguments>),
    /// Write the objects of a saved memory as PLY files, for viewers and other programs
    Export(ExportArguments),
    /// Compare two saved memories of a place: what is gone, new, moved, unchanged or was not looked at
    Diff(DiffArguments),
    /// Make one map of two saved memories of a place, from two days or two robots
    Merge(MergeArguments),
    /// Find objects of a saved memory by words: labels, colours, sizes, and pictures with a network
    Find(FindArguments),
    /// Give the objects of a saved memory names: by hand, from a file, or with a network
    Name(NameArguments),
    /// Print a free way of a robot between two places of a saved memory: objects, rooms or coordinates
    Route(RouteArguments),
    /// Serve a saved memory to an assistant: tools that list, find, show and name its objects (Model Context Protocol)
    Mcp(McpArguments),
    /// Find where single frames were taken, in the coordinates of a saved memory
    Locate(Box<LocateArguments>),
    /// List the devices that networks can run on, and test each one
    Devices(DevicesArguments),
    /// List every setting with its default, allowed values and meaning
    Settings(SettingsArguments),
    /// Print the completions of this command for a shell
    Completions(CompletionsArguments),
    /// Write the manual pages
    #[cfg(feature = "man")]
    Man(ManArguments),
}

impl Command {
    /// True for the commands that have threads, but no setting for their number.
    pub fn has_fixed_threads(&self) -> bool {
        use Command::{Convert, Diff, Eval, Export, Find, Inspect, Locate, Mcp, Merge, Name, Route};
        matches!(
            self,
            Convert(_)
                | Diff(_)
                | Eval(_)
                | Export(_)
                | Find(_)
                | Inspect(_)
                | Locate(_)
                | Mcp(_)
                | Merge(_)
                | Name(_)
                | Route(_)
        )
    }
}

#[derive(Debug, Args)]
pub struct DemoArguments {
    /// Folder for the video and the results
    #[arg(long, value_name = "DIR", default_value = "splatseg-demo")]
    pub out: PathBuf,
    /// Replace the results of an earlier demo in that folder
    #[arg(long)]
    pub overwrite: bool,
    /// Use at most this many of the clip's 36 frames
    #[arg(long, value_name = "N")]
    pub frames: Option<usize>,
    /// Open the page with the results in the browser
    #[arg(long)]
    pub open: bool,
}

#[derive(Debug, Args)]
#[command(
    after_help = "splatseg run --help lists all options, splatseg settings all settings.",
    after_long_help = "Later layers win: defaults, --config, the options above, --set.\n\nExamples:\n  \
    splatseg run drive.mcap --open\n  \
    splatseg run redkitchen --out out --resize 320x240 --crop-border 5\n  \
    splatseg run scene0011_00 --out out --stride 20 --set memory.max_votes=8\n  \
    splatseg run scene --out out --segmenter masks --masks my_model_output\n  \
    splatseg run synthetic:frames=60,seed=3 --out out"
)]
pub struct RunArguments {
    /// The scene: a folder or file in any format listed for --format, or `synthetic[:frames=60,seed=3,…]`
    pub scene: PathBuf,
    /// Folder for the results; by default NAME-splatseg in the current folder, with the name of the scene, or
    /// NAME-splatseg-2 and so on if that exists
    ///
    /// It gets index.html (a page that shows the results), segments/*.png, overlay/*.jpg, objects.json, objects.csv,
    /// objects/*.jpg, poses.txt, summary.json, and manifest.jsonl (a list of these files).
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Replace the results of an earlier run in that folder
    ///
    /// They stay until the first new ones are complete; other files stay in any case.
    #[arg(long, requires = "out")]
    pub overwrite: bool,
    /// Open the page with the results in the browser
    #[arg(long, conflicts_with = "no_page")]
    pub open: bool,
    #[arg(long, value_name = "METHOD")]
    pub method: Option<String>,
    #[command(flatten)]
    pub options: SettingsOptions,
    /// Save the memory when done, as a PLY file that any Gaussian-splat viewer opens
    #[arg(long, value_name = "FILE.ply")]
    pub save_memory: Option<PathBuf>,
    /// Save all masks as one COCO file: compressed RLE, with the id as track_id
    #[arg(long, value_name = "FILE.json")]
    pub save_coco: Option<PathBuf>,
    /// Save overlays, id images, camera, map, free space and boxes of objects as a recording of ROS 2 messages, for Foxglove
    /// and Rerun
    #[arg(long, value_name = "FILE.mcap")]
    pub save_mcap: Option<PathBuf>,
    /// Continue with a saved memory and its ids
    #[arg(long, value_name = "FILE.ply")]
    pub load_memory: Option<PathBuf>,
    /// End the run with exit code 2 at the first frame that cannot be used, instead of skipping it, and when frames
    /// contradict what came with them, such as poses or units, instead of warning
    #[arg(long)]
    pub strict_input: bool,
    #[arg(long, value_name = "N")]
    pub save_every: Option<String>,
    /// Resume the stopped run in that folder
    ///
    /// It goes on from its last --save-every state, with its settings, loaded memory and files to save; without such a
    /// state, a new run starts. The results are the same as without the stop. Without --out, the folder is the latest
    /// NAME-splatseg.
    #[arg(long, conflicts_with = "overwrite")]
    pub resume: bool,
    /// Do not write index.html, the page that shows the results
    #[arg(long)]
    pub no_page: bool,
    /// Do not write overlay/*.jpg, the frames with their objects drawn over them
    #[arg(long)]
    pub no_overlay: bool,
    /// Leave out the final pass, in which the map of the end decides the ids of all frames again: the results are what
    /// was known at the time of each frame
    #[arg(long)]
    pub online: bool,
}

impl RunArguments {
    /// Resolves the settings from file, options and assignments, from a saved memory, and from the run in `out` if that is
    /// resumed. `load_memory` is the map to start with.
    pub fn settings(&self, out: &Path, load_memory: Option<&Path>) -> Result<Settings, Failure> {
        let strict_input = self.strict_input.then(|| "true".to_owned());
        let page = self.no_page.then(|| "false".to_owned());
        let overlay = self.no_overlay.then(|| "false".to_owned());
        let online = self.online.then(|| "true".to_owned());
        let options = [
            ("method", self.method.as_ref()),
            ("strict_input", strict_input.as_ref()),
            ("save_every", self.save_every.as_ref()),
            ("page", page.as_ref()),
            ("overlay", overlay.as_ref()),
            ("online", online.as_ref()),
        ];
        let mut layers = SettingsLayers::default();
        if let (true, Some(path)) = (self.resume, SavedRun::settings_file(out)) {
            layers.add_file(&path).map_err(Failure::input)?;
        }
        let mut layers = self.options.layers_over(layers, options)?;
        if let Some(path) = load_memory {
            layers.add_saved_memory(path).map_err(Failure::input)?;
        }
        layers.resolve().map_err(Failure::input)
    }
}

impl Arguments {
    /// Parses a command line. Prints help and usage errors.
    pub fn parse(arguments: Vec<OsString>) -> Parsed {
        let matches = complete_command().try_get_matches_from(with_joined_values(arguments));
        match matches.and_then(|matches| Self::from_arg_matches(&matches)) {
            Ok(arguments) => Parsed::Arguments(Box::new(arguments)),
            Err(error) if error.use_stderr() => {
                // If it cannot be printed, the exit code still reports it.
                let _ = error.print();
                Parsed::Wrong { code: u8::try_from(error.exit_code()).unwrap_or(2) }
            }
            Err(help) => {
                record_output_error(help.print());
                Parsed::Help
            }
        }
    }
}

/// The command with the help of every option.
pub fn complete_command() -> clap::Command {
    arranged(with_settings(Arguments::command(), &entries()))
}

/// Joins `--register-depth` and its value, which may be left out: `--register-depth SCENE` and `--register-depth false`.
fn with_joined_values(arguments: Vec<OsString>) -> Vec<OsString> {
    const OPTION: &str = "--register-depth";
    let mut joined: Vec<OsString> = Vec::with_capacity(arguments.len());
    for argument in arguments {
        let value = argument.to_str().filter(|value| DepthRegistration::from_name(value).is_some());
        match (value, joined.last_mut()) {
            (Some(value), Some(last)) if last == OPTION => *last = format!("{OPTION}={value}").into(),
            _ => joined.push(argument),
        }
    }
    joined
}

/// Completes the arguments that stand for settings: an argument without help gets its help and allowed values from the
/// setting.
fn with_settings(command: clap::Command, entries: &[Entry]) -> clap::Command {
    let complete = |argument: Arg| match find_entry(&argument, entries) {
        Some(entry) if argument.get_help().is_none() => {
            let help = entry.field.help();
            let first = help.split_inclusive(". ").next().unwrap_or_default().trim_end();
            let argument = argument.help(first.replace('`', "")).long_help(describe(entry).replace('`', ""));
            if matches!(entry.field.allowed, Allowed::Names(_)) {
                argument.value_parser(PossibleValuesParser::new(possible_values(entry)))
            } else {
                argument
            }
        }
        _ => argument,
    };
    command.mut_args(complete).mut_subcommands(|inner| with_settings(inner, entries))
}

/// Returns the setting that an argument stands for.
fn find_entry<'e>(argument: &Arg, entries: &'e [Entry]) -> Option<&'e Entry> {
    let name = argument.get_id().as_str();
    let has_key = |key: &str| entries.iter().find(|entry| entry.field.key() == key);
    has_key(name).or_else(|| has_key(&format!("dataset.{name}")))
}

fn possible_values(entry: &Entry) -> Vec<PossibleValue> {
    fn with_help<T: Choice>() -> Vec<PossibleValue> {
        T::ALL.iter().map(|value| PossibleValue::new(value.name()).help(value.help())).collect()
    }
    fn of_parts<T: PartKind + ?Sized>(names: &[&'static str]) -> Vec<PossibleValue> {
        let parts = Part::<T>::all();
        let part = |name| parts.iter().find(|part| part.name == name);
        names.iter().filter_map(|name| Some(PossibleValue::new(*name).help(part(*name)?.help))).collect()
    }
    match (entry.field.section, entry.field.name, entry.field.allowed) {
        ("", "method", _) => with_help::<MethodName>(),
        ("", "method_preset", _) => with_help::<MethodPreset>(),
        ("", "segmenter", Allowed::Names(names)) => of_parts::<dyn Segmenter>(names),
        ("", "poses", _) => with_help::<PoseMode>(),
        ("", "detail", _) => with_help::<Detail>(),
        ("", "rotate", _) => with_help::<Rotate>(),
        ("", "tracker", Allowed::Names(names)) => of_parts::<dyn Tracker>(names),
        ("dataset", "register_depth", _) => with_help::<DepthRegistration>(),
        (_, _, Allowed::Names(names)) => names.iter().map(|name| PossibleValue::new(*name)).collect(),
        _ => Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_value_of_register_depth_may_be_left_out_or_follow() {
        let parsed = |words: &str| {
            let words = ["splatseg", "run"].into_iter().chain(words.split(' ')).map(OsString::from).collect();
            match Arguments::parse(words) {
                Parsed::Arguments(arguments) => match arguments.command {
                    Command::Run(run) => (run.scene.display().to_string(), run.options.dataset.topics.register_depth),
                    _ => panic!("another command"),
                },
                _ => panic!("not parsed"),
            }
        };
        let of = |value: &str| ("SCENE".to_owned(), Some(value.to_owned()));
        assert_eq!(parsed("SCENE --out o"), ("SCENE".to_owned(), None));
        assert_eq!(parsed("--register-depth SCENE --out o"), of("true"));
        assert_eq!(parsed("SCENE --out o --register-depth"), of("true"));
        assert_eq!(parsed("--register-depth false SCENE --out o"), of("false"));
        assert_eq!(parsed("SCENE --register-depth=auto --out o"), of("auto"));
    }
}
