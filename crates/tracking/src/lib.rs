//! Methods that give every object of an RGB-D video one lasting id.
//!
//! [`FastSamSplat`] reads like the list in the paper: what the memory expects ([`splatseg_memory`]) is matched with
//! what a segmenter sees ([`match_segments`]), both are fused ([`fuse`]), and the memory learns the result.

mod error;
mod fastsam_splat;
mod fusion;
mod matching;
mod method;
mod output;
mod stage_times;

pub use error::TrackingError;
pub use fastsam_splat::{FastSamSplat, FastSamSplatSettings};
pub use fusion::fuse;
pub use matching::match_segments;
pub use method::Method;
pub use output::FrameOutput;
pub use stage_times::StageTimes;
