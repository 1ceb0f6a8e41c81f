//! Tubes from masks without ids: masks of consecutive frames are linked one-to-one.

use crate::mask_runs::MaskRuns;
use crate::tubes::TubeId;
use splatseg_geometry::{Candidate, Ratio, best_assignment};

/// Links each frame's masks to those of the frame before and numbers the tubes that come of it.
///
/// A link depends on two consecutive frames alone, so tubes linked within a 15-frame window, as VSQ wants them, are the
/// video's tubes cut at the window: one numbering serves VSQ and STQ.
#[derive(Clone, Debug, Default)]
pub(crate) struct Linker {
    previous: Vec<MaskRuns>,
    tubes_of_previous: Vec<TubeId>,
    last_number: TubeId,
}

impl Linker {
    /// The tube of every mask of the next frame: that of its partner in the frame before, or a new one. The Hungarian
    /// algorithm maximises the partners' summed F-score, and masks that do not overlap are no partners (`get_tubes` of
    /// the paper's `evaluate_iVPQ.py`).
    pub(crate) fn tubes_of_next(&mut self, masks: Vec<MaskRuns>) -> &[TubeId] {
        let mut tubes = vec![None; masks.len()];
        let candidates = self.candidates(&masks);
        for pair in best_assignment(&candidates).into_iter().map(|index| candidates[index]) {
            tubes[pair.column as usize] = Some(self.tubes_of_previous[pair.row as usize]);
        }
        let number = |tube: Option<TubeId>| {
            tube.unwrap_or_else(|| {
                self.last_number += 1;
                self.last_number
            })
        };
        self.tubes_of_previous = tubes.into_iter().map(number).collect();
        self.previous = masks;
        &self.tubes_of_previous
    }

    /// Pairs of masks that overlap: rows are the frame before, columns the next.
    fn candidates(&self, masks: &[MaskRuns]) -> Vec<Candidate> {
        let mut candidates = Vec::new();
        for (row, before) in self.previous.iter().enumerate() {
            for (column, next) in masks.iter().enumerate() {
                let intersection = before.intersection_area(next);
                if intersection > 0 {
                    let f_score = Ratio::f_score(intersection, before.area(), next.area());
                    candidates.push(Candidate::new(row as u64, column as u64, f_score, None));
                }
            }
        }
        candidates
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use splatseg_geometry::Mask;

    fn stripe(from: usize, to: usize) -> MaskRuns {
        MaskRuns::of(&Mask::from_fn(20, 2, |column, _| (from..to).contains(&column)))
    }

    #[test]
    fn tubes_follow_overlap_and_end_without_it() {
        let mut linker = Linker::default();
        assert_eq!(linker.tubes_of_next(vec![stripe(0, 4), stripe(6, 10)]), [1, 2]);
        assert_eq!(linker.tubes_of_next(vec![stripe(7, 11), stripe(14, 18), stripe(1, 5)]), [2, 3, 1]);
        assert_eq!(linker.tubes_of_next(vec![stripe(2, 6)]), [1]);
        assert!(linker.tubes_of_next(Vec::new()).is_empty());
        assert_eq!(linker.tubes_of_next(vec![stripe(2, 6)]), [4]);
    }
}
