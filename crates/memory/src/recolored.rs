//! Remembered segments whose place has other colours than it had: flat things that were taken away, which depth does not
//! show.

use crate::{MemoryError, Recall, SplatMemory};
use splatseg_geometry::SegmentId;
use std::collections::{BTreeMap, BTreeSet};

/// Colours differ if a channel does by more than this.
const MIN_DIFFERENCE: u8 = 40;

/// A segment has other colours if this share of its visible Gaussians has.
const MIN_SHARE: f32 = 0.75;

impl SplatMemory {
    /// The expected segments at most of whose visible Gaussians the frame has another colour than they have.
    ///
    /// # Errors
    /// If the map's device fails.
    pub fn recolored(&self, recall: &Recall<'_>) -> Result<BTreeSet<SegmentId>, MemoryError> {
        let (expected, image) = (recall.expected().segments.pixels(), recall.frame().color().pixels());
        let colors = self.colors();
        // Visible Gaussians by segment, and those of another colour.
        let mut counts: BTreeMap<SegmentId, (usize, usize)> = BTreeMap::new();
        for visible in self.backend.visible_gaussians(recall)? {
            let Some(pixel) = visible.seen_at else { continue };
            let Some(color) = colors.get(visible.gaussian as usize) else { continue };
            let (all, other) = counts.entry(expected[pixel as usize]).or_default();
            *all += 1;
            let mut channels = color.iter().zip(image[pixel as usize]);
            *other += usize::from(channels.any(|(one, other)| one.abs_diff(other) > MIN_DIFFERENCE));
        }
        let is_recolored = |(_, (all, other)): &(SegmentId, (usize, usize))| *other as f32 >= MIN_SHARE * *all as f32;
        Ok(counts.into_iter().filter(is_recolored).map(|(id, _)| id).collect())
    }
}
