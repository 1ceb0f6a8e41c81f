//! Networks that rest between steps of a few milliseconds, while other work has the processor.

use std::ops::Range;

/// Multiplications and additions of a step, about 1 ms on one core.
const STEP_WORK: usize = 100_000_000;
/// Multiplications of a token in a block of a transformer, in squares of its width: at most 12 in published networks.
const WORK_PER_SQUARE: usize = 12;
/// Least number of rows of a step: with fewer, reading the weights takes longer than the products.
const MIN_ROWS: usize = 24;

/// Decides when a network goes on. Results do not depend on it.
pub trait Pacer: Sync {
    /// Is called before each step of a few milliseconds, on the thread that carries it out, and may block.
    fn before_step(&self);
}

/// How a network is carried out.
#[derive(Clone, Copy)]
pub(super) enum Pace<'a> {
    /// Without interruption, on all threads.
    AtOnce,
    /// In steps.
    InSteps(&'a dyn Pacer),
}

impl Pace<'_> {
    /// Waits until the next step may be carried out.
    pub fn wait(self) {
        if let Self::InSteps(pacer) = self {
            pacer.before_step();
        }
    }

    /// Computes a layer for `count` rows of `width` elements, some of them at a time. `layer` returns the results of a range of
    /// rows, which must not depend on the other rows.
    pub fn rows(self, [count, width]: [usize; 2], layer: impl Fn(Range<usize>) -> Vec<f32>) -> Vec<f32> {
        if matches!(self, Self::AtOnce) {
            return layer(0..count);
        }
        let rows = (STEP_WORK / (WORK_PER_SQUARE * width * width).max(1)).max(MIN_ROWS);
        let mut results = Vec::new();
        for start in (0..count).step_by(rows) {
            self.wait();
            results.extend(layer(start..count.min(start + rows)));
        }
        results
    }

    /// How many inputs pass through the network together: `most`, or `few` in steps.
    pub const fn together(self, most: usize, few: usize) -> usize {
        match self {
            Self::AtOnce => most,
            Self::InSteps(_) => few,
        }
    }
}

/// Rows of a matrix with `width` elements in each.
pub(super) fn part(matrix: &[f32], width: usize, rows: Range<usize>) -> &[f32] {
    &matrix[rows.start * width..rows.end * width]
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicUsize, Ordering};

    #[derive(Default)]
    struct Counter(AtomicUsize);

    impl Pacer for Counter {
        fn before_step(&self) {
            self.0.fetch_add(1, Ordering::Relaxed);
        }
    }

    #[test]
    fn all_rows_are_computed_in_steps() {
        let doubled = |rows: Range<usize>| rows.map(|row| 2.0 * row as f32).collect::<Vec<_>>();
        let counter = Counter::default();
        let [at_once, in_steps] = [Pace::AtOnce, Pace::InSteps(&counter)].map(|pace| pace.rows([100, 2048], doubled));
        assert_eq!(at_once, in_steps);
        assert_eq!(counter.0.load(Ordering::Relaxed), 100usize.div_ceil(MIN_ROWS));
        assert!(Pace::InSteps(&counter).rows([0, 8], doubled).is_empty());
    }
}
