//! Finds the tensors that a checkpoint lacks for its network.

mod missing;

pub use missing::Missing;

use crate::checkpoint::{Architecture, Checkpoint};
use crate::fastsam::{self, FastSamError};
use crate::sam2::{self, Sam2Error, Sam2Network};
use burn::tensor::Device;
use std::cell::{Cell, RefCell};
use std::path::Path;

/// The zeros for a network are limited to this multiple of the checkpoint's number of elements, but to no less than
/// [`SMALLEST_LIMIT`]: a small file cannot allocate much memory.
const LARGEST_SHARE: usize = 2;
const SMALLEST_LIMIT: usize = 1 << 24;

/// Returns the tensors that the checkpoint's network needs but that are missing or have another shape, in the order in
/// which the network reads them. `None` if splatseg does not run this network.
///
/// The network is built from zeros, and every tensor that it reads is compared with the checkpoint. Only names and
/// shapes are read from the file.
pub fn missing_tensors(checkpoint: &Checkpoint) -> Option<Vec<Missing>> {
    let audit = Audit::new(checkpoint);
    let built = match checkpoint.architecture() {
        Architecture::YoloV8Seg { .. } => {
            let config = fastsam::FastSamConfig::from_checkpoint(checkpoint).ok()?;
            fastsam::FastSamNetwork::load(&audit, config, &Device::flex()).is_ok()
        }
        Architecture::Sam2 { .. } | Architecture::EdgeTam { .. } | Architecture::EfficientTam { .. } => {
            match Sam2Network::load(&audit, None, &Device::flex()) {
                Ok(_) | Err(Sam2Error::UnexpectedTensor { .. }) => true,
                Err(_) => false,
            }
        }
        // Loading one says what it lacks.
        Architecture::Clip { .. } | Architecture::DepthAnything { .. } | Architecture::Unknown => false,
    };
    let missing = audit.missing.into_inner();
    (built || !missing.is_empty()).then_some(missing)
}

/// Weights that are all zero, and a record of the requested tensors that the checkpoint lacks.
struct Audit<'a> {
    checkpoint: &'a Checkpoint,
    missing: RefCell<Vec<Missing>>,
    /// Number of elements that may still be requested.
    remaining: Cell<usize>,
}

impl<'a> Audit<'a> {
    fn new(checkpoint: &'a Checkpoint) -> Self {
        let held: usize = checkpoint.tensors().map(|tensor| tensor.elements()).sum();
        let remaining = Cell::new(held.saturating_mul(LARGEST_SHARE).max(SMALLEST_LIMIT));
        Self { checkpoint, missing: RefCell::default(), remaining }
    }

    /// Returns zeros of shape `expected`; `None` if that exceeds the limit.
    fn zeros(&self, name: &str, expected: &[usize]) -> Option<Vec<f32>> {
        let found = self.checkpoint.info(name).map(|tensor| tensor.shape().to_vec());
        if found.as_deref() != Some(expected) {
            self.missing.borrow_mut().push(Missing { name: name.to_owned(), expected: expected.to_vec(), found });
        }
        let count = expected.iter().try_fold(1usize, |count, side| count.checked_mul(*side))?;
        self.remaining.set(self.remaining.get().checked_sub(count)?);
        Some(vec![0.0; count])
    }
}

impl fastsam::Weights for Audit<'_> {
    fn path(&self) -> &Path {
        self.checkpoint.path()
    }

    fn shape(&self, name: &str) -> Option<Vec<usize>> {
        fastsam::Weights::shape(self.checkpoint, name)
    }

    fn read_f32(&self, name: &str, shape: &[usize]) -> Result<Vec<f32>, FastSamError> {
        let too_large =
            || FastSamError::NotFastSam { path: self.path().to_owned(), found: format!("{name} {shape:?}") };
        self.zeros(name, shape).ok_or_else(too_large)
    }
}

impl sam2::Weights for Audit<'_> {
    fn names(&self) -> Vec<String> {
        sam2::Weights::names(self.checkpoint)
    }

    fn shape(&self, name: &str) -> Option<Vec<usize>> {
        sam2::Weights::shape(self.checkpoint, name)
    }

    fn read(&self, name: &str, shape: &[usize]) -> Result<Vec<f32>, Sam2Error> {
        let too_large = || Sam2Error::UnreadableTensor { name: name.to_owned(), reason: format!("{shape:?}") };
        self.zeros(name, shape).ok_or_else(too_large)
    }
}
