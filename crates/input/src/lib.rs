//! Reading of untrusted input.
//!
//! Every file that a scene, a checkpoint or a folder of masks consists of is opened by [`open_file`] or [`read_file`]:
//! only regular files, so that no FIFO blocks the program and no device is read without end. What a file claims to hold
//! is checked against the [`MemoryLimit`] before memory is taken for it.

mod file;
mod memory_limit;

pub use file::{open_file, read_file};
pub use memory_limit::{ByteSizeTextError, MemoryLimit, display_bytes};
