//! Sampling of clicks (`docs/PAPER.md`, "SAM2-Splat", step 3). The paper does not say how clicks are sampled from a
//! region.

use splatseg_geometry::{Mask, flood_fill};

/// Returns up to `count` pixels (column, row) inside a region, away from its outline and from each other: none if the
/// region is empty, fewer if too few pixels are deep enough inside it.
///
/// The first is the innermost pixel. Each further one is the pixel farthest from the pixels chosen so far, among those
/// at least half as deep inside the region as the innermost pixel and connected with it. Expected outlines are off by a
/// pixel or two, and an overruled id may leave remnants elsewhere in the memory: clicks in such places would select
/// another object. Ties go to the first pixel in reading order, so the clicks depend only on the region. The image
/// border counts as outline.
pub fn sample_clicks(region: &Mask, count: usize) -> Vec<(usize, usize)> {
    let depth = region.depths();
    let innermost = depth.iter().copied().max().unwrap_or(0);
    let Some(start) = depth.iter().position(|found| *found == innermost && innermost > 0) else {
        return Vec::new();
    };
    let size = (region.width(), region.height());
    let pixel = |index: usize| (index % size.0, index / size.0);
    let is_deep = |index: &usize| 2 * depth[*index] >= innermost;
    let mut interior: Vec<usize> = flood_fill(start, size, &mut vec![false; depth.len()], |index| depth[index] > 0)
        .into_iter()
        .filter(is_deep)
        .collect();
    interior.sort_unstable();
    let interior: Vec<(usize, usize)> = interior.into_iter().map(pixel).collect();
    let mut chosen: Vec<(usize, usize)> = [pixel(start)].into_iter().take(count).collect();
    // Squared distance of each interior pixel to the nearest click.
    let mut apart = vec![usize::MAX; interior.len()];
    while let Some(last) = chosen.last().filter(|_| chosen.len() < count).copied() {
        let mut farthest = (0, None);
        for (place, (column, row)) in interior.iter().enumerate() {
            let distance = column.abs_diff(last.0).pow(2) + row.abs_diff(last.1).pow(2);
            apart[place] = apart[place].min(distance);
            if apart[place] > farthest.0 {
                farthest = (apart[place], Some(interior[place]));
            }
        }
        match farthest.1 {
            Some(next) => chosen.push(next),
            None => break,
        }
    }
    chosen
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn the_first_click_is_innermost_and_the_others_spread_out() {
        let bar = Mask::from_fn(40, 20, |column, row| (4..34).contains(&column) && (6..13).contains(&row));
        let clicks = sample_clicks(&bar, 3);
        assert_eq!(clicks[0], (7, 9), "the first of the innermost pixels");
        assert_eq!(clicks.len(), 3);
        assert!(clicks[1].0 > 28 && (12..24).contains(&clicks[2].0), "{clicks:?}");
        assert_eq!(sample_clicks(&bar, 1), [(7, 9)]);
    }

    #[test]
    fn separate_parts_of_the_region_are_not_clicked() {
        let is_inside = |column: usize, row: usize| {
            let block = (4..16).contains(&column) && (4..16).contains(&row);
            let remnant = (30..40).contains(&column) && (5..15).contains(&row);
            block || remnant
        };
        let clicks = sample_clicks(&Mask::from_fn(48, 20, is_inside), 5);
        assert!(clicks.len() == 5 && clicks.iter().all(|(column, _)| *column < 16), "{clicks:?}");
        let bridged = sample_clicks(&Mask::from_fn(48, 20, |column, row| is_inside(column, row) || row == 10), 5);
        assert!(bridged.iter().any(|(column, _)| *column >= 30), "one region: {bridged:?}");
    }

    #[test]
    fn small_regions_have_few_clicks_and_empty_ones_none() {
        let pair = Mask::from_fn(9, 9, |column, row| row == 4 && (3..5).contains(&column));
        assert_eq!(sample_clicks(&pair, 5), [(3, 4), (4, 4)]);
        assert!(sample_clicks(&Mask::empty(9, 9), 5).is_empty() && sample_clicks(&pair, 0).is_empty());
    }

    #[test]
    fn further_clicks_are_at_least_half_as_deep() {
        // The middle is 11 pixels deep. Of the pixels that are 6 deep, the corners are farthest from it.
        let square = Mask::from_fn(21, 21, |_, _| true);
        assert_eq!(sample_clicks(&square, 3), [(10, 10), (5, 5), (15, 5)]);
    }

    proptest! {
        #[test]
        fn clicks_are_different_pixels_of_the_region(inside in prop::collection::vec(any::<bool>(), 96..=96)) {
            let region = Mask::from_fn(12, 8, |column, row| inside[row * 12 + column]);
            let clicks = sample_clicks(&region, 5);
            prop_assert!(clicks.iter().all(|(column, row)| region.contains(*column, *row)));
            let mut different = clicks.clone();
            different.sort_unstable();
            different.dedup();
            prop_assert_eq!(different.len(), clicks.len());
            prop_assert_eq!(clicks.is_empty(), region.is_empty());
        }
    }
}
