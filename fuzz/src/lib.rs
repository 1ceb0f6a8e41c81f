//! Shared by the fuzz targets: small valid files of every format, and a folder for damaged copies.

#[cfg(feature = "maps")]
mod assistant;
#[cfg(feature = "maps")]
mod checkpoint;
#[cfg(feature = "maps")]
#[path = "../../crates/models/tests/it/checkpoint/files.rs"]
#[allow(dead_code)] // The tests use more of it.
pub mod files;
#[cfg(feature = "maps")]
#[path = "../../crates/models/tests/it/checkpoint/pickler.rs"]
#[allow(dead_code)] // The tests use more of it.
pub mod pickler;
mod place;
#[cfg(feature = "maps")]
#[path = "../../crates/memory/tests/it/ply/sample.rs"]
#[allow(dead_code)]
pub mod sample;
pub mod scenes;
#[path = "../../crates/dataset/tests/it/support/mod.rs"]
pub mod support;

#[cfg(feature = "maps")]
pub use assistant::assistant;
#[cfg(feature = "maps")]
pub use checkpoint::read_checkpoint;
pub use place::{Place, read_changed_scene, read_scene};

/// More memory than this for any input is a failure: the allocation fails, which ends the process.
const MEMORY_LIMIT: usize = 256 << 20;

#[global_allocator]
static ALLOCATOR: cap::Cap<std::alloc::System> = cap::Cap::new(std::alloc::System, MEMORY_LIMIT);
