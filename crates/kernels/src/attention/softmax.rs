//! Softmax over blocks of keys, one after another.

use crate::exp::exp2;
use crate::instructions::LANES;

/// Maxima so far, and sums of exponentials relative to them, of the queries in some lanes.
#[derive(Clone, Copy)]
pub(super) struct RunningSoftmax {
    maxima: [f32; LANES],
    pub sums: [f32; LANES],
}

impl RunningSoftmax {
    /// The state before the first score. The maximum is finite, so that differences of maxima are not NaN.
    pub const EMPTY: Self = Self { maxima: [-1e30; LANES], sums: [0.0; LANES] };
}

/// One block of scores, `[keys, queries]` and times log2(e): updates the maxima and sums, replaces the scores by
/// exp(score - maximum), and rescales the results so far, `[value elements, queries]`, to the new maximum.
#[inline(always)]
pub(super) fn soften(scores: &mut [f32], states: &mut [RunningSoftmax], weighted: &mut [f32]) {
    let parts = states.len();
    let (scores, weighted) = (scores.as_chunks_mut::<LANES>().0, weighted.as_chunks_mut::<LANES>().0);
    for (part, state) in states.iter_mut().enumerate() {
        let mut maxima = state.maxima;
        for score in scores[part..].iter().step_by(parts) {
            for lane in 0..LANES {
                maxima[lane] = if score[lane] > maxima[lane] { score[lane] } else { maxima[lane] };
            }
        }
        let mut rescale = [0.0; LANES];
        for lane in 0..LANES {
            rescale[lane] = exp2(state.maxima[lane] - maxima[lane]);
        }
        let mut sums = [0.0; LANES];
        for score in scores[part..].iter_mut().step_by(parts) {
            for lane in 0..LANES {
                score[lane] = exp2(score[lane] - maxima[lane]);
                sums[lane] += score[lane];
            }
        }
        for lane in 0..LANES {
            state.sums[lane] = state.sums[lane] * rescale[lane] + sums[lane];
        }
        if maxima != state.maxima {
            for values in weighted[part..].iter_mut().step_by(parts) {
                (0..LANES).for_each(|lane| values[lane] *= rescale[lane]);
            }
        }
        state.maxima = maxima;
    }
}
