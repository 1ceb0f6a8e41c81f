//! What the oracle's random numbers decide.

/// What a random number decides; each kind has its own, so that changing one rate leaves the other errors alone.
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
