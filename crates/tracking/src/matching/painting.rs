//! One id per pixel from masks that overlap.

use splatseg_geometry::{Mask, SegmentId, SegmentMap};

/// Returns the indices of the masks in painting order: **smaller masks cover larger ones** (a cup covers the table it
/// stands on). Of two equally large masks, the later covers the earlier.
pub(crate) fn painting_order<'a>(masks: impl Iterator<Item = &'a Mask>) -> Vec<usize> {
    let mut order: Vec<(usize, usize)> = masks.enumerate().map(|(index, mask)| (mask.area(), index)).collect();
    order.sort_by_key(|(area, index)| (std::cmp::Reverse(*area), *index));
    order.into_iter().map(|(_, index)| index).collect()
}

/// Paints masks into an image of `size` = (width, height), in [`painting_order`]; 0 where there is no mask.
pub(crate) fn painted(size: (usize, usize), masks: &[(SegmentId, Mask)]) -> SegmentMap {
    let parts = visible_parts(size, &masks.iter().map(|(_, mask)| mask).collect::<Vec<_>>());
    painted_parts(size, masks.iter().map(|(id, _)| *id).zip(&parts))
}

/// Paints masks that share no pixel.
pub(crate) fn painted_parts<'a>(
    size: (usize, usize),
    masks: impl Iterator<Item = (SegmentId, &'a Mask)>,
) -> SegmentMap {
    let mut map = SegmentMap::filled(size.0, size.1, 0);
    for (segment, mask) in masks {
        for pixel in mask.pixel_indices() {
            map.pixels_mut()[pixel] = segment;
        }
    }
    map
}

/// Returns the part of each mask that is visible once all are painted in [`painting_order`]. It may be empty.
pub(crate) fn visible_parts(size: (usize, usize), masks: &[&Mask]) -> Vec<Mask> {
    let mut parts = vec![Mask::empty(size.0, size.1); masks.len()];
    let mut covered = Mask::empty(size.0, size.1);
    // From the top, so that each of thousands of overlapping masks costs a pass over its words, not over its pixels.
    for index in painting_order(masks.iter().copied()).into_iter().rev() {
        let mut part = masks[index].clone();
        part.subtract(&covered);
        covered.unite(&part);
        parts[index] = part;
    }
    parts
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn smaller_masks_cover_larger_ones_and_later_ones_earlier_ones() {
        let stripe = |from: usize, to: usize| Mask::from_fn(6, 1, |column, _| (from..to).contains(&column));
        let masks = [(4, stripe(1, 2)), (9, stripe(0, 4)), (5, stripe(2, 4)), (6, stripe(3, 5))];
        assert_eq!(painted((6, 1), &masks).pixels(), [9, 4, 5, 6, 6, 0]);
    }

    #[test]
    fn tens_of_thousands_of_overlapping_masks_take_little_time_and_memory() {
        let full = Mask::from_fn(640, 480, |_, _| true);
        let parts = visible_parts((640, 480), &vec![&full; 20_000]);
        assert_eq!(parts.iter().filter(|part| !part.is_empty()).count(), 1);
        assert!(parts.iter().map(Mask::memory_bytes).sum::<usize>() < 100_000);
    }

    #[test]
    fn visible_parts_share_no_pixel() {
        let stripe = |from: usize, to: usize| Mask::from_fn(6, 1, |column, _| (from..to).contains(&column));
        let masks = [stripe(0, 5), stripe(1, 5), stripe(1, 5), stripe(5, 6)];
        let parts = visible_parts((6, 1), &masks.each_ref());
        assert_eq!(parts, [stripe(0, 1), stripe(0, 0), stripe(1, 5), stripe(5, 6)]);
    }
}
