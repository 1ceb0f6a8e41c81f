//! Methods that give every object of an RGB-D video one lasting id.
//!
//! A [`Method`] takes a frame and the masks that a segmenter found in it, and says which object each pixel shows.
//!
//! - [`methods`]: [`FastSamSplat`] and [`Sam2Splat`] remember objects in a splat memory ([`splatseg_memory`]); the
//!   paper's baselines ([`FastSamBaseline`], [`FastSpamBaseline`], [`Sam2Baseline`]) have no map.
//! - [`matching`]: which predicted segment is which remembered one, and one id per pixel from overlapping masks.
//! - [`trackers`]: what follows a prompted object through the video. [`Sam2Tracker`] is SAM 2.1.
//! - [`reprompting`]: the errors of a tracker that a memory sees, and the clicks that correct them.

pub mod matching;
pub mod methods;
pub mod reprompting;
pub mod trackers;

mod error;

pub use error::TrackingError;
pub use matching::match_segments;
pub use methods::{
    ExplanationSettings, FastSamBaseline, FastSamBaselineSettings, FastSamSplat, FastSamSplatSettings,
    FastSpamBaseline, FastSpamBaselineSettings, FrameOutput, Method, Sam2Baseline, Sam2BaselineSettings, Sam2Splat,
    Sam2SplatSettings,
};
pub use reprompting::{
    Remedy, RepromptSettings, TrackError, TrackErrorCounts, TrackErrorKind, find_track_errors, sample_clicks,
};
pub use trackers::{PromptSource, Sam2Tracker, Sam2TrackerSettings, Tracker, TrackerError};

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
