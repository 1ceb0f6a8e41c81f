//! Softmax over consecutive blocks of keys.

use crate::exp::exp2;
use crate::instructions::LANES;

/// Running maximum of each lane's query, and the sum of exponentials relative to it.
#[derive(Clone, Copy)]
pub(super) struct RunningSoftmax {
    maxima: [f32; LANES],
    pub sums: [f32; LANES],
}

impl RunningSoftmax {
    /// The state before the first score. The maximum is finite, so that differences of maxima are not NaN.
    pub const EMPTY: Self = Self { maxima: [-1e30; LANES], sums: [0.0; LANES] };
}

/// Processes a block of scores `[keys, queries]`, premultiplied by log2(e). Updates the maxima and sums, replaces the
/// scores by exp(score - maximum), and rescales the weighted sums `[value elements, queries]` to the new maximum.
#[inline(always)]
pub(super) fn update_softmax(scores: &mut [f32], states: &mut [RunningSoftmax], weighted: &mut [f32]) {
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
