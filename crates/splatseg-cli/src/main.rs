//! The `splatseg` command.

use std::process::ExitCode;

fn main() -> ExitCode {
    let program = std::env::current_exe().map(|path| vec![path.into_os_string()]).unwrap_or_default();
    ExitCode::from(splatseg_cli::main(std::env::args_os().collect(), program))
}
