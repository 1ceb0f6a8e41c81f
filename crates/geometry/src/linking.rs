//! Ids for masks without ids, by linking masks of consecutive frames one-to-one by overlap.

use crate::{Candidate, MaskRuns, Ratio, best_assignment};

/// Links each frame's masks to the masks of the previous frame and numbers the resulting tubes from 1.
///
/// The Hungarian algorithm maximises the total F-score of the linked pairs. Masks that do not overlap are never linked,
/// and a mask without a partner starts a new tube (`get_tubes` in the paper's `evaluate_iVPQ.py`). This assigns ids to
/// FastSAM's masks, and to predictions without ids for scoring.
///
/// A link depends on two consecutive frames only. So the tubes within a window of frames, as VSQ requires, are the
/// video's tubes cut at the ends of the window.
#[derive(Clone, Debug, Default)]
pub struct MaskLinker {
    min_f_score: f64,
    previous: Vec<MaskRuns>,
    tubes_of_previous: Vec<u64>,
    last_tube: u64,
}

impl MaskLinker {
    /// Creates a linker. Pairs with an F-score below `min_f_score` are not linked. With 0, the default, any overlap is
    /// enough.
    pub fn new(min_f_score: f64) -> Self {
        Self { min_f_score, ..Self::default() }
    }

    /// Links the masks of the next frame. Returns the tube of each mask: its partner's, from the previous frame, or a
    /// new one. Masks may overlap.
    pub fn link(&mut self, masks: Vec<MaskRuns>) -> &[u64] {
        let mut tubes = vec![None; masks.len()];
        let candidates = self.candidates(&masks);
        for pair in best_assignment(&candidates).into_iter().map(|index| candidates[index]) {
            tubes[pair.column as usize] = Some(self.tubes_of_previous[pair.row as usize]);
        }
        let number = |tube: Option<u64>| {
            tube.unwrap_or_else(|| {
                self.last_tube += 1;
                self.last_tube
            })
        };
        self.tubes_of_previous = tubes.into_iter().map(number).collect();
        self.previous = masks;
        &self.tubes_of_previous
    }

    /// Pairs that may be linked. Rows are masks of the previous frame, columns masks of the next.
    fn candidates(&self, masks: &[MaskRuns]) -> Vec<Candidate> {
        let mut candidates = Vec::new();
        for (row, before) in self.previous.iter().enumerate() {
            for (column, next) in masks.iter().enumerate() {
                let intersection = before.intersection_area(next);
                if intersection == 0 {
                    continue;
                }
                let f_score = Ratio::f_score(intersection, before.area(), next.area());
                if f_score.to_f64() >= self.min_f_score {
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
    use crate::Mask;

    fn stripe(from: usize, to: usize) -> MaskRuns {
        MaskRuns::from_mask(&Mask::from_fn(20, 2, |column, _| (from..to).contains(&column)))
    }

    #[test]
    fn tubes_follow_overlap_and_end_without_it() {
        let mut linker = MaskLinker::default();
        assert_eq!(linker.link(vec![stripe(0, 4), stripe(6, 10)]), [1, 2]);
        assert_eq!(linker.link(vec![stripe(7, 11), stripe(14, 18), stripe(1, 5)]), [2, 3, 1]);
        assert_eq!(linker.link(vec![stripe(2, 6)]), [1]);
        assert!(linker.link(Vec::new()).is_empty());
        assert_eq!(linker.link(vec![stripe(2, 6)]), [4]);
    }

    #[test]
    fn the_largest_summed_f_score_wins_over_the_best_single_pair() {
        let mut linker = MaskLinker::default();
        linker.link(vec![stripe(0, 8), stripe(8, 12)]);
        // The first mask overlaps the first predecessor more (F-score 0.71 against 0.46). But if they were linked, the
        // second mask, which overlaps only this predecessor, would have no partner.
        assert_eq!(linker.link(vec![stripe(2, 11), stripe(0, 2)]), [2, 1]);
    }

    #[test]
    fn pairs_below_the_minimum_are_not_linked() {
        let mut linker = MaskLinker::new(0.5);
        linker.link(vec![stripe(0, 4)]);
        assert_eq!(linker.link(vec![stripe(3, 7)]), [2]);
        assert_eq!(linker.link(vec![stripe(5, 9)]), [2]);
    }
}
