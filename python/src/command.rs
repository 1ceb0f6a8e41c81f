//! The command `splatseg`.

use pyo3::prelude::*;
use std::ffi::OsString;

/// Runs the command `splatseg` with these arguments, the first of which is its name, and returns the exit code.
/// `program` is the command line that starts another process of the command.
#[pyfunction]
pub fn run_command(py: Python<'_>, arguments: Vec<OsString>, program: Vec<OsString>) -> u8 {
    py.detach(|| splatseg_cli::main(arguments, program))
}
