//! Access to the network's weights.

use super::FastSamError;
use crate::checkpoint::Checkpoint;
use std::path::Path;

/// ε of batch normalisation if the file does not state it. Ultralytics uses this value; PyTorch's default is 1e-5.
const BATCH_NORM_EPSILON: f64 = 1e-3;

/// A set of named tensors: a checkpoint, or another source of names, shapes and values.
pub trait Weights {
    /// Path of the file, for error messages.
    fn path(&self) -> &Path;

    /// Shape of a tensor, outermost dimension first; `None` if there is no such tensor.
    fn shape(&self, name: &str) -> Option<Vec<usize>>;

    /// Reads a tensor's values as `f32`, row-major.
    ///
    /// # Errors
    /// If there is no such tensor, it has another shape, or it cannot be read.
    fn read_f32(&self, name: &str, shape: &[usize]) -> Result<Vec<f32>, FastSamError>;

    /// ε of all batch normalisations.
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
