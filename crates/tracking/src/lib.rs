//! Methods that give every object of an RGB-D video one lasting id.
//!
//! [`FastSamSplat`] reads like the list in the paper: what the memory expects ([`splatseg_memory`]) is matched with
//! what a segmenter sees ([`match_segments`]), and the memory fuses both and takes in what was seen.
//!
//! [`Sam2Splat`] has a [`Tracker`] below it, whose errors the memory sees ([`find_track_errors`]) and clicks put right
//! ([`sample_clicks`]). Trackers are SAM 2.1 ([`Sam2Tracker`]) and one that knows the truth and errs at set rates
//! ([`SimTracker`]).
//!
//! The paper's baselines stand beside them: [`FastSam`] knows the frame before and nothing else, [`FastSpam`] a point of
//! every segment, [`Sam2Baseline`] what its tracker remembers.

mod clicks;
mod detections;
mod distance;
mod error;
mod explained;
mod fastsam;
mod fastsam_splat;
mod fastspam;
mod matching;
mod method;
mod output;
mod painting;
mod reprompt;
mod sam2_baseline;
mod sam2_splat;
mod sam2_tracker;
mod segment_ids;
mod sim_tracker;
mod stage_times;
mod track_errors;
mod track_masks;
mod tracker;

use method::check_sizes;

pub use clicks::sample_clicks;
pub use detections::{NewObjectSettings, PromptSource};
pub use error::TrackingError;
pub use explained::ExplanationSettings;
pub use fastsam::{FastSam, FastSamSettings};
pub use fastsam_splat::{FastSamSplat, FastSamSplatSettings};
pub use fastspam::{FastSpam, FastSpamSettings};
pub use matching::match_segments;
pub use method::Method;
pub use output::FrameOutput;
pub use reprompt::RepromptSettings;
pub use sam2_baseline::Sam2Baseline;
pub use sam2_splat::{Sam2Splat, Sam2SplatSettings};
pub use sam2_tracker::{Sam2Tracker, Sam2TrackerSettings};
pub use sim_tracker::{SimTracker, SimTrackerSettings};
pub use stage_times::StageTimes;
pub use track_errors::{Remedy, TrackError, TrackErrorCounts, TrackErrorKind, find_track_errors};
pub use tracker::{Tracker, TrackerError};

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
