//! Point prompts.

use splatseg_geometry::Mask;

/// Returns the indices of the masks that contain a pixel (column, row), i.e. those that a point prompt selects.
/// FastSAM's prompts select from the masks of the whole image; the network is not run again.
///
/// # Panics
/// If the pixel lies outside a mask's image.
pub fn masks_at(masks: &[&Mask], (column, row): (usize, usize)) -> impl Iterator<Item = usize> {
    masks.iter().enumerate().filter(move |(_, mask)| mask.contains(column, row)).map(|(index, _)| index)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_selects_the_masks_that_contain_it() {
        let stripe = |from: usize, to: usize| Mask::from_fn(6, 2, |column, _| (from..to).contains(&column));
        let masks = [stripe(0, 3), stripe(2, 5), stripe(5, 6)];
        let masks: Vec<&Mask> = masks.iter().collect();
        assert_eq!(masks_at(&masks, (2, 0)).collect::<Vec<_>>(), [0, 1]);
        assert_eq!(masks_at(&masks, (5, 1)).collect::<Vec<_>>(), [2]);
    }
}
