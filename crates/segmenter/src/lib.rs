//! Segmenters for splatseg: image and depth in, masks with scores out.
//!
//! A [`Segmenter`] sees one frame at a time and has no memory; ids that last are the business of the methods above it.
//!
//! - [`GraphSegmenter`] needs no weights: it cuts the image where depth, surface orientation and colour say that one
//!   object ends and another begins.
//! - [`AffinitySegmenter`] has learned from rendered rooms which pixels belong to the same object; its weights are built
//!   in.
//! - [`FastSamSegmenter`] runs FastSAM, the segmenter of the paper, on weights that the user has.
//! - [`MaskFolder`] replays masks that any other model wrote to disk.

mod affinity;
mod error;
mod fastsam;
mod graph;
mod masks;

pub use affinity::{AffinityNetwork, AffinitySegmenter, AffinitySettings, AffinityWeightsError, MergeTree, Partition};
pub use error::SegmenterError;
pub use fastsam::FastSamSegmenter;
pub use graph::{BorderWeights, GraphSegmenter, GraphSettings, PatchSettings, SurfaceSettings};
pub use masks::MaskFolder;

use splatseg_geometry::{RgbdFrame, ScoredMask};

/// Finds the segments of single frames.
///
/// A segmenter of your own implements this trait and reports its own errors as [`SegmenterError::Other`].
pub trait Segmenter: Send {
    /// A short name for tables and summaries, e.g. `graph`.
    fn name(&self) -> &str;

    /// The segments of `frame`: masks of the frame's size, which may overlap, in any order. Empty masks are left out,
    /// so a frame in which nothing was found gives an empty list.
    ///
    /// # Errors
    /// [`SegmenterError`] says why the frame could not be segmented.
    fn segment(&mut self, frame: &RgbdFrame) -> Result<Vec<ScoredMask>, SegmenterError>;
}

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
