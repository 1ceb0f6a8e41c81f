//! Segmenters for splatseg: image and depth in, masks with scores out.
//!
//! A [`Segmenter`] sees one frame at a time and has no memory; ids that last are the business of the methods above it.
//!
//! - [`GraphSegmenter`] needs no weights: it cuts the image where depth, surface orientation and colour say that one
//!   object ends and another begins.
//! - [`MaskFolder`] replays masks that any other model wrote to disk.

mod error;
mod graph;
mod masks;
mod segmenter;

pub use error::SegmenterError;
pub use graph::{BorderWeights, GraphSegmenter, GraphSettings, PatchSettings, SurfaceSettings};
pub use masks::{FrameTransform, MaskFolder};
pub use segmenter::Segmenter;
