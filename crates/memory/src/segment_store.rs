//! Storage of segments in the Gaussians, and the rules that come with it: all in which the kinds of memory differ.

use crate::map::NewGaussian;
use crate::ply::SplatContentView;
use crate::recall::{Recall, StoreTile};
use crate::tile_surface::TileSurface;
use crate::{MemoryError, MemoryRules, SegmentHold};
use splatseg_geometry::{SegmentId, SegmentMap};
use splatseg_render::{Splats, TileWeights};
use std::collections::{BTreeMap, BTreeSet};

/// How much learning a frame changed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LearningStats {
    /// Pixels in the loss.
    pub active_pixels: usize,
    /// Gaussians whose features could change.
    pub active_gaussians: usize,
}

/// The object of a Gaussian according to the evidence of all frames; see
/// [`SplatMemory::decide_objects`](crate::SplatMemory::decide_objects).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Verdict {
    /// The object; 0 for none.
    pub id: SegmentId,
    /// How many votes it counts.
    pub votes: f32,
}

/// The segments that Gaussians remember, one entry per Gaussian of the map: read from a view, fused with the frame's
/// predictions, and updated from them.
///
/// For every frame: [`read_tile`](Self::read_tile) for each tile, [`fuse`](Self::fuse), then [`grow`](Self::grow) and
/// [`learn`](Self::learn). `predicted` always contains the id of the frame's prediction visible at each pixel,
/// `[height, width]`, 0 for none. `contradicted` contains the ids of the predictions that the memory contradicts.
///
/// Implement this trait for a kind of memory of your own, and create the memory with
/// [`SplatMemory::with_store`](crate::SplatMemory::with_store), or register the kind with
/// [`register_memory_kind`](crate::register_memory_kind), so that `memory.kind` chooses it.
pub trait SegmentStore: std::fmt::Debug + Send + Sync {
    /// Returns what this kind of memory asks of the map and of the methods; called once.
    fn rules(&self) -> MemoryRules {
        MemoryRules::default()
    }

    /// Reads the expected segments of a tile (docs/PAPER.md, "FastSAM-Splat").
    fn read_tile(&self, tile: &TileWeights, surface: &TileSurface) -> StoreTile;

    /// As [`read_tile`](Self::read_tile), with verdicts as further votes: one for each Gaussian of the map, or none at all.
    /// The default ignores them.
    fn read_tile_with(&self, tile: &TileWeights, surface: &TileSurface, _verdicts: &[Verdict]) -> StoreTile {
        self.read_tile(tile, surface)
    }

    /// Returns the frame's segments, `[height, width]`: the expected segments combined with the predictions.
    fn fuse(&self, recall: &Recall<'_>, predicted: &SegmentMap) -> SegmentMap;

    /// Returns the most likely segment after the expected one at each pixel, 0 for none. The default returns 0
    /// everywhere, for a kind of memory without a second opinion.
    fn second_opinion(&self, recall: &Recall<'_>) -> SegmentMap {
        SegmentMap::filled(recall.frame.width(), recall.frame.height(), 0)
    }

    /// Appends entries for new Gaussians.
    fn grow(
        &mut self,
        added: &[NewGaussian],
        recall: &Recall<'_>,
        predicted: &SegmentMap,
        contradicted: &BTreeSet<SegmentId>,
    );

    /// Makes Gaussians those of another segment: their indices and its id. The default does nothing.
    fn replace(&mut self, _replaced: &[(usize, SegmentId)]) {}

    /// Learns the frame's predictions. `map` already contains the new Gaussians.
    fn learn(
        &mut self,
        recall: &Recall<'_>,
        map: &dyn Splats,
        predicted: &SegmentMap,
        contradicted: &BTreeSet<SegmentId>,
    ) -> LearningStats;

    /// Keeps the Gaussians for which `keep` is true, in their order.
    fn retain(&mut self, keep: &[bool]);

    /// Prepares for a segment id that is given to a new object. Ids may be reused, see
    /// [`SplatMemory::new_segment`](crate::SplatMemory::new_segment).
    ///
    /// # Errors
    /// If there is no room for the id. Return your own errors as [`MemoryError::Other`].
    fn new_segment(&mut self, id: SegmentId) -> Result<(), MemoryError>;

    /// Returns the segment that each Gaussian shows by itself, 0 for none.
    fn segment_ids(&self) -> Vec<SegmentId>;

    /// As [`segment_ids`](Self::segment_ids), with verdicts as in [`read_tile_with`](Self::read_tile_with).
    fn segment_ids_with(&self, _verdicts: &[Verdict]) -> Vec<SegmentId> {
        self.segment_ids()
    }

    /// Returns how undisputed each entry of [`segment_ids_with`](Self::segment_ids_with) is: the share, 0 to 1, of the
    /// Gaussian's votes that are for the segment. The default returns `None`, for a kind of memory without a second opinion.
    fn segment_shares(&self, _verdicts: &[Verdict]) -> Option<Vec<f32>> {
        None
    }

    /// Returns how often each Gaussian was seen as its entry of [`segment_ids_with`](Self::segment_ids_with), in frames, up to
    /// a maximum. The default returns `None`, for a kind of memory that does not count.
    fn segment_votes(&self, _verdicts: &[Verdict]) -> Option<Vec<f32>> {
        None
    }

    /// Returns the confidence of each entry of [`segment_ids_with`](Self::segment_ids_with), see
    /// [`MapGaussian::confidence`](splatseg_geometry::MapGaussian::confidence). The default takes it from
    /// [`content_with`](Self::content_with).
    fn segment_confidences(&self, verdicts: &[Verdict]) -> Option<Vec<f32>> {
        let content = self.content_with(verdicts)?;
        let ids = self.segment_ids_with(verdicts).into_iter().enumerate();
        Some(ids.map(|(index, id)| content.confidence(index, id)).collect())
    }

    /// Returns the ids whose hold may have changed since the last call, and how Gaussians hold them now. The first call
    /// after a memory was loaded returns all ids. The default returns `None`, for a kind of memory that does not count
    /// holders: then the ids in [`segment_ids`](Self::segment_ids) are held, which takes time proportional to the map.
    fn changed_holds(&mut self) -> Option<Vec<(SegmentId, SegmentHold)>> {
        None
    }

    /// True if ids can be renamed and replaced, and Gaussians absorbed. The default is false, and then the three methods
    /// for that are never called.
    fn can_remap(&self) -> bool {
        false
    }

    /// Replaces ids, `names[old] = new`: the new id gets the votes of the old one.
    fn remap(&mut self, _names: &BTreeMap<SegmentId, SegmentId>) {}

    /// Counts verdicts as votes for good, one for each Gaussian.
    fn count_verdicts(&mut self, _verdicts: &[Verdict]) {}

    /// Adds what Gaussian `from` remembers to Gaussian `into`. `from` is removed afterwards.
    fn merge_gaussian(&mut self, _from: usize, _into: usize) {}

    /// Appends the Gaussians of another map with what they remember. Returns false, and changes nothing, if it is of another
    /// kind. The default returns false.
    fn append(&mut self, _content: SplatContentView<'_>) -> bool {
        false
    }

    /// Number of parameters per Gaussian for segments.
    fn numbers_per_gaussian(&self) -> usize;

    /// Returns the whole content, to be saved: votes or features, or arrays of any form that the kind's
    /// [`restore`](crate::MemoryKindDefinition::restore) reads. The default returns `None`, for a kind of memory without a
    /// file format.
    fn content(&self) -> Option<SplatContentView<'_>> {
        None
    }

    /// As [`content`](Self::content), with verdicts counted as votes. The default ignores them.
    fn content_with(&self, _verdicts: &[Verdict]) -> Option<SplatContentView<'_>> {
        self.content()
    }
}
