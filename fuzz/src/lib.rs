//! Shared by the fuzz targets: small valid files of every format, and a folder for damaged copies.

mod assistant;
mod checkpoint;
#[path = "../../crates/models/tests/it/checkpoint/files.rs"]
#[allow(dead_code)] // The tests use more of it.
pub mod files;
#[path = "../../crates/models/tests/it/checkpoint/pickler.rs"]
#[allow(dead_code)] // The tests use more of it.
pub mod pickler;
mod place;
#[path = "../../crates/memory/tests/it/ply/sample.rs"]
#[allow(dead_code)]
pub mod sample;
pub mod scenes;
#[path = "../../crates/dataset/tests/it/support/mod.rs"]
pub mod support;

pub use assistant::assistant;
pub use checkpoint::read_checkpoint;
pub use place::{Place, read_scene};

/// More memory than this for any input is a failure: the allocation fails, which ends the process.
const MEMORY_LIMIT: usize = 256 << 20;

#[global_allocator]
static ALLOCATOR: cap::Cap<std::alloc::System> = cap::Cap::new(std::alloc::System, MEMORY_LIMIT);
