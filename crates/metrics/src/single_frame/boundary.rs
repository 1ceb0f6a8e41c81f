//! Comparison of boundaries between segments with boundaries between true objects.

use crate::Void;
use serde::{Deserialize, Serialize};
use splatseg_geometry::SegmentId;

/// Maximum distance between matching predicted and true boundaries, in pixels.
pub const BOUNDARY_TOLERANCE_PX: isize = 2;

/// Counts of pixels on boundaries. A pixel is on a boundary if its right or lower neighbour has a different label.
/// Counts of several frames can be added.
///
/// With [`Void::Excluded`], pixels that are unlabelled or within the tolerance of unlabelled pixels are ignored.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct BoundaryCounts {
    /// Pixels on predicted boundaries.
    pub predicted: u64,
    /// Pixels on predicted boundaries with a true boundary within [`BOUNDARY_TOLERANCE_PX`].
    pub predicted_right: u64,
    /// Pixels on true boundaries.
    pub truth: u64,
    /// Pixels on true boundaries with a predicted boundary within [`BOUNDARY_TOLERANCE_PX`].
    pub truth_found: u64,
}

impl BoundaryCounts {
    /// Counts a frame with rows of `width` pixels. `truth` contains true ids, 0 where unlabelled. `predicted` contains
    /// one predicted label per pixel, 0 for none.
    pub(crate) fn count(width: usize, truth: &[SegmentId], predicted: &[SegmentId], void: Void) -> Self {
        let mut counted = vec![true; truth.len()];
        if void == Void::Excluded {
            let unlabelled: Vec<bool> = truth.iter().map(|id| *id == 0).collect();
            let near = widened(&unlabelled, width);
            counted.iter_mut().zip(near).for_each(|(counted, near)| *counted = !near);
        }
        let of = |labels: &[SegmentId]| -> Vec<bool> {
            let mut on_boundary = boundary(labels, width);
            on_boundary.iter_mut().zip(&counted).for_each(|(on, counted)| *on &= counted);
            on_boundary
        };
        let (truth, predicted) = (of(truth), of(predicted));
        let both = |pixels: &[bool], others: &[bool]| {
            pixels.iter().zip(widened(others, width)).filter(|(pixel, other)| **pixel && *other).count() as u64
        };
        let all = |pixels: &[bool]| pixels.iter().filter(|pixel| **pixel).count() as u64;
        Self {
            predicted: all(&predicted),
            predicted_right: both(&predicted, &truth),
            truth: all(&truth),
            truth_found: both(&truth, &predicted),
        }
    }

    pub(crate) fn add(&mut self, other: &Self) {
        self.predicted += other.predicted;
        self.predicted_right += other.predicted_right;
        self.truth += other.truth;
        self.truth_found += other.truth_found;
    }

    /// Harmonic mean of precision and recall, percent. `None` without boundaries.
    pub(super) fn f_score(&self) -> Option<f64> {
        let share = |part: u64, all: u64| if all > 0 { part as f64 / all as f64 } else { 0.0 };
        let precision = share(self.predicted_right, self.predicted);
        let recall = share(self.truth_found, self.truth);
        let sum = precision + recall;
        (self.predicted + self.truth > 0).then(|| if sum > 0.0 { 200.0 * precision * recall / sum } else { 0.0 })
    }
}

fn boundary(labels: &[SegmentId], width: usize) -> Vec<bool> {
    let differs = |index: usize, other: usize| labels.get(other).is_some_and(|label| *label != labels[index]);
    (0..labels.len())
        .map(|index| ((index + 1) % width != 0 && differs(index, index + 1)) || differs(index, index + width))
        .collect()
}

/// Dilates `pixels` by the tolerance.
fn widened(pixels: &[bool], width: usize) -> Vec<bool> {
    const REACH: isize = BOUNDARY_TOLERANCE_PX;
    let mut wide = vec![false; pixels.len()];
    for index in (0..pixels.len()).filter(|index| pixels[*index]) {
        let (column, row) = ((index % width) as isize, (index / width) as isize);
        for y in -REACH..=REACH {
            for x in (-REACH..=REACH).filter(|x| x * x + y * y <= REACH * REACH) {
                let (column, row) = (column + x, row + y);
                if row >= 0 && (0..width as isize).contains(&column) {
                    let near = row as usize * width + column as usize;
                    if let Some(near) = wide.get_mut(near) {
                        *near = true;
                    }
                }
            }
        }
    }
    wide
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An image of 12×4 pixels with two segments, divided before `column` and unlabelled from `void` on.
    fn halves(column: usize, void: usize) -> Vec<SegmentId> {
        (0..48).map(|index| index % 12).map(|x| if x >= void { 0 } else { 1 + u32::from(x >= column) }).collect()
    }

    fn count(predicted: usize, void: Void) -> BoundaryCounts {
        BoundaryCounts::count(12, &halves(6, 12), &halves(predicted, 12), void)
    }

    #[test]
    fn boundaries_may_be_two_pixels_apart() {
        assert_eq!(count(8, Void::Counted).f_score(), Some(100.0));
        assert_eq!(count(9, Void::Counted).f_score(), Some(0.0));
        let none = BoundaryCounts::count(12, &[1; 48], &[1; 48], Void::Counted);
        assert_eq!(none.f_score(), None);
    }

    #[test]
    fn boundaries_at_unlabelled_ground_are_left_out() {
        let counts = |void| BoundaryCounts::count(12, &halves(20, 8), &halves(7, 12), void);
        assert_eq!(counts(Void::Counted).predicted, 4);
        assert_eq!(counts(Void::Excluded), BoundaryCounts::default());
    }
}
