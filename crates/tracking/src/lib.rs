//! Methods that give every object of an RGB-D video one lasting id.
//!
//! [`FastSamSplat`] reads like the list in the paper: what the memory expects ([`splatseg_memory`]) is matched with
//! what a segmenter sees ([`match_segments`]), both are fused ([`fuse`]), and the memory learns the result.
//!
//! The paper's baselines stand beside it: [`FastSam`] knows the frame before and nothing else, [`FastSpam`] a point of
//! every segment.

mod error;
mod fastsam;
mod fastsam_splat;
mod fastspam;
mod fusion;
mod matching;
mod method;
mod output;
mod painting;
mod segment_ids;
mod stage_times;

use method::check_sizes;

pub use error::TrackingError;
pub use fastsam::{FastSam, FastSamSettings};
pub use fastsam_splat::{FastSamSplat, FastSamSplatSettings};
pub use fastspam::{FastSpam, FastSpamSettings};
pub use fusion::fuse;
pub use matching::{match_masks, match_segments};
pub use method::Method;
pub use output::FrameOutput;
pub use stage_times::StageTimes;
