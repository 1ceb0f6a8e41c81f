//! Masks as runs of pixels, so that overlaps of many masks cost time by their outlines instead of by the image.

use splatseg_geometry::Mask;
use std::ops::Range;

/// The pixels of a mask as runs of consecutive row-major indices, increasing, none empty, no two touching.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct MaskRuns {
    runs: Vec<Range<usize>>,
    area: u64,
}

impl MaskRuns {
    pub(crate) fn of(mask: &Mask) -> Self {
        let mut runs: Vec<Range<usize>> = Vec::new();
        let mut area = 0;
        for pixel in mask.pixel_indices() {
            area += 1;
            match runs.last_mut() {
                Some(run) if run.end == pixel => run.end += 1,
                _ => runs.push(pixel..pixel + 1),
            }
        }
        Self { runs, area }
    }

    pub(crate) fn runs(&self) -> &[Range<usize>] {
        &self.runs
    }

    /// Number of pixels.
    pub(crate) fn area(&self) -> u64 {
        self.area
    }

    /// Number of pixels in both masks.
    pub(crate) fn intersection_area(&self, other: &Self) -> u64 {
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
        fn runs_count_what_bits_count(a in prop::collection::vec(any::<bool>(), 91..=91),
                                      b in prop::collection::vec(any::<bool>(), 91..=91)) {
            let mask = |pixels: &[bool]| Mask::from_fn(13, 7, |column, row| pixels[row * 13 + column]);
            let (first, second) = (mask(&a), mask(&b));
            let (first_runs, second_runs) = (MaskRuns::of(&first), MaskRuns::of(&second));
            prop_assert_eq!(first_runs.area(), first.area() as u64);
            prop_assert_eq!(first_runs.intersection_area(&second_runs), first.intersection_area(&second) as u64);
            let pixels: Vec<usize> = first_runs.runs().iter().cloned().flatten().collect();
            prop_assert_eq!(pixels, first.pixel_indices().collect::<Vec<_>>());
        }
    }
}
