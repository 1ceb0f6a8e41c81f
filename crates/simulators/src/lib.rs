//! Simulators for comparing methods without a network. They use the ground truth and make errors at given rates.
//!
//! - [`OracleSegmenter`] returns the true segments, with misses, splits, merges and displaced outlines.
//! - [`GroundTruthPrompts`] returns each true object once, in the frame where it appears, as a prompt for a tracker.
//! - [`SimTracker`] follows true objects, and loses, swaps and duplicates them, or lets their masks drift.
//! - [`SimDepthPredictor`] returns measured depth with the errors of a network that predicts it.
//!
//! All errors are drawn from a seed, see [`Chance`]. The real segmenters, trackers, methods and depth predictors do not depend on this
//! crate.

mod chance;
mod depth_predictor;
mod error;
mod ground_truth;
mod ground_truth_prompts;
mod oracle;
mod tracker;

pub use chance::{Chance, FrameChance, normal, poisson};
pub use depth_predictor::{SimDepthPredictor, SimDepthSettings};
pub use error::SimulatorError;
pub use ground_truth::{GroundTruthSource, SceneGroundTruth};
pub use ground_truth_prompts::GroundTruthPrompts;
pub use oracle::{OracleErrorModel, OraclePreset, OracleSegmenter, OracleSettings};
pub use tracker::{SimTracker, SimTrackerSettings};

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
