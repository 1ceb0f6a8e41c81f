//! Segment maps, with one id per pixel.

use crate::{Image, Mask};
use std::collections::BTreeMap;

/// The id of a segment; 0 means "no segment".
pub type SegmentId = u32;

/// The largest id: an 8-bit RGB image holds 24 bits.
pub const MAX_SEGMENT_ID: SegmentId = (1 << 24) - 1;

/// Largest id that fits a 16-bit image.
pub const MAX_16_BIT_ID: SegmentId = u16::MAX as SegmentId;

/// One [`SegmentId`] per pixel, `[height, width]`; 0 where there is no segment.
pub type SegmentMap = Image<SegmentId>;

impl SegmentMap {
    /// The number of pixels of every id in the map except 0.
    pub fn areas(&self) -> BTreeMap<SegmentId, usize> {
        // Ids up to the number of pixels, which are most, are counted in a list.
        let (mut small_ids, mut other_ids) = (Vec::new(), BTreeMap::new());
        for run in self.pixels().chunk_by(|left, right| left == right) {
            let id = run[0] as usize;
            if id > self.pixels().len() {
                *other_ids.entry(run[0]).or_insert(0) += run.len();
                continue;
            }
            if small_ids.len() <= id {
                small_ids.resize(id + 1, 0);
            }
            small_ids[id] += run.len();
        }
        let small_ids = (0..).zip(small_ids).filter(|(id, area)| *id != 0 && *area > 0);
        small_ids.chain(other_ids).collect()
    }

    /// Returns the map without segments of fewer than `min_area` pixels.
    #[must_use]
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

    /// Returns the mask of one id.
    pub fn mask_of(&self, id: SegmentId) -> Mask {
        Mask::from_fn(self.width(), self.height(), |column, row| self[(column, row)] == id)
    }
}

impl Mask {
    /// Returns a mask for every id of a segment map except 0, by increasing id.
    pub fn of_segments(map: &SegmentMap) -> Vec<(SegmentId, Self)> {
        let mut masks: BTreeMap<_, _> =
            map.areas().into_keys().map(|id| (id, Self::empty(map.width(), map.height()))).collect();
        for (index, id) in map.pixels().iter().enumerate() {
            if let Some(mask) = masks.get_mut(id) {
                mask.insert_index(index);
            }
        }
        masks.values_mut().for_each(Self::shrink);
        masks.into_iter().collect()
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
        let large = SegmentMap::from_pixels(3, 2, vec![u32::MAX, 6, 0, 5, 6, u32::MAX]).unwrap();
        assert_eq!(large.areas().into_iter().collect::<Vec<_>>(), [(5, 1), (6, 2), (u32::MAX, 2)]);
    }

    #[test]
    fn segments_become_masks_by_id() {
        let map = SegmentMap::from_pixels(2, 2, vec![9, 0, 4, 9]).unwrap();
        let masks = Mask::of_segments(&map);
        assert_eq!(masks.iter().map(|(id, mask)| (*id, mask.area())).collect::<Vec<_>>(), [(4, 1), (9, 2)]);
    }
}
