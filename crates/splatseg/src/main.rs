//! The `splatseg` command.

mod command;

use std::process::ExitCode;

fn main() -> ExitCode {
    match command::execute() {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            command::print_error_line(&format!("error: {failure}"));
            ExitCode::from(failure.exit_code())
        }
    }
}
