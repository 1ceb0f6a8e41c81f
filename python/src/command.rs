//! The command `splatseg`.

use pyo3::prelude::*;
use std::ffi::OsString;

/// Does what the command `splatseg` does with these arguments, the first of which is its name; returns the exit code.
/// `program` is the command line that starts another such program.
#[pyfunction]
pub fn run_command(py: Python<'_>, arguments: Vec<OsString>, program: Vec<OsString>) -> u8 {
    py.detach(|| splatseg::command::main(arguments, program))
}
