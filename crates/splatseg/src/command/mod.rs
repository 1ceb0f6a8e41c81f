//! The `splatseg` command.

#[macro_use]
mod terminal;

mod arguments;
mod bench;
mod demo;
mod eval;
mod export;
mod failure;
mod input_paths;
mod inspect;
mod manifest;
mod options;
mod output_folder;
mod run;
mod settings;

pub use failure::Failure;
pub use terminal::print_error_line;

use arguments::{Arguments, Command};

/// Executes the command line of this process.
pub fn execute() -> Result<(), Failure> {
    let Some(arguments) = Arguments::from_command_line() else {
        return terminal::check_output();
    };
    start_log();
    match arguments.command {
        Command::Demo(demo) => demo::demo(&demo),
        Command::Run(run) => run::run(&run),
        Command::Eval(eval) => eval::eval(&eval),
        Command::Bench(bench) => bench::bench(&bench),
        Command::Inspect(inspect) => inspect::inspect(&inspect),
        Command::Export(export) => export::export(&export),
        Command::Settings(arguments) => settings::settings(&arguments),
    }?;
    terminal::check_output()
}

/// Starts logging: warnings go to standard error, and `RUST_LOG` selects more or less.
fn start_log() {
    use tracing_subscriber::EnvFilter;
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new("warn"));
    tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(|| terminal::EscapedStderr)
        // Colours are control characters, which would be escaped.
        .with_ansi(false)
        .without_time()
        .with_target(false)
        .init();
}
