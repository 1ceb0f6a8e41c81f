//! Methods that give every object of an RGB-D video one lasting id.
//!
//! A [`Method`] takes a frame and the masks that a segmenter found in it, and returns the object that each pixel shows.
//!
//! - [`methods`]: [`FastSamSplat`] and [`Sam2Splat`] remember objects in a splat memory ([`splatseg_memory`]); the
//!   paper's baselines ([`FastSamBaseline`], [`FastSpamBaseline`], [`Sam2Baseline`]) have no map.
//! - [`matching`]: matches predicted with remembered segments, and paints overlapping masks with one id per pixel.
//! - [`trackers`]: follow prompted objects through the video. [`Sam2Tracker`] is SAM 2.1.
//! - [`reprompting`]: detects a tracker's errors with a memory and corrects them with clicks.

pub mod matching;
pub mod methods;
pub mod reprompting;
pub mod trackers;

mod error;

pub use error::TrackingError;
pub use matching::match_segments;
pub use methods::{
    FastSamBaseline, FastSamBaselineSettings, FastSamSplat, FastSamSplatSettings, FastSpamBaseline,
    FastSpamBaselineSettings, FrameOutput, Hindsight, Method, Sam2Baseline, Sam2BaselineSettings, Sam2Splat,
    Sam2SplatSettings, ShownFrame,
};
pub use reprompting::{
    Remedy, RepromptSettings, TrackError, TrackErrorCounts, TrackErrorKind, find_track_errors, sample_clicks,
};
pub use trackers::{PromptSource, Sam2Tracker, Sam2TrackerSettings, Tracker, TrackerError};

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
