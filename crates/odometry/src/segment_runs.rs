//! Segments of a keyframe, in little memory.

use serde::{Deserialize, Serialize};
use splatseg_geometry::{RemappedId, SegmentId, SegmentMap};

/// A segment map as runs of pixels with the same id, row-major: id and length.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct SegmentRuns(Vec<(SegmentId, u32)>);

impl SegmentRuns {
    pub(crate) fn new(segments: &SegmentMap) -> Self {
        Self(segments.pixels().chunk_by(|one, other| one == other).map(|run| (run[0], run.len() as u32)).collect())
    }

    /// Number of pixels.
    pub(crate) fn len(&self) -> u64 {
        self.0.iter().map(|(_, length)| u64::from(*length)).sum()
    }

    /// The id of each pixel, row-major.
    pub(crate) fn to_ids(&self) -> Vec<SegmentId> {
        self.0.iter().flat_map(|(id, length)| std::iter::repeat_n(*id, *length as usize)).collect()
    }

    /// Replaces ids that turned out to be the same object.
    pub(crate) fn remap(&mut self, remapped: &[RemappedId]) {
        for RemappedId { from, into } in remapped {
            self.0.iter_mut().filter(|(id, _)| id == from).for_each(|(id, _)| *id = *into);
        }
    }
}
