//! The `splatseg` command.

/// Prints a line for the user. A closed standard output (`splatseg … | head`) is not an error.
macro_rules! say {
    ($($text:tt)*) => {{
        use std::io::Write as _;
        let _ = writeln!(std::io::stdout(), $($text)*);
    }};
}

mod arguments;
mod bench;
mod demo;
mod eval;
mod failure;
mod inspect;
mod options;
mod output_folder;
mod result_writer;
mod run;
mod settings;

pub use arguments::Arguments;
pub use failure::Failure;

use arguments::Command;

/// Executes the command line.
pub fn execute(arguments: Arguments) -> Result<(), Failure> {
    match arguments.command {
        Command::Demo(demo) => demo::demo(&demo),
        Command::Run(run) => run::run(&run),
        Command::Eval(eval) => eval::eval(&eval),
        Command::Bench(bench) => bench::bench(&bench),
        Command::Inspect(inspect) => inspect::inspect(&inspect),
        Command::Settings(arguments) => settings::settings(&arguments),
    }
}

/// Starts logging: warnings go to standard error, and `RUST_LOG` selects more or less.
pub fn start_log() {
    use tracing_subscriber::EnvFilter;
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new("warn"));
    tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(std::io::stderr)
        .without_time()
        .with_target(false)
        .init();
}
