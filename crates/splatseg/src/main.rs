//! The `splatseg` command.

mod command;

use command::{Arguments, Failure};
use std::process::ExitCode;

fn main() -> ExitCode {
    let arguments = Arguments::from_command_line();
    command::start_log();
    match command::execute(arguments) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("error: {failure}");
            match failure {
                Failure::Input(_) => ExitCode::from(2),
                Failure::Work(_) => ExitCode::from(1),
                // What shells report for a program ended by Ctrl-C.
                Failure::Interrupted(_) => ExitCode::from(130),
            }
        }
    }
}
