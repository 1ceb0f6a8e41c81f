//! Where a network's parameters come from.

use super::FastSamError;
use crate::checkpoint::Checkpoint;
use std::path::Path;

/// ε of a batch normalisation where the file does not say: Ultralytics sets it to this, PyTorch's default is 1e-5.
const BATCH_NORM_EPSILON: f64 = 1e-3;

/// Named tensors.
pub trait Weights {
    /// The file, for errors.
    fn path(&self) -> &Path;

    /// Shape of a tensor; `None` if there is none of that name.
    fn shape(&self, name: &str) -> Option<Vec<usize>>;

    /// The values of a tensor as `f32`, row-major.
    ///
    /// # Errors
    /// If there is no tensor of that name, it has another shape, or cannot be read.
    fn read_f32(&self, name: &str, shape: &[usize]) -> Result<Vec<f32>, FastSamError>;

    /// ε of every batch normalisation.
    fn batch_norm_epsilon(&self) -> f64 {
        BATCH_NORM_EPSILON
    }
}

impl Weights for Checkpoint {
    fn path(&self) -> &Path {
        self.path()
    }

    fn shape(&self, name: &str) -> Option<Vec<usize>> {
        self.info(name).map(|tensor| tensor.shape().to_vec())
    }

    fn read_f32(&self, name: &str, shape: &[usize]) -> Result<Vec<f32>, FastSamError> {
        Ok(Checkpoint::read_f32(self, name, shape)?)
    }

    fn batch_norm_epsilon(&self) -> f64 {
        self.batch_norm_eps().unwrap_or(BATCH_NORM_EPSILON)
    }
}
