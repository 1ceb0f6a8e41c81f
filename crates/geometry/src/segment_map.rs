//! One id per pixel.

use crate::{Image, Mask};
use std::collections::BTreeMap;

/// The id of a segment; 0 means "no segment".
pub type SegmentId = u32;

/// One [`SegmentId`] per pixel, `[height, width]`; 0 where there is no segment.
pub type SegmentMap = Image<SegmentId>;

impl SegmentMap {
    /// The pixel count of every id in the map but 0, by increasing id.
    pub fn areas(&self) -> BTreeMap<SegmentId, usize> {
        // Neighbours mostly share an id: counting runs spares most of the map look-ups.
        let mut areas = BTreeMap::new();
        for run in self.pixels().chunk_by(|left, right| left == right) {
            if run[0] != 0 {
                *areas.entry(run[0]).or_insert(0) += run.len();
            }
        }
        areas
    }

    /// The pixels of one id.
    pub fn mask_of(&self, id: SegmentId) -> Mask {
        Mask::from_fn(self.width(), self.height(), |column, row| self[(column, row)] == id)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn areas_leave_out_unlabelled_pixels() {
        let map = SegmentMap::from_pixels(3, 2, vec![7, 0, 7, 2, 7, 0]).unwrap();
        assert_eq!(map.areas().into_iter().collect::<Vec<_>>(), [(2, 1), (7, 3)]);
        assert_eq!(map.mask_of(7).area(), 3);
    }
}
