//! The evidence that a frame's affinities give about pairs of patches.

use super::frame_patches::FramePatches;
use super::{NO_PATCH, PairEvidence, pair_key};
use rayon::prelude::*;
use splatseg_geometry::{Affinities, AffinityPlane};

/// Pairs of pixels are counted from every second row only: neighbouring rows have nearly the same pairs.
const ROWS_PER_PAIR: usize = 2;

/// Returns the evidence about pairs of different patches, by increasing key.
pub(super) fn pairs_of(shown: &FramePatches, affinities: &Affinities) -> Vec<(u64, PairEvidence)> {
    let mut runs: Vec<(u64, PairEvidence)> =
        affinities.planes.par_iter().flat_map_iter(|plane| runs_of(shown, plane)).collect();
    runs.par_sort_unstable_by_key(|(key, _)| *key);
    runs.dedup_by(|next, kept| {
        let is_same = next.0 == kept.0;
        if is_same {
            kept.1.add(next.1);
        }
        is_same
    });
    runs
}

/// The pairs of one offset. Neighbouring pixels mostly show the same two patches, and become one entry.
fn runs_of(shown: &FramePatches, plane: &AffinityPlane) -> Vec<(u64, PairEvidence)> {
    let (width, height) = (shown.width, shown.patches.len() / shown.width.max(1));
    let (right, down) = (plane.right.unsigned_abs() as usize, plane.down as usize);
    // Columns of the left pixels of the pairs.
    let Some(length @ 1..) = width.checked_sub(right) else { return Vec::new() };
    let (first, second) = if plane.right < 0 { (right, 0) } else { (0, right) };
    let mut runs = Vec::new();
    for row in (0..height.saturating_sub(down)).step_by(ROWS_PER_PAIR) {
        let ones = &shown.patches[row * width + first..][..length];
        let others = &shown.patches[(row + down) * width + second..][..length];
        let log_odds = &plane.log_odds[row * width + first..][..length];
        let mut start = 0;
        while start < length {
            let pair = (ones[start], others[start]);
            let same = ones[start..].iter().zip(&others[start..]).take_while(|(one, other)| (**one, **other) == pair);
            let end = start + same.count();
            if pair.0 != pair.1 && pair.0 != NO_PATCH && pair.1 != NO_PATCH {
                let sum = log_odds[start..end].iter().map(|log_odds| i32::from(*log_odds)).sum();
                runs.push((pair_key(pair.0, pair.1), PairEvidence { sum, count: (end - start) as u32 }));
            }
            start = end;
        }
    }
    runs
}
