//! Distances of pixels to a region.

use splatseg_geometry::Mask;

/// The city-block distance from each pixel to the nearest one for which `is_target(index)` holds: row-major, 0 on
/// targets, `usize::MAX` if there are no targets. `(width, height)` is the size of the image.
pub fn distance_transform((width, height): (usize, usize), is_target: impl Fn(usize) -> bool) -> Vec<usize> {
    let mut steps: Vec<usize> =
        (0..width * height).map(|index| if is_target(index) { 0 } else { usize::MAX }).collect();
    // The first pass finds targets above and to the left, the second those below and to the right.
    let relax = |steps: &mut [usize], index: usize, neighbour: usize| {
        steps[index] = steps[index].min(steps[neighbour].saturating_add(1));
    };
    for index in 0..width * height {
        if index % width > 0 {
            relax(&mut steps, index, index - 1);
        }
        if index >= width {
            relax(&mut steps, index, index - width);
        }
    }
    for index in (0..width * height).rev() {
        if index % width + 1 < width {
            relax(&mut steps, index, index + 1);
        }
        if index + width < width * height {
            relax(&mut steps, index, index + width);
        }
    }
    steps
}

/// How deep each pixel is inside `mask`: its city-block distance to the nearest pixel outside. Everything beyond the
/// image border is outside. 0 for pixels that are not in the mask, at least 1 for those that are.
pub(crate) fn depth_inside(mask: &Mask) -> Vec<usize> {
    let size = (mask.width(), mask.height());
    let mut inside = vec![false; size.0 * size.1];
    mask.pixel_indices().for_each(|index| inside[index] = true);
    let mut depth = distance_transform(size, |index| !inside[index]);
    for (index, depth) in depth.iter_mut().enumerate() {
        let (column, row) = (index % size.0, index / size.0);
        let to_border = (column + 1).min(size.0 - column).min(row + 1).min(size.1 - row);
        *depth = (*depth).min(to_border);
    }
    depth
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn distances_are_to_the_nearest_target(targets in prop::collection::vec(prop::bool::weighted(0.1), 60..=60)) {
            let steps = distance_transform((10, 6), |index| targets[index]);
            for (index, found) in steps.into_iter().enumerate() {
                let apart = |other: usize| (index % 10).abs_diff(other % 10) + (index / 10).abs_diff(other / 10);
                let nearest = (0..60).filter(|other| targets[*other]).map(apart).min();
                prop_assert_eq!(found, nearest.unwrap_or(usize::MAX));
            }
        }
    }

    #[test]
    fn depth_counts_from_the_outline_and_the_image_border() {
        let mask = Mask::from_fn(7, 5, |column, _| column < 5);
        let depth = depth_inside(&mask);
        assert_eq!(depth[2 * 7..3 * 7], [1, 2, 3, 2, 1, 0, 0]);
        assert_eq!(depth[..7], [1, 1, 1, 1, 1, 0, 0]);
        let full = depth_inside(&Mask::from_fn(5, 4, |_, _| true));
        assert_eq!(full, [[1; 5], [1, 2, 2, 2, 1], [1, 2, 2, 2, 1], [1; 5]].concat());
    }
}
