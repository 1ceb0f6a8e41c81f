//! Neural networks and their checkpoints. Knows nothing of splats.

pub mod checkpoint;
pub mod convolution;
pub mod device;
pub mod fastsam;
