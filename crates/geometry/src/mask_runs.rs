//! Masks as runs of pixels. The time to overlap two masks is proportional to their outlines, not to the image.

use crate::Mask;
use std::ops::Range;

/// The pixels of a mask as increasing runs of consecutive row-major indices. No run is empty and no two touch.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct MaskRuns {
    size: (usize, usize),
    runs: Vec<Range<usize>>,
    area: u64,
}

impl MaskRuns {
    /// Converts a mask.
    pub fn from_mask(mask: &Mask) -> Self {
        let mut runs: Vec<Range<usize>> = Vec::new();
        let mut area = 0;
        for pixel in mask.pixel_indices() {
            area += 1;
            match runs.last_mut() {
                Some(run) if run.end == pixel => run.end += 1,
                _ => runs.push(pixel..pixel + 1),
            }
        }
        Self { size: (mask.width(), mask.height()), runs, area }
    }

    /// The runs.
    pub fn runs(&self) -> &[Range<usize>] {
        &self.runs
    }

    /// Number of pixels.
    pub fn area(&self) -> u64 {
        self.area
    }

    /// Number of pixels in both masks. 0 if their images differ in size.
    pub fn intersection_area(&self, other: &Self) -> u64 {
        if self.size != other.size {
            return 0;
        }
        let (mut ours, mut theirs) = (self.runs.iter().peekable(), other.runs.iter().peekable());
        let mut pixels = 0;
        while let (Some(our), Some(their)) = (ours.peek(), theirs.peek()) {
            pixels += our.end.min(their.end).saturating_sub(our.start.max(their.start)) as u64;
            if our.end < their.end {
                ours.next();
            } else {
                theirs.next();
            }
        }
        pixels
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn runs_and_bits_count_the_same(a in prop::collection::vec(any::<bool>(), 91..=91),
                                      b in prop::collection::vec(any::<bool>(), 91..=91)) {
            let mask = |pixels: &[bool]| Mask::from_fn(13, 7, |column, row| pixels[row * 13 + column]);
            let (first, second) = (mask(&a), mask(&b));
            let (first_runs, second_runs) = (MaskRuns::from_mask(&first), MaskRuns::from_mask(&second));
            prop_assert_eq!(first_runs.area(), first.area() as u64);
            prop_assert_eq!(first_runs.intersection_area(&second_runs), first.intersection_area(&second) as u64);
            let pixels: Vec<usize> = first_runs.runs().iter().cloned().flatten().collect();
            prop_assert_eq!(pixels, first.pixel_indices().collect::<Vec<_>>());
        }
    }

    #[test]
    fn masks_of_different_images_do_not_overlap() {
        let full = |width, height| MaskRuns::from_mask(&Mask::from_fn(width, height, |_, _| true));
        assert_eq!(full(6, 4).intersection_area(&full(6, 4)), 24);
        assert_eq!(full(6, 4).intersection_area(&full(4, 6)), 0);
    }
}
