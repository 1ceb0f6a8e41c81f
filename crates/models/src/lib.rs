//! Neural networks and their checkpoints. Knows nothing of splats.

pub mod fastsam;
