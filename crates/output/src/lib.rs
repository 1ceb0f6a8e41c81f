//! What a run writes: id images, overlays, and what is made of all frames together.
//!
//! Each kind of result is a [`RunOutput`]. It is shown every frame with its result, in order, and at the end the memory.
//! Where files go is up to a [`ResultFolder`].

mod coco;
mod crops;
mod digits;
mod error;
mod mcap_file;
mod objects_file;
mod overlay;
mod page;
mod run_output;
mod segments;

pub use coco::CocoFile;
pub use error::{OutputError, write_atomically};
pub use mcap_file::McapFile;
pub use objects_file::ObjectsFile;
pub use overlay::{draw_overlay, segment_color, write_overlay_jpeg};
pub use page::Page;
pub use run_output::{FrameRecord, ResultFolder, RunEnd, RunOutput};
pub use segments::write_segments_png;

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
