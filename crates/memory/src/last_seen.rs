//! When objects were last seen.

use crate::SplatMemory;
use splatseg_geometry::SegmentId;
use std::collections::BTreeMap;

impl SplatMemory {
    /// The last frame that saw each object with Gaussians, counted from 0 over all runs of the map.
    pub fn last_seen(&self) -> BTreeMap<SegmentId, u32> {
        let mut found = BTreeMap::new();
        let seen = self.map().segment_ids().into_iter().zip(&self.map.last_seen);
        for (id, frame) in seen.filter(|(id, _)| *id != 0) {
            let last = found.entry(id).or_default();
            *last = (*frame).max(*last);
        }
        found
    }

    /// Number of frames that the map was made from, of all runs together.
    pub fn frame_count(&self) -> u32 {
        self.frames
    }
}
