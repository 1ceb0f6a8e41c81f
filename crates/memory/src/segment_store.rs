//! What a memory must do with segments: the one thing in which the kinds of memory differ.

use crate::map::NewGaussian;
use crate::ply::SplatContentView;
use crate::recall::{Recall, TileSurface};
use crate::{LearningExtent, MemoryError, SegmentHold};
use splatseg_geometry::{SegmentId, SegmentMap};
use splatseg_render::{Splats, TileWeights};

/// What a store reads off one tile of a view: buffers are `[16, 16]`, row-major.
#[derive(Clone, Debug, Default)]
pub struct StoreTile {
    /// The segment expected at every pixel, 0 for none.
    pub segments: Vec<SegmentId>,
    /// How sure that is; 1 is what a fresh observation has.
    pub confidence: Vec<f32>,
    /// Ids that `values` are about, for stores that need to know.
    pub ids: Vec<SegmentId>,
    /// The store's own notes for the rest of the frame.
    pub values: Vec<f32>,
}

/// What Gaussians remember of segments, one entry per Gaussian of the map: read off a view, brought together with what
/// the frame shows, and updated by it.
///
/// For every frame: [`read_tile`](Self::read_tile) for each tile, [`fuse`](Self::fuse), then [`grow`](Self::grow) and
/// [`learn`](Self::learn). `seen` is always the frame's predictions: the id of the one that is visible at each pixel, 0
/// where there is none, [`ABSTAIN`](crate::ABSTAIN) where the one that is there has no say.
///
/// A kind of memory of your own implements this trait; [`SplatMemory::with_store`](crate::SplatMemory::with_store) makes
/// a memory of it.
pub trait SegmentStore: std::fmt::Debug + Send + Sync {
    /// Reads the expected segments off a tile (docs/METHOD.md, "FastSAM-Splat").
    fn read_tile(&self, tile: &TileWeights, surface: &TileSurface) -> StoreTile;

    /// What the frame shows once memory and predictions are brought together.
    fn fuse(&self, recall: &Recall<'_>, seen: &SegmentMap) -> SegmentMap;

    /// Appends what newly grown Gaussians know of segments.
    fn grow(&mut self, added: &[NewGaussian], recall: &Recall<'_>, seen: &SegmentMap);

    /// Takes in what the frame shows `map` has its new Gaussians already.
    fn learn(&mut self, recall: &mut Recall<'_>, map: &dyn Splats, seen: &SegmentMap) -> LearningExtent;

    /// Makes some Gaussians surer of a segment than of all others together.
    fn favour(&mut self, _gaussians: &[u32], _id: SegmentId) {}

    /// Keeps the Gaussians for which `keep` holds, in their order.
    fn retain(&mut self, keep: &[bool]);

    /// Prepares for a segment id that is given to a new thing. Ids may be given again, see
    /// [`SplatMemory::new_segment`](crate::SplatMemory::new_segment).
    ///
    /// # Errors
    /// If there is no room for it; [`MemoryError::Other`] for errors of your own.
    fn new_segment(&mut self, id: SegmentId) -> Result<(), MemoryError>;

    /// The segment that each Gaussian shows by itself, 0 for none.
    fn segment_ids(&self) -> Vec<SegmentId>;

    /// How undisputed each entry of [`segment_ids`](Self::segment_ids) is: the share, 0 to 1, that the segment has of all
    /// that the Gaussian was seen as. `None`, the default, for a kind of memory that keeps no second opinion.
    fn segment_shares(&self) -> Option<Vec<f32>> {
        None
    }

    /// The ids whose hold may have changed since the last call, and how Gaussians hold them now. The first call after a
    /// memory was loaded returns all. `None`, the default, for a kind of memory that does not count: then ids are held
    /// that [`segment_ids`](Self::segment_ids) has, which takes time in proportion to the map.
    fn changed_holds(&mut self) -> Option<Vec<(SegmentId, SegmentHold)>> {
        None
    }

    /// Numbers that each Gaussian holds for segments.
    fn numbers_per_gaussian(&self) -> usize;

    /// All that it remembers, to be saved. `None`, the default, for a kind of memory that has no file format.
    fn content(&self) -> Option<SplatContentView<'_>> {
        None
    }
}
