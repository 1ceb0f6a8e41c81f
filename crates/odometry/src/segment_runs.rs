//! Segments of a keyframe, in little memory.

use splatseg_geometry::{RemappedId, SegmentId, SegmentMap};

/// A segment map as runs of pixels with the same id, row-major: id and length.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct SegmentRuns(Vec<(SegmentId, u32)>);

impl SegmentRuns {
    pub(crate) fn new(segments: &SegmentMap) -> Self {
        Self(segments.pixels().chunk_by(|one, other| one == other).map(|run| (run[0], run.len() as u32)).collect())
    }

    pub(crate) fn from_runs(runs: Vec<(SegmentId, u32)>) -> Self {
        Self(runs)
    }

    /// Id and length of each run.
    pub(crate) fn runs(&self) -> &[(SegmentId, u32)] {
        &self.0
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
