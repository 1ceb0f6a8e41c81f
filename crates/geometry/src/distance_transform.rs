//! City-block distance transform.

use crate::Mask;

/// Computes the city-block distance from each pixel to the nearest target, a pixel with `is_target(index)`. The result
/// is row-major: 0 on targets, `u32::MAX` if there are no targets. `(width, height)` is the size of the image.
pub fn distance_transform((width, height): (usize, usize), is_target: impl Fn(usize) -> bool) -> Vec<u32> {
    let mut steps: Vec<u32> = (0..width * height).map(|index| if is_target(index) { 0 } else { u32::MAX }).collect();
    let nearer = |step: u32, neighbour: u32| step.min(neighbour.saturating_add(1));
    // A pass down, which also goes right and left within each row, then a pass up. Vertical steps update whole rows.
    for row in 0..height {
        let (above, rest) = steps.split_at_mut(row * width);
        let steps = &mut rest[..width];
        if row > 0 {
            steps.iter_mut().zip(&above[(row - 1) * width..]).for_each(|(step, above)| *step = nearer(*step, *above));
        }
        for column in 1..width {
            steps[column] = nearer(steps[column], steps[column - 1]);
        }
        for column in (1..width).rev() {
            steps[column - 1] = nearer(steps[column - 1], steps[column]);
        }
    }
    for row in (1..height).rev() {
        let (above, steps) = steps.split_at_mut(row * width);
        above[(row - 1) * width..].iter_mut().zip(steps).for_each(|(above, step)| *above = nearer(*above, *step));
    }
    steps
}

impl Mask {
    /// Computes the depth of each pixel inside the mask, row-major: its city-block distance to the nearest pixel
    /// outside. Everything beyond the image border is outside. 0 for pixels outside the mask, at least 1 inside.
    pub fn depths(&self) -> Vec<u32> {
        let (width, height) = (self.width(), self.height());
        let mut inside = vec![false; width * height];
        self.pixel_indices().for_each(|index| inside[index] = true);
        let mut depths = distance_transform((width, height), |index| !inside[index]);
        for (index, depth) in depths.iter_mut().enumerate() {
            let (column, row) = (index % width, index / width);
            let to_border = (column + 1).min(width - column).min(row + 1).min(height - row);
            *depth = (*depth).min(to_border as u32);
        }
        depths
    }

    /// Returns the opening of the mask with a city-block ball, which removes parts at most `2 · radius` pixels thick.
    #[must_use]
    pub fn opened(&self, radius: usize) -> Self {
        let radius = radius.min(u32::MAX as usize - 1) as u32;
        let depths = self.depths();
        let steps = distance_transform((self.width(), self.height()), |index| depths[index] > radius);
        Self::from_fn(self.width(), self.height(), |column, row| steps[row * self.width() + column] <= radius)
    }
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
                prop_assert_eq!(found, nearest.map_or(u32::MAX, |nearest| nearest as u32));
            }
        }
    }

    #[test]
    fn images_may_be_a_line_or_empty() {
        assert_eq!(distance_transform((4, 1), |index| index == 1), [1, 0, 1, 2]);
        assert_eq!(distance_transform((1, 4), |index| index == 3), [3, 2, 1, 0]);
        assert_eq!([(0, 0), (0, 3), (3, 0)].map(|size| distance_transform(size, |_| true).len()), [0; 3]);
    }

    #[test]
    fn depth_counts_from_the_outline_and_the_image_border() {
        let depths = Mask::from_fn(7, 5, |column, _| column < 5).depths();
        assert_eq!(depths[2 * 7..3 * 7], [1, 2, 3, 2, 1, 0, 0]);
        assert_eq!(depths[..7], [1, 1, 1, 1, 1, 0, 0]);
        let full = Mask::from_fn(5, 4, |_, _| true).depths();
        assert_eq!(full, [[1; 5], [1, 2, 2, 2, 1], [1, 2, 2, 2, 1], [1; 5]].concat());
    }

    #[test]
    fn opening_removes_thin_parts() {
        let columns = |mask: &Mask| (0..20).filter(|column| mask.contains(*column, 4)).collect::<Vec<_>>();
        // Stripes of 4 and of 5 columns, and one of 4 along the border of the image.
        let is_striped = |column: usize| matches!(column, 2..6 | 9..14 | 16..20);
        let stripes = Mask::from_fn(20, 9, |column, _| is_striped(column));
        assert_eq!(columns(&stripes.opened(2)), [9, 10, 11, 12, 13]);
        assert_eq!(stripes.opened(0), stripes);
        assert!(stripes.opened(3).is_empty() && Mask::empty(20, 9).opened(2).is_empty());
        assert!(stripes.opened(usize::MAX).is_empty());
    }
}
