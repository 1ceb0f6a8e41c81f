//! The oracle's random decisions.

/// Kinds of random decisions. Each has its own random numbers, so that changing one rate does not change other errors.
#[derive(Clone, Copy, Debug)]
pub(super) enum Decision {
    PersistentMiss = 1,
    Miss,
    Split,
    Merge,
    Neighbour,
    Outline,
    FalsePositives,
    Score,
}

impl From<Decision> for u64 {
    fn from(decision: Decision) -> Self {
        decision as Self
    }
}
