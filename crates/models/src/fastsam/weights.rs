//! Where the network's weights come from.

use super::FastSamError;
use crate::checkpoint::Checkpoint;
use std::path::Path;

/// ε of batch normalisation where the file does not say; Ultralytics uses this value, PyTorch's default is 1e-5.
const BATCH_NORM_EPSILON: f64 = 1e-3;

/// A set of named tensors: a checkpoint, or anything else that knows names and shapes.
pub trait Weights {
    /// The file, for errors.
    fn path(&self) -> &Path;

    /// The shape of a tensor, outermost dimension first; `None` if there is no such tensor.
    fn shape(&self, name: &str) -> Option<Vec<usize>>;

    /// The values of a tensor as `f32`, row-major.
    ///
    /// # Errors
    /// If there is no such tensor, it has another shape, or it cannot be read.
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
