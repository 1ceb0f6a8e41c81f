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

    /// The map without the segments of fewer than `min_area` pixels.
    pub fn without_small(&self, min_area: usize) -> Self {
        let areas = self.areas();
        let mut kept = self.clone();
        for run in kept.pixels_mut().chunk_by_mut(|left, right| left == right) {
            if run[0] != 0 && areas[&run[0]] < min_area {
                run.fill(0);
            }
        }
        kept
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
    fn small_segments_are_left_out_wherever_their_pixels_are() {
        let map = SegmentMap::from_pixels(4, 2, vec![1, 2, 1, 3, 3, 0, 3, 1]).unwrap();
        assert_eq!(map.without_small(3).pixels(), [1, 0, 1, 3, 3, 0, 3, 1]);
        assert_eq!(map.without_small(0), map);
    }

    #[test]
    fn areas_leave_out_unlabelled_pixels() {
        let map = SegmentMap::from_pixels(3, 2, vec![7, 0, 7, 2, 7, 0]).unwrap();
        assert_eq!(map.areas().into_iter().collect::<Vec<_>>(), [(2, 1), (7, 3)]);
        assert_eq!(map.mask_of(7).area(), 3);
    }
}
