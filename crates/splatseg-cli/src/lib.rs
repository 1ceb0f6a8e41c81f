//! The `splatseg` command: the binary and the Python package both call [`main`].

#[macro_use]
mod terminal;

mod arguments;
mod batch;
mod bench;
mod browser;
mod completions;
mod convert;
mod default_out;
mod demo;
mod devices;
mod eval;
mod eval_mesh;
mod eval_page;
mod eval_trajectory;
mod export;
mod export_mesh;
mod export_plan;
mod export_scene_graph;
mod failure;
mod file_kind;
mod find;
mod help_layout;
mod input_paths;
mod inspect;
mod live;
mod locate;
mod log_line;
mod manifest;
#[cfg(feature = "man")]
mod manual;
mod map_changes;
#[cfg(feature = "mcp")]
mod mcp;
#[cfg(not(feature = "mcp"))]
#[path = "without_mcp.rs"]
mod mcp;
mod merge;
mod name;
mod options;
mod output_folder;
mod route;
mod run;
mod settings;
mod system_limits;

use arguments::{Arguments, Command, Parsed};
use failure::Failure;
use log_line::LogLine;
use std::ffi::OsString;
use system_limits::{check_environment, survive_file_size_limit, use_threads};

/// Executes a command line, which starts with the program's name. The process must be used for this command only.
/// Returns the exit code: 0 done, 1 failed, 2 invalid usage or input, 130, 143 or 129 interrupted by a signal.
///
/// `program` is the start of a command line that runs this function in another process.
pub fn main(arguments: Vec<OsString>, program: Vec<OsString>) -> u8 {
    match execute(arguments, &program) {
        Ok(code) => code,
        Err(failure) => {
            terminal::print_error_line(&format!("error: {failure}"));
            failure.exit_code()
        }
    }
}

fn execute(arguments: Vec<OsString>, program: &[OsString]) -> Result<u8, Failure> {
    let arguments = match Arguments::parse(arguments) {
        Parsed::Arguments(arguments) => arguments,
        Parsed::Help => return terminal::check_output().map(|()| 0),
        Parsed::Wrong { code } => return Ok(code),
    };
    if arguments.quiet {
        terminal::be_quiet();
    }
    start_log();
    survive_file_size_limit();
    check_environment()?;
    if arguments.command.has_fixed_threads() {
        use_threads(0)?;
    }
    match arguments.command {
        Command::Demo(demo) => demo::demo(&demo),
        Command::Run(run) => run::run(&run, program),
        Command::Eval(eval) => eval::eval(&eval),
        Command::Bench(bench) => bench::bench(&bench, program),
        Command::Batch(batch) => batch::batch(&batch, program),
        Command::BatchWorker => batch::work(),
        Command::Inspect(inspect) => inspect::inspect(&inspect),
        Command::Convert(convert) => convert::convert(&convert),
        Command::Export(export) => export::export(&export),
        Command::Diff(diff) => map_changes::diff(&diff),
        Command::Merge(merge) => merge::merge(&merge),
        Command::Find(find) => find::find(&find),
        Command::Route(route) => route::route(&route),
        Command::Name(name) => name::name(&name),
        Command::Mcp(mcp) => mcp::mcp(&mcp),
        Command::Live(live) => live::live(&live, program),
        Command::Ros2(ros2) => live::ros2::ros2(&ros2, program),
        Command::Locate(locate) => locate::locate(&locate),
        Command::Devices(arguments) => devices::devices(&arguments, program),
        Command::Settings(arguments) => settings::settings(&arguments),
        Command::Completions(arguments) => completions::completions(&arguments),
        #[cfg(feature = "man")]
        Command::Man(arguments) => manual::man(&arguments),
    }?;
    terminal::check_output().map(|()| 0)
}

/// Starts logging to standard error. `RUST_LOG` selects the messages; by default, warnings.
fn start_log() {
    use tracing_subscriber::EnvFilter;
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new("warn"));
    tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(|| terminal::LogOutput)
        // Colours are control sequences, which would be escaped.
        .with_ansi(false)
        .event_format(LogLine(tracing_subscriber::fmt::format().without_time().with_target(false)))
        .try_init()
        // A program that uses the library may have its own logger.
        .ok();
}
