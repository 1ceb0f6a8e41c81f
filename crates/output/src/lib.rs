//! Outputs of a run: id images, overlays, and files about the whole run.
//!
//! Each kind of result is a [`RunOutput`]. It receives every frame with its result, in order, and at the end the
//! memory. A [`ResultFolder`] decides where the files go.

mod coco;
mod crops;
mod error;
mod glyphs;
mod mcap_file;
mod objects_file;
mod overlay;
mod page;
mod poses_file;
pub mod ros_messages;
mod run_output;

pub use coco::CocoFile;
pub use error::{OutputError, write_atomically, write_unsynced};
pub use glyphs::{GLYPH_HEIGHT, text_pixels, text_width};
pub use mcap_file::{Compression, McapFile, SceneCounts, SceneRecording, StreamRecording, StreamRecordingError};
pub use objects_file::ObjectsFile;
pub use overlay::{draw_overlay, segment_color, write_overlay_jpeg};
pub use page::{ComparedIds, MapData, Page, PlanData, VIEWER_SCRIPT, encode_ids, live_page, map_data};
pub use poses_file::PosesFile;
pub use run_output::{ChangesSince, FrameRecord, ResultFolder, RunEnd, RunOutput, UpdatedFrame};

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
