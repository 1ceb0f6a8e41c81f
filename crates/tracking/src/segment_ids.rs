//! Ids in the order in which segments appear.

use crate::TrackingError;
use splatseg_geometry::SegmentId;

/// Gives ids 1, 2, 3, … to new segments.
#[derive(Clone, Debug, Default)]
pub(crate) struct SegmentIds {
    last: SegmentId,
}

impl SegmentIds {
    /// An id that was never given before.
    pub(crate) fn new_segment(&mut self) -> Result<SegmentId, TrackingError> {
        self.last = self.last.checked_add(1).ok_or(TrackingError::OutOfIds)?;
        Ok(self.last)
    }
}
