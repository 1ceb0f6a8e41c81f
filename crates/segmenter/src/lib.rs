//! Segmenters for splatseg: image and depth in, masks with scores out.
//!
//! A [`Segmenter`] works on one frame at a time and keeps no memory. The methods built on it assign persistent ids.
//!
//! - [`GraphSegmenter`] needs no weights. It cuts the image where depth, surface orientation and colour indicate an
//!   object boundary.
//! - [`AffinitySegmenter`] predicts which pixels belong to the same object. It was trained on rendered rooms and its
//!   weights are built in.
//! - [`FastSamSegmenter`] runs FastSAM, the segmenter of the paper, with weights supplied by the user.
//! - [`MaskFolder`] replays masks that another model wrote to disk.

mod affinity;
mod detail;
mod error;
mod fastsam;
mod graph;
mod masks;

pub use affinity::{
    AffinityNetwork, AffinitySegmenter, AffinitySettings, AffinityWeights, AffinityWeightsError, MergeTree, Partition,
};
pub use detail::Detail;
pub use error::SegmenterError;
pub use fastsam::FastSamSegmenter;
pub use graph::{BorderWeights, GraphSegmenter, GraphSettings, PatchSettings, SurfaceSettings};
pub use masks::MaskFolder;

use splatseg_geometry::{CameraFrame, Segmentation};

/// Segments single frames.
///
/// To add your own segmenter, implement this trait and report its errors as [`SegmenterError::Other`].
pub trait Segmenter: Send {
    /// A short name for tables and summaries, e.g. `graph`.
    fn name(&self) -> &str;

    /// True if it segments upright images better than turned ones. Then frames of a camera that is held sideways or upside
    /// down are turned for it, and what it finds is turned back. False if not implemented.
    fn prefers_upright(&self) -> bool {
        false
    }

    /// True if it segments large frames better than reduced ones. If not, frames of more pixels than `working_pixels` are
    /// reduced for it. True if not implemented.
    fn needs_all_pixels(&self) -> bool {
        true
    }

    /// How finely it segments frames. `None` if that cannot be chosen, and if not implemented.
    fn detail(&self) -> Option<Detail> {
        None
    }

    /// Chooses how finely later frames are segmented. Does nothing if [`Self::detail`] is `None`.
    fn set_detail(&mut self, _detail: Detail) {}

    /// Returns the segments of `frame`. Empty masks are left out, so the list is empty if nothing was found. A segmenter that
    /// knows only masks returns `masks.into()`.
    ///
    /// # Errors
    /// [`SegmenterError`] if the frame cannot be segmented.
    fn segment(&mut self, frame: &CameraFrame) -> Result<Segmentation, SegmenterError>;
}

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
