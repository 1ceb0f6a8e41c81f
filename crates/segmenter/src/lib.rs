//! Segmenters for splatseg: image and depth in, masks with scores out.
//!
//! A [`Segmenter`] sees one frame at a time and has no memory; ids that last are the business of the methods above it.
//!
//! - [`GraphSegmenter`] needs no weights: it cuts the image where depth, surface orientation and colour say that one
//!   object ends and another begins.
//! - [`FastSamSegmenter`] runs FastSAM, the segmenter of the paper, on weights that the user has.
//! - [`MaskFolder`] replays masks that any other model wrote to disk.
//! - [`OracleSegmenter`] knows the truth and errs at set rates, for comparing methods without a network.
//! - [`FirstAppearances`] gives each true object once, where it appears: ground-truth prompts for a tracker.

mod appearances;
pub mod chance;
mod error;
mod fastsam;
mod graph;
mod masks;
mod oracle;
mod prepared;

pub use appearances::FirstAppearances;
pub use error::SegmenterError;
pub use fastsam::FastSamSegmenter;
pub use graph::{BorderWeights, GraphSegmenter, GraphSettings, PatchSettings, SurfaceSettings};
pub use masks::MaskFolder;
pub use oracle::{
    GroundTruthSource, OracleErrorModel, OraclePreset, OracleSegmenter, OracleSettings, SceneGroundTruth,
};
pub use prepared::PreparedMasks;
pub use segmenter::Segmenter;

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
