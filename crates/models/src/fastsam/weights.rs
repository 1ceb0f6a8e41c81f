//! Where a network's parameters come from.

use super::FastSamError;

/// Named tensors, e.g. of a checkpoint.
pub trait Weights {
    /// Shape of a tensor; `None` if there is none of that name.
    fn shape(&self, name: &str) -> Option<Vec<usize>>;

    /// The values of a tensor as `f32`, row-major.
    ///
    /// # Errors
    /// If there is no tensor of that name, it has another shape, or cannot be read.
    fn read_f32(&self, name: &str, shape: &[usize]) -> Result<Vec<f32>, FastSamError>;
}
