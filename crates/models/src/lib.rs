//! Neural networks and their checkpoints. Knows nothing of splats.

pub mod checkpoint;
pub mod device;
pub mod fastsam;
