//! What a checkpoint lacks for the network that it is of.

use crate::checkpoint::{Architecture, Checkpoint};
use crate::fastsam::{self, FastSamError};
use crate::sam2::{self, Sam2Error, Sam2Network};
use burn::tensor::Device;
use std::cell::{Cell, RefCell};
use std::fmt;
use std::path::Path;

/// The networks asked for zeros may have this many times the numbers that the checkpoint holds, and
/// [`SMALLEST_LIMIT`] in any case: a small file cannot ask for much memory.
const LARGEST_SHARE: usize = 2;
const SMALLEST_LIMIT: usize = 1 << 24;

/// A tensor that a network needs and a checkpoint does not hold as it should.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Missing {
    /// The tensor's name.
    pub name: String,
    /// The shape it should have.
    pub expected: Vec<usize>,
    /// The shape it has; `None` if it is not there.
    pub found: Option<Vec<usize>>,
}

impl fmt::Display for Missing {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.found {
            Some(found) => write!(formatter, "{}: shape {found:?}, expected {:?}", self.name, self.expected),
            None => write!(formatter, "{}: missing, expected shape {:?}", self.name, self.expected),
        }
    }
}

/// The tensors that the network of a checkpoint needs and that are missing there or have another shape, in the order in
/// which the network reads them. `None` if the checkpoint is of no network that splatseg runs.
///
/// The network itself says what it needs: it is built on zeros, and what it asks for is compared. Nothing but names and
/// shapes is read from the file.
pub fn missing_tensors(checkpoint: &Checkpoint) -> Option<Vec<Missing>> {
    let audit = Audit::of(checkpoint);
    let built = match checkpoint.architecture() {
        Architecture::YoloV8Seg { .. } => {
            let config = fastsam::FastSamConfig::from_checkpoint(checkpoint).ok()?;
            fastsam::FastSamNetwork::load(&audit, config, &Device::flex()).is_ok()
        }
        Architecture::Sam2 { .. } => match Sam2Network::load(&audit, None, &Device::flex()) {
            Ok(_) | Err(Sam2Error::UnexpectedTensor { .. }) => true,
            Err(_) => false,
        },
        Architecture::Unknown => false,
    };
    let missing = audit.missing.into_inner();
    (built || !missing.is_empty()).then_some(missing)
}

/// Gives a network zeros for whatever it asks, and notes what the checkpoint could not have given.
struct Audit<'a> {
    checkpoint: &'a Checkpoint,
    missing: RefCell<Vec<Missing>>,
    /// Numbers that may still be asked for.
    left: Cell<usize>,
}

impl<'a> Audit<'a> {
    fn of(checkpoint: &'a Checkpoint) -> Self {
        let held: usize = checkpoint.tensors().map(|tensor| tensor.elements()).sum();
        let left = Cell::new(held.saturating_mul(LARGEST_SHARE).max(SMALLEST_LIMIT));
        Self { checkpoint, missing: RefCell::default(), left }
    }

    /// Zeros of a shape; `None` if that is too much.
    fn zeros(&self, name: &str, expected: &[usize]) -> Option<Vec<f32>> {
        let found = self.checkpoint.info(name).map(|tensor| tensor.shape().to_vec());
        if found.as_deref() != Some(expected) {
            self.missing.borrow_mut().push(Missing { name: name.to_owned(), expected: expected.to_vec(), found });
        }
        let count = expected.iter().try_fold(1usize, |count, side| count.checked_mul(*side))?;
        self.left.set(self.left.get().checked_sub(count)?);
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
